"""EpisodeStats: the counters of an episode, computed from its events one by one.

A live episode, a replay and a reader of records count with the same code, so their counts agree. The counters have the
names of the fields of `EpisodeResult`.

`Stalls` counts the turns in a row that have shown the model nothing new. Such a turn plays no step and shows nothing
new: it has no call, or each of its calls is a mistake, was refused, or repeats what the model has seen. A model in such
a state rarely leaves it, but would go on until its calls are spent; `Budget.stalled_turns` ends the episode.
`docs/budgets.md` is the exact definition.
"""

from __future__ import annotations

import functools
import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from importlib import metadata
from typing import Any, Self

from smartplay_tools.transcript.events import purpose_of
from smartplay_tools.types import TOOL_NAMES, Tokens, Usage
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import calls_of

RECORDED_PACKAGES = ("smartplay-tools", "gymnasium", "numpy", "tiktoken")
"""The packages that can change how an episode runs or is counted."""

UNANSWERED = ("over", "host")
"""Mistakes of calls that the game did not answer: those after the end, and those that the host refused."""


SUMMED = tuple(name for name in Tokens.model_fields if name != "provider")
"""The fields of `Tokens` that are sums of our counts. They are numbers here: a new model every turn takes longer."""


class Stalls:
    """Counts the turns in a row that showed nothing new; the latest turn counts as if it were complete."""

    def __init__(self) -> None:
        self._before = 0
        """The turns in a row before the latest."""
        self._turn = -1
        self._is_new = self._is_foreign = True
        """Whether the latest turn has shown something new, and whether it has the result of a foreign tool."""
        self._observation = -1
        self._manual_was_read = False
        self._sent: dict[str, str] = {}
        """The latest arguments that each of the strategies' tools has accepted."""

    @property
    def in_a_row(self) -> int:
        """How many turns in a row have shown nothing new."""
        if self._is_new:
            return 0
        return self._before + (not self._is_foreign)

    def open(self, turn: int) -> None:
        """Begin a turn, unless it is the latest."""
        if turn != self._turn:
            self._before, self._turn = self.in_a_row, turn
            self._is_new = self._is_foreign = False

    def answer(self, call: Mapping[str, Any]) -> None:
        """Take note of the answer to a call."""
        self.open(call["turn"])
        if not call["is_error"] and self._shows_something_new(call):
            self._is_new = True

    def answer_foreign(self) -> None:
        """Take note of the result of a foreign tool."""
        self._is_foreign = True

    def _shows_something_new(self, call: Mapping[str, Any]) -> bool:
        """Whether an answer is a step, the first reading of the manual, or anything else that was not shown before."""
        name, data = call["name"], call["data"]
        if (step := data.get("observation_step")) is not None:
            is_new, self._observation = step > self._observation, max(self._observation, step)
            return is_new or "reward" in data
        if data.get("manual"):
            was_read, self._manual_was_read = self._manual_was_read, True
            return not was_read
        if name in TOOL_NAMES:
            return False
        sent, self._sent[name] = self._sent.get(name), read(call["arguments"]).canonical
        return sent != self._sent[name]


@dataclass
class EpisodeStats:
    """Counters of an episode; the names are those of `EpisodeResult`."""

    steps: int = 0
    turns: int = 0
    reward: float = 0.0
    tool_calls: int = 0
    illegal_actions: int = 0
    malformed_calls: int = 0
    refused_calls: int = 0
    idle_replies: int = 0
    fallback_actions: int = 0
    cut_results: int = 0
    refused_notes: int = 0
    refused_memory: int = 0
    recalls: int = 0
    pages: int = 0
    summaries: int = 0
    cut_summaries: int = 0
    empty_summaries: int = 0
    over_prompts: int = 0
    over_peak: int = 0
    rewrites: int = 0
    questions: int = 0
    refused_questions: int = 0
    blind_prompts: int = 0
    spent_cost: float = 0.0
    unusable_usages: int = 0
    _sums: dict[str, int] = field(default_factory=lambda: dict.fromkeys(SUMMED, 0))
    _provider: Usage | None = None
    _stalls: Stalls = field(default_factory=Stalls, repr=False, compare=False)

    @property
    def tokens(self) -> Tokens:
        """The tokens charged so far."""
        return Tokens(**self._sums, provider=self._provider)

    @property
    def stalled(self) -> int:
        """How many turns in a row, the latest included, have shown nothing new."""
        return self._stalls.in_a_row

    @classmethod
    def of(cls, events: Iterable[Mapping[str, Any]]) -> Self:
        """Return the counters of a record."""
        stats = cls()
        for event in events:
            stats.apply(event)
        return stats

    def apply(self, event: Mapping[str, Any]) -> None:
        """Count an event."""
        match event["event"]:
            case "call":
                self._count_call(event)
                self._stalls.answer(event)
            case "message" if event["by"] == "player":
                self.turns = event["turn"] + 1
                self._stalls.open(event["turn"])
            case "message":
                self.idle_replies += event["by"] == "library"
                if "position" in event:
                    self._stalls.answer_foreign()
            case "usage":
                self._charge(event)
            case "summary":
                self.summaries += 1
                self.cut_summaries += event["cut"]
                self.empty_summaries += event["empty"]
                self.refused_calls += len(calls_of(event["message"]))
            case "question":
                self.questions += 1
                self.refused_questions += event["reply"] is None
                self.refused_calls += len(calls_of(event["reply"] or {}))
            case "rewrite":
                self.rewrites += event["messages"] is not None
                self.blind_prompts += event["blind"]
                if event["over"]:
                    self.over_prompts += 1
                    self.over_peak = max(self.over_peak, event["tokens"])
            case "sent":
                self._sums["prompt"] += event["tokens"]
                self._sums["reply"] += event["reply"]
                self.over_prompts += event["over"]
            case "choice":
                self.fallback_actions += event["fallback"]
            case "start" | "head":
                self.cut_results += event.get("cut_results", 0)

    def counts(self) -> dict[str, Any]:
        """Return the counters by name."""
        return {**{name: getattr(self, name) for name in COUNTERS}, "tokens": self.tokens}

    def _count_call(self, event: Mapping[str, Any]) -> None:
        data = event["data"]
        mistake = data.get("mistake")
        self.turns = max(self.turns, event["turn"] + 1)
        self.tool_calls += mistake not in UNANSWERED
        if mistake is not None:
            self.illegal_actions += mistake == "illegal"
            self.malformed_calls += mistake == "malformed"
            self.refused_calls += mistake == "refused" or mistake in UNANSWERED
            self.refused_notes += mistake == "notes"
            self.refused_memory += mistake == "memory"
        self.recalls += "recalled" in data
        self.pages += "page" in data
        self.cut_results += event["cut"]
        if "reward" in data:
            self.steps += 1
            self.reward += data["reward"]

    def _charge(self, event: Mapping[str, Any]) -> None:
        if event["provider"] is not None:
            usage = Usage.reported(event)
            if usage is None:
                self.unusable_usages += 1
            else:
                self._provider = usage if self._provider is None else self._provider + usage
        self.spent_cost = event.get("spent", self.spent_cost)
        sums, prompt, reply = self._sums, event.get("prompt", 0), event.get("reply", 0)
        sums["prompt"] += prompt
        sums["reply"] += reply
        sums["prefix"] += event.get("prefix", 0)
        sums["overruns"] += event.get("overrun", False)
        sums["texts"] += event.get("texts", 0)
        if (purpose := purpose_of(event)) != "play":
            kind = "summary" if purpose == "summary" else "question"
            sums[f"{kind}_prompt"] += prompt
            sums[f"{kind}_reply"] += reply


COUNTERS = tuple(each.name for each in fields(EpisodeStats) if not each.name.startswith("_"))


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of what can change how an episode runs or is counted."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in RECORDED_PACKAGES}}
