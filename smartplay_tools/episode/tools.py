"""The tools: their descriptions for the model, how its calls are parsed, and the same tools as Python functions.

Every agent has `observe`, `act` and `read_manual`; strategies for the past may add others. `GameTools` has the three as
callables, for frameworks that read names, annotations and docstrings.

A call is played as it was sent or refused with a reason, never repaired: a benchmark that guesses what a model meant
measures the guess. An action is given by its exact name or by its number in the game's manual, as a text or as a whole
number: some hosts turn the text "1" into the number 1, whatever the model wrote. The legal actions are listed in the
description of `act`, not in an enum, because frameworks disagree on who rejects an enum violation.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_type_hints

from smartplay_tools.context.prompts.wording import VERSION, Wording, known
from smartplay_tools.context.strategies.base import StrategyTool
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.game_registry import GameSpec, close_game
from smartplay_tools.games.specs import get_spec
from smartplay_tools.games.values import plain_name
from smartplay_tools.types import MEMORY_TOOL, ToolResult, ToolSpec
from smartplay_tools.types.arguments import Arguments, as_text, is_strict, number_as_text, text_parameters

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame


QUOTED = 80
"""The most characters of what was sent that an error quotes."""

SchemaFormat = Literal["openai", "responses", "anthropic", "json"]


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


def schema(tool: ToolSpec, form: SchemaFormat) -> dict[str, Any]:
    """Return a tool in the format of an interface: OpenAI chat, OpenAI Responses, Anthropic or JSON Schema.

    For OpenAI the game's tools are strict; an agent's own tool is, if its schema fits.
    For Anthropic, the tool `memory` of a budget with `memory_tokens` is the provider's own, which has no schema.
    """
    parameters = dict(tool.parameters)
    function = {"name": tool.name, "description": tool.description}
    strict = is_strict(parameters)
    match form:
        case "openai":
            return {"type": "function", "function": {**function, "parameters": parameters, "strict": strict}}
        case "responses":
            return {"type": "function", **function, "parameters": parameters, "strict": strict}
        case "anthropic" if tool.name == MEMORY_TOOL and _is_ours(tool):
            return {"type": "memory_20250818", "name": tool.name}
        case "anthropic":
            return {**function, "input_schema": parameters}
        case "json":
            return {**function, "parameters": parameters}
    raise InvalidArgumentError(f"There is no schema format {form!r}; known: openai, responses, anthropic, json.")


def quote(sent: Any) -> str:
    """Quote what was sent, at most `QUOTED` characters of it."""
    text = sent if isinstance(sent, str) else as_text(sent)
    return f'"{text}"' if len(text) <= QUOTED else f'"{text[:QUOTED]}…"'


class Callee(Protocol):
    """An object that answers the calls of the functions: an episode, or an adapter's object in front of one."""

    @property
    def tools(self) -> tuple[ToolSpec, ...]:
        """The tools: observe, act, read_manual."""
        ...

    def call(self, name: str, arguments: Any) -> ToolResult:
        """Answer a call."""
        ...


class AsyncCallee(Callee, Protocol):
    """An object that answers calls in threads, too, and says when it is over: an episode."""

    @property
    def done(self) -> bool:
        """Whether the episode is over."""
        ...

    async def acall(self, name: str, arguments: Any) -> ToolResult:
        """Answer a call in a thread."""
        ...

    def refuse_pictures(self, host: str) -> None:
        """Raise an `InvalidArgumentError` if results have pictures, which `host` cannot show."""
        ...


class _OfEpisode:
    def __init__(self, episode: AsyncCallee) -> None:
        episode.refuse_pictures("A function")
        self._episode = episode

    @property
    def done(self) -> bool:
        """Whether the episode is over."""
        return self._episode.done


class GameTools(_OfEpisode):
    """An object whose methods are the tools, for frameworks that take an object's public methods.

    `done` says whether the episode is over.
    """

    def observe(self) -> str:
        """Show the current observation again, without playing."""
        return self._episode.call("observe", {}).text

    def act(self, action: str) -> str:
        """Play one action and show what happens.

        Args:
            action: The action's name or number, exactly as listed.
        """
        return self._episode.call("act", {"action": action}).text

    def read_manual(self) -> str:
        """Show the game's manual."""
        return self._episode.call("read_manual", {}).text


class AsyncGameTools(_OfEpisode):
    """`GameTools` whose methods are awaited; the game's steps run in threads."""

    async def observe(self) -> str:
        """Show the current observation again, without playing."""
        return (await self._episode.acall("observe", {})).text

    async def act(self, action: str) -> str:
        """Play one action and show what happens.

        Args:
            action: The action's name or number, exactly as listed.
        """
        return (await self._episode.acall("act", {"action": action})).text

    async def read_manual(self) -> str:
        """Show the game's manual."""
        return (await self._episode.acall("read_manual", {})).text


def tool_functions(episode: Callee) -> tuple[Callable[[], str], Callable[[str], str], Callable[[], str]]:
    """Return the game's tools as plain functions, documented with the descriptions that this game's models are given.

    The tools of strategies are not among them: a framework that takes functions owns the context.
    """

    def observe() -> str:
        return episode.call("observe", {}).text

    def act(action: str) -> str:
        return episode.call("act", {"action": action}).text

    def read_manual() -> str:
        return episode.call("read_manual", {}).text

    described = {tool.name: tool for tool in episode.tools}
    for function in (observe, act, read_manual):
        if (tool := described.get(function.__name__)) is None:
            raise InvalidArgumentError(
                f"The functions are those of all three tools, and {function.__name__} is not offered; leave "
                'offered_tools at "all".'
            )
        function.__annotations__ = get_type_hints(function)  # types, not their names: what frameworks look at
        function.__doc__ = documentation(tool)
    return observe, act, read_manual


def documentation(tool: ToolSpec) -> str:
    """Return a tool's description and those of its arguments as a docstring."""
    properties: dict[str, Any] = tool.parameters["properties"]
    arguments = [f"    {name}: {field['description']}" for name, field in properties.items()]
    return "\n".join([tool.description, *(["\nArgs:", *arguments] if arguments else [])])


def _is_ours(tool: ToolSpec) -> bool:
    """Whether a tool with the name of the memory is that of this library, and not a host's own."""
    from smartplay_tools.context.strategies.memory import memory_spec

    specs = (memory_spec(1, Wording.of(version)) for version in known())
    return any(tool.parameters == spec.parameters for spec in specs)
