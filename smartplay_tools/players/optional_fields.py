"""Optional fields of requests: a server that refuses one is asked once more without it.

Servers of one interface accept different fields, and word their refusals differently. Reports of such refusals, read on
26 November 2026:

- `prompt_cache_key`: github.com/zed-industries/zed/issues/52000, github.com/MoonshotAI/kimi-code/issues/2611
- `stream_options`: github.com/FlowiseAI/Flowise/issues/2866, github.com/modelscope/ms-agent/issues/489
- `cache_control`: github.com/earendil-works/pi/issues/7938
- `include`: github.com/NousResearch/hermes-agent/issues/23450, github.com/pydantic/pydantic-ai/issues/2867
- `max_tokens`: github.com/autohandai/code-cli/issues/77
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from typing import Any

from smartplay_tools.players.attempts import status_of
from smartplay_tools.visible import logger

log = logger("smartplay_tools.players")

OPTIONAL = ("include", "parallel_tool_calls", "prompt_cache_key", "store", "stream_options")
"""Fields of a request that it may do without."""

OPTIONAL_INSIDE = ("cache_control", "prompt_cache_breakpoint")
"""The same inside of its messages and tools."""

LIMITS = {"max_tokens": "max_completion_tokens", "max_completion_tokens": "max_tokens"}
"""The names of the cap on a reply of chat completions. It is not optional: the other name is tried."""

SCHEMAS = ("parameters", "input_schema")
"""The fields of a tool that hold a JSON schema, in which any name may stand."""

_WRONG_NAME = re.compile(
    r"un(?:supported|recogni[sz]ed|known|expected)|not (?:supported|permitted|allowed)|extra|instead"
)
"""Words about the name of a field. Words about its value, such as "too large", are no reason to try another name."""


class OptionalFields:
    """What the server of one player has refused; later requests are made without it.

    Arguments:
        player: the player's name, for the log.
        own: the fields that the user has set, which are never left out.
    """

    def __init__(self, player: str, own: Container[str]) -> None:
        self._player, self._own = player, own
        self._left_out: frozenset[str] = frozenset()
        self._renamed: Mapping[str, str] = {}
        self._has_guessed = False
        self.has_worked = False
        """Whether the server has answered a request; from then on, no field is left out that it does not name."""

    def fit(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return a request as the server takes it."""
        if not self._left_out and not self._renamed:
            return request
        fields = {self._renamed.get(name, name): value for name, value in request.items() if name not in self._left_out}
        return {name: _without(value, self._left_out) for name, value in fields.items()}

    def mend(self, request: dict[str, Any], error: Exception) -> bool:
        """Whether a request was refused for a field that it has now no more, so that it is worth sending again.

        A refusal that names no field of it is taken for one of all its optional fields, once and only until the server
        has answered a request: if they were not the reason, they come back.
        """
        if status_of(error) not in (400, 422):
            return False
        words = f"{getattr(error, 'param', None) or ''}\n{error}\n{getattr(error, 'body', None)}".lower()
        present = frozenset(
            name for name in (*OPTIONAL, *OPTIONAL_INSIDE) if name not in self._own and _has(request, name)
        )
        # A request may have been under way when another one was refused.
        late = {name: other for name, other in self._renamed.items() if name in request}
        renamed = late if self._renamed else self._limit_in(request, words)
        refused = frozenset(name for name in present if name in self._left_out or _is_named(name, words))
        if not refused and not renamed:
            if self._has_guessed and not self.has_worked:
                self._left_out = frozenset()
            names_another = getattr(error, "param", None) or any(_is_named(name, words) for name in request)
            if self._has_guessed or self.has_worked or names_another or not present:
                return False
            self._has_guessed, refused = True, present
        changes = [*sorted(refused - self._left_out)]
        changes += [f"{name}, now {other}" for name, other in renamed.items() if name not in self._renamed]
        if changes:
            log.warning("The server of %s refused a request; it is asked without %s.", self._player, ", ".join(changes))
        self._left_out, self._renamed = self._left_out | refused, {**self._renamed, **renamed}
        changed = self.fit(request)
        request.clear()
        request.update(changed)
        return True

    def _limit_in(self, request: Mapping[str, Any], words: str) -> Mapping[str, str]:
        if not _WRONG_NAME.search(words):
            return {}
        return {
            name: other for name, other in LIMITS.items() if name in request and name not in self._own and name in words
        }


def _is_named(name: str, words: str) -> bool:
    """Whether a refusal names a field; one whose name is an English word has to stand as a name does."""
    if name == "include" and re.search("encrypted[ _]content", words):
        return True
    if "_" in name:
        return re.search(rf"(?<!\w){name}(?!\w)", words) is not None
    before, after = r"""(?:^|['"`.]|: |-> |argument |parameter |field |property )""", r"""(?:['"`.,\[]|$)"""
    return re.search(f"{before}{name}{after}", words, re.MULTILINE) is not None


def _has(value: Any, name: str) -> bool:
    if isinstance(value, Mapping):
        inside = (part for key, part in value.items() if key not in SCHEMAS)
        return name in value or (name in OPTIONAL_INSIDE and any(_has(part, name) for part in inside))
    return isinstance(value, list) and any(_has(part, name) for part in value)


def _without(value: Any, names: frozenset[str]) -> Any:
    inside = names.intersection(OPTIONAL_INSIDE)
    if not inside:
        return value
    if isinstance(value, Mapping):
        kept = ((key, part) for key, part in value.items() if key not in inside)
        return {key: part if key in SCHEMAS else _without(part, names) for key, part in kept}
    return [_without(part, names) for part in value] if isinstance(value, list) else value
