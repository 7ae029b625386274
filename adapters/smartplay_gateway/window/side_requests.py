"""Requests that never reach the model: those of a host's agent for titles, plans and summaries, and of its sub-agents.

They are answered in words, or in the plainest JSON of the schema that they ask for, cost nothing, are logged once an
episode for each kind, and counted. Where a host hides the game's tools behind a tool search, its search is called.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable
from typing import Any

from smartplay_gateway.window.formats import CompletionRequest
from smartplay_gateway.window.names import HostTools, filled
from smartplay_gateway.window.pending_reply import PendingReply
from smartplay_tools import Episode, Message, Usage
from smartplay_tools.visible import logger

NO_TOOLS = (
    "This endpoint plays a game: it answers requests that offer the game's tools, which its MCP server has. An "
    "agent that hides its tools behind a search has to show these; Claude Code does with ENABLE_TOOL_SEARCH=false."
)
NO_CALLS = "This endpoint plays a game, and the model behind it is asked for moves only, not for other texts."

WITHOUT_TOOLS, WITHOUT_CALLS, OF_SUB_AGENT, SEARCHED = (
    "without the game's tools",
    "that allow no call",
    "of sub-agents",
    "that hide the game's tools behind a search",
)
"""Kinds of these requests."""

SEARCHES = ("ToolSearch", "tool_search")
"""The tools with which Claude Code and qwen-code load others."""

HIDDEN_NAME = re.compile(r"mcp__\w+__(?:act|observe|read_manual)\b")

log = logger("smartplay_gateway.window")


class SideRequests:
    """The requests of one episode that are answered in words.

    Arguments:
        handle: the episode's handle.
        episode: the episode.
        is_ours: says whether a request mentions any call that the endpoint has sent.
    """

    def __init__(self, handle: str, episode: Episode, is_ours: Callable[[str], bool]) -> None:
        self._handle, self._episode, self._is_ours = handle, episode, is_ours
        self._tools: frozenset[str] | None = None
        self.counts: Counter[str] = Counter()
        """How many there were of each kind."""

    def answer(self, request: CompletionRequest, tools: HostTools, search_id: str) -> PendingReply | None:
        """Return the answer to a request that is not for the model; None for one that is.

        The tools of the first request for the model count: one that lacks some of them, and knows none of our calls, is
        of a sub-agent, because a reply may call any of them.
        """
        if not tools.names:
            if not self._episode.done and (call := _search(request, search_id)):
                self._note(SEARCHED)
                return PendingReply({"role": "assistant", "content": None, "tool_calls": [call]}, Usage(requests=0))
            return self._words(request, WITHOUT_TOOLS, NO_TOOLS)
        if request.is_of_sub_agent:
            return self._words(request, OF_SUB_AGENT, self._episode.words("sub_agent"))
        if request.forbids_calls:
            return self._words(request, WITHOUT_CALLS, NO_CALLS)
        names = frozenset(tool.name for tool in request.tools)
        if self._tools is None:
            self._tools = names
        elif self._tools - names and not self._is_ours(request.body):
            return self._words(request, OF_SUB_AGENT, self._episode.words("sub_agent"))
        return None

    def _words(self, request: CompletionRequest, kind: str, text: str) -> PendingReply:
        self._note(kind)
        text = self._episode.words("game_is_over") if self._episode.done else text
        message: Message = {"role": "assistant", "content": in_schema(request, text)}
        return PendingReply(message, Usage(requests=0))

    def _note(self, kind: str) -> None:
        if not self.counts[kind] and not self._episode.done:
            log.warning("%s: requests %s are answered here, not by the model, and cost nothing.", self._handle, kind)
        self.counts[kind] += 1


def in_schema(request: CompletionRequest, text: str) -> str:
    """Return a text in the form that a request asks for: as the plainest JSON of its schema, if it has one."""
    return text if request.answer_schema is None else filled(request.answer_schema, text)


def _search(request: CompletionRequest, call_id: str) -> Any:
    """Return the call with which a host loads the game's tools, unless it has been made; None where nothing is hidden.

    The names of tools that are hidden stand somewhere in the host's own texts.
    """
    name = next((tool.name for tool in request.tools if tool.name in SEARCHES), None)
    hidden = sorted(set(HIDDEN_NAME.findall(request.body)))
    if name is None or not hidden or request.holds(call_id):
        return None
    arguments = json.dumps({"query": f"select:{','.join(hidden)}", "max_results": len(hidden)})
    return {"id": call_id, "type": "function", "function": {"name": name, "arguments": arguments}}
