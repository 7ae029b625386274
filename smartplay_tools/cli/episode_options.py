"""The options of an episode (its budget, its rules, its game's options), which are the same for all commands.

Each option is defined once, in `BUDGET`, `RULES` or `OTHERS`. `with_episode_options` adds them to a command, which gets
the values as one `EpisodeOptions`. A new rule or a new field of the budget is one line here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from smartplay_tools.cli.options import key_values, names, with_options
from smartplay_tools.context.prompts.wording import PARAPHRASES
from smartplay_tools.context.strategies import KINDS
from smartplay_tools.context.tokens import get_tokenizer
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import STRATEGIES, WORDS, Budget

PAST = "Strategies: what happens to turns that no longer fit"
"""The panel of the options of strategies."""

GRID = "The grid: lists separated by commas"
"""The panel of the options that are lists of values."""


def _number(value: str) -> int | str | None:
    """A number such as 2000 or 2,000, None for "none", or another word, which the budget validates."""
    if value == "none":
        return None
    return int(value.replace(",", "")) if re.fullmatch(r"-?(\d+|\d{1,3}(,\d{3})+)", value) else value


def _limit(text: str, metavar: str = "N", **how: Any) -> Any:
    return _option(Any, text, parser=_number, metavar=metavar, **how)


def _option(kind: Any, text: str, *names: str, panel: str = "Episode options", **how: Any) -> Any:
    return Annotated[kind, typer.Option(*names, help=text, rich_help_panel=panel, **how)]


BUDGET: Mapping[str, tuple[Any, Any]] = {
    "history": (_limit("Past steps visible: a number, game (the paper's) or none (all)."), "game"),
    "prompt_tokens": (_limit("Cap on every prompt, in budget tokens."), "none"),
    "reply_tokens": (_limit("Cap on every reply."), "none"),
    "question_tokens": (_limit("Cap on the prompts of a compactor's questions; none: that of prompts."), "none"),
    "episode_tokens": (_limit("Cap on all prompts and replies together."), "none"),
    "episode_cost": (_limit("Cap on what all prompts and replies cost, by --cost-rule.", "AMOUNT"), "none"),
    "cost_rule": (_limit("What a token costs: a rule as in `cost`, PROVIDER:MODEL, or numbers.", "RULE"), "none"),
    "result_tokens": (_limit("Cap on one tool result: a number, auto or none."), "auto"),
    "tool_calls": (_limit("Cap on tool calls: a number, game (4 x rollout + 16) or none."), "game"),
    "stalled_turns": (_limit("Cap on turns in a row that play no step and show nothing new, or none."), "10"),
    "slack": (_option(float, "Share of the window that is dropped at once when it is full."), 0.0),
    **{
        kind.name: (_limit(kind.option_help, "NAME" if kind.name in WORDS else "N", panel=PAST), "none")
        if STRATEGIES[kind.name] is None
        else (_option(str, kind.option_help, panel=PAST), STRATEGIES[kind.name])
        for kind in KINDS.values()
    },
}
"""The fields of `Budget`: the option and its default."""

OTHER_WORDS = f"Other words around the games: a TOML file, or one of {', '.join(PARAPHRASES)}."

RULES: Mapping[str, tuple[Any, Any]] = {
    "manual": (_option(str, "tool, pinned or none."), "tool"),
    "batch": (_option(str, "all or first_act."), "all"),
    "protocol": (_option(str, "tools, or paper: free text, two questions a step."), "tools"),
    "observation": (_option(str, "text, picture or both."), "text"),
    "budget_line": (_option(str, "on: the last line of each result says what is left of the budget; or off."), "off"),
    "first_observation": (_option(str, "call: by a call of observe; prompt: the task ends with it."), "call"),
    "offered_tools": (_option(str, "all, or useful: without tools that can say nothing new."), "all"),
    "carry": (_option(str | None, "What a trial takes over from the one before it: notes or memory."), None),
    "chain": (_option(int | None, "Trials of a chain, with --carry; all of a cell if not given."), None),
    "wording": (_option(str | None, OTHER_WORDS, "--prompts", metavar="FILE"), None),
}
"""The fields of `Rules`; `context` is not among them, since a command decides it."""

OF_RUNS = ("carry", "chain")
"""Rules that a single episode cannot have."""

OTHERS: Mapping[str, tuple[Any, Any]] = {
    "engine": (_option(str | None, "For games with several engines."), None),
    "tokenizer": (_option(str | None, "A tiktoken name, or hf:PATH_OR_NAME; +RULE counts pictures."), None),
    "option": (_option(list[str] | None, "A game's own option; repeatable.", metavar="KEY=VALUE"), None),
}
"""The engine, the tokenizer and the game's own options."""


@dataclass(frozen=True)
class EpisodeOptions:
    """The episode options of a command line. An option that a command does not have is missing in the mappings."""

    budget_fields: Mapping[str, Any] = field(default_factory=dict)
    rules: Mapping[str, Any] = field(default_factory=dict)
    engine: str | None = None
    tokenizer: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    """The game's own options."""
    vary: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    """The options that are lists of values."""

    @property
    def budget(self) -> Budget:
        """The budget; raises `InvalidArgumentError` for an invalid value."""
        return read_budget(**self.budget_fields)

    @property
    def of_cells(self) -> dict[str, Any]:
        """What the cells of a run have in common as keyword arguments, whatever their budgets are."""
        return {"engine": self.engine, "tokenizer": self.tokenizer, "options": self.options, **self.rules}

    @property
    def conditions(self) -> dict[str, Any]:
        """The conditions of an episode as keyword arguments, except the game's own options."""
        return {"budget": self.budget, "engine": self.engine, "tokenizer": self.tokenizer, **self.rules}


def with_episode_options(
    *, without: Collection[str] = OF_RUNS, vary: Collection[str] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Add the options of an episode to a command; the command's argument `episode` gets their values.

    `without` names options that the command does not have; the options in `vary` are lists of values.
    """
    added = {
        name: _list_of(*value) if name in vary else value
        for name, value in {**BUDGET, **RULES, **OTHERS}.items()
        if name not in without
    }

    def pack(asked: dict[str, Any]) -> EpisodeOptions:
        if asked.get("tokenizer"):  # records that a server continues open none
            get_tokenizer(asked["tokenizer"])
        lists = {name: _values(name, asked.pop(name)) for name in added if name in vary}
        return EpisodeOptions(
            {name: asked[name] for name in BUDGET if name in asked},
            {name: asked[name] for name in RULES if name in asked},
            asked.get("engine"),
            asked.get("tokenizer"),
            key_values(asked.get("option")),
            lists,
        )

    return with_options("episode", added, pack)


def listed(option: str, text: str) -> list[str]:
    """Return the values of a list separated by commas; an empty one is an `InvalidArgumentError`."""
    values = names(text)
    if not values:
        raise InvalidArgumentError(f"{option} is empty; give values separated by commas.")
    return values


def _list_of(annotation: Any, default: Any) -> tuple[Any, str]:
    """The same option as a list of values."""
    return _option(str, annotation.__metadata__[0].help, panel=GRID, metavar="LIST"), str(default)


def _values(name: str, text: str) -> list[Any]:
    values = listed("--" + name.replace("_", "-"), text)
    return (
        [getattr(read_budget(**{name: _number(value)}), name) for value in values] if name in BUDGET else list(values)
    )


def read_budget(**fields: Any) -> Budget:
    """Return the budget of these options; raise `InvalidArgumentError` for an invalid value."""
    try:
        return Budget.model_validate(fields)
    except ValidationError as error:
        first = error.errors()[0]
        option = "--" + str(first["loc"][0]).replace("_", "-")
        words = [word for word in ("game", "auto", "none", "never") if f"{word}" in _words(str(first["loc"][0]))]
        what = "it is a whole number such as 2,000" if first["type"].startswith("int_") else first["msg"]
        others = f", or one of the words {', '.join(words)}" if len(words) > 1 else "".join(f", or {w}" for w in words)
        raise InvalidArgumentError(f"{option} {first['input']}: {what}{others}.") from None


def _words(name: str) -> str:
    """The help of an option, which names the words that it accepts in addition to numbers."""
    return f"{BUDGET[name][0].__metadata__[0].help} {BUDGET[name][1]}" if name in BUDGET else ""
