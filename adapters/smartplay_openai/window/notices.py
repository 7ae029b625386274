"""The parts of a host's requests that do not reach the model: named with each answer, and logged once an episode."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

from smartplay_openai.window.completion_request import CompletionRequest
from smartplay_openai.window.names import HostTools

log = logging.getLogger("smartplay_openai.window")


@dataclass(frozen=True)
class Shown:
    """What the model is shown of the host's agent in addition to the game's window; all of it is counted."""

    only_game_tools: bool = False
    """Whether the host's other tools are hidden."""
    system: bool = False
    """Whether the host's instructions in its first request are shown."""

    def ignored(self, request: CompletionRequest, tools: HostTools) -> Iterator[str]:
        """Yield the parts of a request that the model is not shown."""
        for role, count in request.ignored.characters.items():
            if count and not (self.system and role in ("system", "developer")):
                yield f"{role} messages ({count:,} characters)"
        yield from (f"{kind} ({count:,})" for kind, count in request.ignored.kinds.items())
        if names := [*tools.hidden, *request.left_out]:
            yield f"the tools {', '.join(names)}"
        yield from request.ignored.fields


class Notices:
    """The ignored parts of an episode's requests.

    Arguments:
        handle: the episode's handle.
        shown: what the model is shown.
    """

    def __init__(self, handle: str, shown: Shown) -> None:
        self._handle, self._shown = handle, shown
        self.latest = ""
        """What was ignored of the latest request that had something to ignore."""

    def of(self, request: CompletionRequest, tools: HostTools) -> str:
        """Say which parts of a request the model is not shown."""
        return ", ".join(self._shown.ignored(request, tools))

    def note(self, request: CompletionRequest, tools: HostTools) -> None:
        """Take note of a request, and log the first one with ignored parts."""
        ignored = self.of(request, tools)
        if ignored and not self.latest:
            log.warning("%s: the model sees the game's window only; ignored: %s.", self._handle, ignored)
        self.latest = ignored or self.latest
