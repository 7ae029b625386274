"""OpenAI's two interfaces as wire formats, for the client of a model and for the servers in front of one.

interface       the operations of an interface: requests and replies, and the reverse
chat            chat completions
responses       Responses, without stored conversations
stream_pieces   how the pieces of a stream become values and calls
thinking_parts  parts of a content that are not words
problems        what a server refuses, in OpenAI's form
tool_choice     which tools a reply may and must call
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.players.wire.chat import CHAT as CHAT, chat_reply as chat_reply, chat_request as chat_request
    from smartplay_tools.players.wire.interface import Event as Event, Interface as Interface, Streaming as Streaming
    from smartplay_tools.players.wire.problems import (
        RequestError as RequestError,
        bad as bad,
        objects as objects,
        read_tools as read_tools,
    )
    from smartplay_tools.players.wire.responses import (
        RESPONSES as RESPONSES,
        read_items as read_items,
        responses_reply as responses_reply,
        responses_request as responses_request,
    )
    from smartplay_tools.players.wire.tool_choice import ToolChoice as ToolChoice, plainest_value as plainest_value

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
