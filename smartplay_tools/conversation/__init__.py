"""Conversations, which exchange prompts and replies under a budget, in tool calls or free text; and `play`."""

from smartplay_tools.conversation.agent_session import AgentSession, Conversation
from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.conversation.host_chat import HostChat, HostHistory
from smartplay_tools.conversation.loop import AttachedPlayer, aplay, check_observation, play
from smartplay_tools.conversation.paper import PaperConversation
from smartplay_tools.conversation.text_env import TextEnv

__all__ = [
    "AgentSession",
    "AttachedPlayer",
    "BaseConversation",
    "Conversation",
    "HostChat",
    "HostHistory",
    "PaperConversation",
    "TextEnv",
    "aplay",
    "check_observation",
    "play",
]
