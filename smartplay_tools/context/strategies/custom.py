"""Custom strategies: from a file, an installed package or the running program, by name.

`Budget.strategy` is a name of the group of entry points `smartplay_tools.strategies`, one that this program has
registered, or `FILE.py:CLASS`; options may follow, as in `FILE.py:CLASS:turns=3`. A strategy in a file is identified by
the file's name, the class and the digest of the file's content: a record has these three, and an edited file is a new
strategy. The path of the file is where it was found on one machine; only the manifest of a run has it. A name in a
record never imports a file: a record can come from a stranger.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from smartplay_tools.context.strategies.base import BudgetStrategy
from smartplay_tools.context.view import Selection, ranges_of
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, extra_named, in_one_line, name_of
from smartplay_tools.games.game_registry import packages_are_imported
from smartplay_tools.registry import NamedInFiles, Registry, is_in_file, without_folders
from smartplay_tools.types import Budget
from smartplay_tools.types.arguments import value_in

if TYPE_CHECKING:
    from smartplay_tools.context.compaction import Compactor
    from smartplay_tools.context.strategies.choices import Strategy

__all__ = ["Custom", "load_strategy", "name_on_record", "register_strategy"]

ENTRY_POINTS = "smartplay_tools.strategies"
"""The group under which other packages declare strategies."""

BETWEEN_OPTIONS = re.compile(r"[:,](?=[^\W\d]\w*=)")
"""A colon or a comma before an option; before anything else it is part of the place, or of a value."""

IMPORTED = {
    "agent-framework-summary": "smartplay_compactors.agent_framework:AgentFrameworkSummary",
    "clear_thinking_20251015": "smartplay_tools.compactors.provider_edits:ClearThinking",
    "clear_tool_uses_20250919": "smartplay_tools.compactors.provider_edits:ClearToolUses",
    "compact_20260112": "smartplay_tools.compactors.provider_edits:Compact",
    "compaction": "smartplay_tools.compactors.provider_edits:OpenAICompaction",
    "context_management": "smartplay_tools.compactors.provider_edits:ContextManagement",
    "deepagents-summary": "smartplay_langchain.compaction:DeepAgentsSummary",
    "inspect-edit": "smartplay_inspect.compaction:InspectEdit",
    "inspect-summary": "smartplay_inspect.compaction:InspectSummary",
    "inspect-trim": "smartplay_inspect.compaction:InspectTrim",
    "keep-random": "smartplay_tools.compactors.blind:RandomTurns",
    "keep-spread": "smartplay_tools.compactors.blind:SpreadTurns",
    "langchain-clear": "smartplay_langchain.compaction:LangChainClearing",
    "langchain-summary": "smartplay_langchain.compaction:LangChainSummary",
    "langmem-summary": "smartplay_langchain.compaction:LangMemSummary",
    "llama-index-summary": "smartplay_compactors.llama_index:LlamaIndexSummary",
    "memory-bm25": "smartplay_tools.compactors.retrieval:WordMemory",
    "memory-wordllama": "smartplay_compactors.embeddings:VectorMemory",
    "pydantic-ai-newest": "smartplay_pydantic_ai.compaction:NewestMessages",
    "pydantic-ai-summary": "smartplay_pydantic_ai.compaction:HarnessSummary",
    "pydantic-ai-window": "smartplay_pydantic_ai.compaction:HarnessWindow",
}
"""The compaction of other projects, and the edits of providers: the place of each class by the name of the strategy."""

_REGISTRY = Registry("strategy", IMPORTED, ENTRY_POINTS)


class Custom(BudgetStrategy):
    """Leaves the choice of the turns to a custom strategy."""

    name = "strategy"
    option_help = "A custom strategy: FILE.py:CLASS, or the name of one of an installed package."

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why it cannot be combined with the rest of the budget: it chooses what others would decide."""
        for name in ("beyond_history", "summary_tokens", "first_turns", "slack"):
            if getattr(budget, name) != Budget.model_fields[name].default:
                return f"strategy={budget.strategy} chooses the turns itself, so {name} would do nothing; leave it out."
        return None

    def recorded(self, chosen: Selection) -> Mapping[str, Any]:
        """Return the turns that it masks, and its texts."""
        return {"hidden": ranges_of(sorted(chosen.masked)), "texts": chosen.facts.get("texts", [])}


@dataclass(frozen=True)
class Loaded:
    """A class that was imported, or registered."""

    make: Callable[..., Any]
    sha256: str | None = None
    """The digest of its file; None if it is not in a file."""
    path: Path | None = None
    """Its file, as the user has named it; None if it is not in a file."""


_NAMED: dict[str, Loaded] = {}
"""The strategies without a file that this process has been asked for, by their names without options."""

IN_FILES = NamedInFiles("strategy")
"""The strategies in files that the user has named in this process."""


def register_strategy(name: str, make: Callable[..., Strategy | Compactor]) -> None:
    """Register a strategy by a name in this process, as a notebook does; a package declares an entry point instead."""
    if not isinstance(name, str) or not name or ":" in name or name == "none" or name in _REGISTRY:
        raise InvalidArgumentError(f"{name!r} cannot be the name of a strategy, or is taken; choose another.")
    if not callable(make):
        raise InvalidArgumentError(f"{name_of(make)} is an object; register the class of the strategy {name!r}.")
    _NAMED[name] = Loaded(make)


def load_strategy(name: str, digest: str | None = None, path: Path | None = None) -> Loaded:
    """Import a strategy that the user has named; `InvalidArgumentError` if that is not possible.

    `digest` is that of the file as it has to be; None for the file as it is now. `path` is the file, where `name` has
    no folder.
    """
    place, _ = parted(name)
    if not is_in_file(place):
        if place not in _NAMED:
            with extra_named(f"The strategy {place}", "compactors"):
                make = _REGISTRY[place]
                versions_of(make)
            _NAMED[place] = Loaded(make)
        return _NAMED[place]
    return Loaded(*IN_FILES.load(place, digest, path))


def name_on_record(name: str) -> str:
    """Return the name of a strategy as records have it: that of a file without its folders."""
    place, _ = parted(name)
    if not is_in_file(place):
        return name
    return without_folders(place) + name.removeprefix(place)


def recorded_strategy(name: str, digest: str | None) -> Loaded:
    """Return the strategy that a record names, without importing a file for it; `digest` is that of its file.

    The file may have been moved; only its content matters.
    """
    place, _ = parted(name)
    if not is_in_file(place):
        if place not in {*_NAMED, *IMPORTED} and place in _REGISTRY and not packages_are_imported():
            raise InvalidArgumentError(f"{place} is a strategy of an installed package; --plugins imports it.")
        return load_strategy(name)
    return Loaded(*IN_FILES.recorded(place, digest))


def versions_of(strategy: object) -> dict[str, str]:
    """Return the versions of the packages that a strategy, an object or its class, is made of, for the record."""
    return {package: metadata.version(package) for package in getattr(strategy, "packages", ())}


def make_strategy(name: str, loaded: Loaded) -> Strategy | Compactor:
    """Return a new object of a strategy, with the options of its name, for one episode."""
    _, options = parted(name)
    try:
        made: Strategy | Compactor
        made = (
            FunctionCompactor(partial(loaded.make, **options)) if _is_function(loaded.make) else loaded.make(**options)
        )
    except SmartPlayError:
        raise
    except Exception as error:  # whatever the user's class does
        problem = f"{type(error).__name__}: {in_one_line(error)}"
        raise InvalidArgumentError(f"The strategy {name} cannot be made with these options: {problem}.") from error
    if chooses(made) == compacts(made):
        raise InvalidArgumentError(
            f"The strategy {name} needs one of two methods: choose(past, room), or compact(history, room)."
        )
    return made


@dataclass(frozen=True)
class FunctionCompactor:
    """The compactor that a function is: it is called with the history and the room."""

    compact: Callable[..., Any]


def _is_function(make: object) -> bool:
    """Whether a strategy is a plain or asynchronous function of a history and a room."""
    if not inspect.isfunction(make):
        return False
    required = [each for each in inspect.signature(make).parameters.values() if each.default is each.empty]
    return len([each for each in required if each.kind is each.POSITIONAL_OR_KEYWORD]) == 2


def chooses(strategy: object) -> bool:
    """Return whether a custom strategy, an object or its class, chooses turns."""
    return callable(getattr(strategy, "choose", None))


def compacts(strategy: object) -> bool:
    """Return whether a custom strategy, an object or its class, rewrites the history."""
    return _is_function(strategy) or callable(getattr(strategy, "compact", None))


def refused_with(strategy: object, budget: Budget) -> str | None:
    """Return why a custom strategy, an object or its class, cannot be combined with a budget; None if it can be."""
    if compacts(strategy) and budget.own_words is not None:
        return f"strategy={budget.strategy} rewrites old replies itself, so own_words would do nothing; leave it out."
    if chooses(strategy) and budget.question_tokens is not None:
        return f"strategy={budget.strategy} asks no questions, so question_tokens would do nothing; leave it out."
    return None


def parted(name: str) -> tuple[str, dict[str, Any]]:
    """Split a name such as `FILE.py:CLASS:turns=3,keep=1` into place and options; a value that is not JSON is text."""
    place, *given = BETWEEN_OPTIONS.split(name)
    pairs = [option.partition("=") for option in given]
    options = {key: value_in(value) for key, _, value in pairs}
    if len(options) < len(pairs) or "=" in place.rpartition(":")[2]:
        raise InvalidArgumentError(f"The options of the strategy {name} are KEY=VALUE, each key once.")
    return place, options
