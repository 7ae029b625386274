"""The tools: their descriptions for the model, and how its calls are parsed.

Every agent has `observe`, `act` and `read_manual`; strategies for the past may add others.

A call is played as it was sent or refused with a reason, never repaired: a benchmark that guesses what a model meant
measures the guess. An action is given by its exact name or by its number in the game's manual, as a text or as a whole
number: some hosts turn the text "1" into the number 1, whatever the model wrote. The legal actions are listed in the
description of `act`, not in an enum, because frameworks disagree on who rejects an enum violation.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.strategies.base import StrategyTool
from smartplay_tools.games.game_registry import GameSpec, close_game
from smartplay_tools.games.specs import get_spec
from smartplay_tools.games.values import plain_name
from smartplay_tools.types import ToolSpec
from smartplay_tools.types.arguments import Arguments, as_text, number_as_text, text_parameters

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame


QUOTED = 80
"""The most characters of what was sent that an error quotes."""


class MistakeError(Exception):
    """A call that cannot be played; its message tells the model what to do next. Never raised out of `Episode.call`."""

    def __init__(self, kind: Literal["malformed", "illegal"], text: str) -> None:
        super().__init__(text)
        self.kind = kind


@dataclass(slots=True)
class ParsedCall:
    """A call that can be played."""

    tool: str
    """`observe`, `act`, `read_manual` or the name of a strategy's tool."""
    action: int | None = None
    """For `act`, the index into the game's `actions`."""
    text: str = ""
    """For a strategy's tool, its argument."""
    values: Mapping[str, Any] | None = None
    """For a strategy's tool that reads its arguments itself, all of them."""


class _Actions:
    """The names of a game's actions, in its own order and in the manual's: how a call can name one."""

    def __init__(self, actions: Sequence[str], numbered: Sequence[str]) -> None:
        self.listed = "\n".join(f"{number}. {name}" for number, name in enumerate(numbered, start=1))
        self.example = json.dumps({"action": numbered[0]}, ensure_ascii=False)
        self._by_name = {plain_name(name): index for index, name in enumerate(actions)}
        self._by_number = {number: self._by_name[plain_name(name)] for number, name in enumerate(numbered, start=1)}

    def find(self, sent: str) -> int | None:
        """Return the index of the action that is meant; None if it is none."""
        plain = plain_name(sent)
        if plain in self._by_name:
            return self._by_name[plain]
        if match := re.fullmatch(r"([0-9]{1,3})(?:\. +(.+))?", plain):
            action = self._by_number.get(int(match[1]))
            if action is not None and (match[2] is None or self._by_name.get(plain_name(match[2])) == action):
                return action
        return None


_actions_of = functools.lru_cache(64)(_Actions)
"""Cached, because all episodes of a game have the same actions."""


class Tools:
    """The tools of one game: their specs, and `parse`, which reads a call.

    `added` are the tools of the episode's strategies, and `withheld` names those of the three that are not offered.
    """

    def __init__(
        self,
        game: TextGame,
        words: Wording,
        added: Sequence[StrategyTool] = (),
        *,
        withheld: Container[str] = (),
    ) -> None:
        self.words = words
        """The words of what is said about them."""
        self._actions = _actions_of(tuple(game.actions), tuple(game.numbered_actions))
        three = (
            ToolSpec("observe", words("observe"), text_parameters()),
            ToolSpec("act", words("act", actions=self._actions.listed), text_parameters(action=words("act_action"))),
            ToolSpec("read_manual", words("read_manual"), text_parameters()),
        )
        self.game_specs = tuple(spec for spec in three if spec.name not in withheld)
        """The game's own tools: the three of every agent, without those that are withheld."""
        self.added = {tool.spec.name: tool for tool in added}
        """The tools of strategies, by name."""
        self.specs = (*self.game_specs, *(tool.spec for tool in added))
        """All tools."""
        self._names = tuple(spec.name for spec in self.specs)

    def parse(self, name: Any, arguments: Arguments) -> ParsedCall:
        """Return the parsed call; raise `MistakeError`, and nothing else, if it cannot be played."""
        if name not in self._names:
            raise self._malformed("no_such_tool", name=quote(name), tools=", ".join(self._names))
        # Quoted in canonical form, so that an error reads alike in frameworks that parse and in those that do not.
        text, values = arguments.canonical, arguments.values
        if arguments.problem is not None:
            problem = self.words(arguments.problem.name, **arguments.problem.values)
            raise self._malformed("bad_arguments", problem=problem, sent=quote(text), usage=self._usage(name))
        assert values is not None
        if name == "act":
            sent = self._only(name, "action", values, text, takes_numbers=self.words.takes_numbers)
            return ParsedCall("act", action=self._action(sent))
        if (added := self.added.get(name)) is not None:
            if added.argument is None:
                return ParsedCall(name, values=values)
            return ParsedCall(name, text=self._only(name, added.argument, values, text))
        if values:
            raise self._malformed("unexpected_arguments", sent=quote(text), usage=self._usage(name))
        return ParsedCall(name)

    def _only(
        self, tool: str, argument: str, values: Mapping[str, Any], sent: str, *, takes_numbers: bool = False
    ) -> str:
        """The text of a tool's one argument."""
        value = values.get(argument)
        if takes_numbers:
            value = number_as_text(value)
        if argument not in values:
            problem = "missing_argument"
        elif len(values) > 1:
            problem = "other_arguments"
        elif not isinstance(value, str):
            problem = "not_a_string"
        else:
            return value
        raise self._malformed(problem, argument=argument, sent=quote(sent), usage=self._usage(tool))

    def _action(self, sent: str) -> int:
        action = self._actions.find(sent)
        if action is None:
            reason = self.words("illegal_action", sent=quote(sent), actions=self._actions.listed)
            raise MistakeError("illegal", reason)
        return action

    def _malformed(self, sentence: str, **values: str) -> MistakeError:
        return MistakeError("malformed", self.words(sentence, **values))

    def _usage(self, tool: str) -> str:
        if tool == "act":
            actions = self._actions
            return self.words("act_usage", example=actions.example, actions=actions.listed)
        if (added := self.added.get(tool)) is not None:
            return added.usage
        return self.words("usage_without_arguments", tool=tool)


def tool_specs(game: str | GameSpec, **options: Any) -> tuple[ToolSpec, ...]:
    """Return the three tools of a setting, without an episode; `options` are the game's own."""
    made = get_spec(game).make(**options)
    try:
        return Tools(made, Wording.of(VERSION)).specs
    finally:
        close_game(made)


def quote(sent: Any) -> str:
    """Quote what was sent, at most `QUOTED` characters of it."""
    text = sent if isinstance(sent, str) else as_text(sent)
    return f'"{text}"' if len(text) <= QUOTED else f'"{text[:QUOTED]}…"'
