"""Conversations, which exchange prompts and replies under a budget, in tool calls or free text; and `play`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.conversation.agent_session import AgentSession as AgentSession, Conversation as Conversation
    from smartplay_tools.conversation.base import BaseConversation as BaseConversation
    from smartplay_tools.conversation.host_chat import HostChat as HostChat
    from smartplay_tools.conversation.loop import (
        AttachedPlayer as AttachedPlayer,
        aplay as aplay,
        check_observation as check_observation,
        play as play,
    )
    from smartplay_tools.conversation.paper import PaperConversation as PaperConversation
    from smartplay_tools.costs.host_history import HostHistory as HostHistory

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
