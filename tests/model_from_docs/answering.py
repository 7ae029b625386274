"""What every call of a reply must be answered, from its arguments and the game."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import smartplay_tools as sp

from .counting import Counting, read_object
from .cutting import Pages, cut, cut_manual
from .files import Answer, Files
from .recalling import answer
from .turns import Turn

OVER = "\nThe game is over."
PICTURE = "The picture shows the current observation."
IN_HEAD = "The manual stands at the end of the system message."
NO_MANUAL = "There is no manual for this game."


@dataclass
class Totals:
    """What the counters of the episode must say."""

    prompt: int = 0
    reply: int = 0
    prefix: int = 0
    overruns: int = 0
    summary_prompt: int = 0
    summary_reply: int = 0
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, name: str, number: int = 1) -> None:
        """Count."""
        self.counts[name] = self.counts.get(name, 0) + number


class Answering:
    """A game, the tools around it, and what has been answered so far."""

    def __init__(self, game: sp.TextGame, seed: int, facts: Mapping[str, Any], n: Counting) -> None:
        """`facts` are what an episode has beside its game: head, tools, budget in numbers, rollout, manual, batch,
        observation, and the tokens of its picture.
        """
        self.game, self.facts, self.n, self.budget = game, facts, n, facts["budget"]
        game.reset(seed=seed)
        self.head: list[sp.Message] = list(facts["head"])
        self.tools: tuple[sp.ToolSpec, ...] = facts["tools"]
        self.totals = Totals()
        self.steps, self.tool_calls = 0, 0
        self.observed: dict[int, tuple[str, str]] = {}  # the first result of each observation, and its call
        self.manual: str | None = None
        if facts["manual"] == "pinned":
            self.manual = cut_manual(game.manual, self.budget.manual_tokens, n.text)
            self.totals.add("cut_results", self.manual != game.manual)
        self.end: str | None = None
        self.accepted: dict[str, Any] = {}
        self.pages = Pages(self.budget.result_tokens, n.text)
        self.files = Files(self.budget.memory_tokens or 0, n.text)

    def _is_error(self, result: sp.ToolResult) -> bool:
        """Whether a result is an error within its cap, in words that the documentation leaves open."""
        cap = self.budget.result_tokens
        is_cut = re.search(r"\[[0-9]+ tokens cut\]\Z", result.text) is not None or not result.text
        self.totals.add("cut_results", is_cut)
        is_within = cap is None or self.n.text(result.text) <= cap
        return result.is_error and is_within and (result.text.startswith("Error: ") or is_cut)

    def _cut(self, text: str, cap: int | None) -> str:
        """Cut a result that is not an observation, and count it."""
        shown = cut(text, cap, self.n.text)
        self.totals.add("cut_results", shown != text)
        return shown

    def _answer(
        self, turn: Turn, name: str, text: str, documents: Mapping[int, str], is_refused: bool
    ) -> tuple[Answer, int | None, int | None, bool]:
        """The answer that a call must have, its date, the observation that it shows, and whether it is anything new."""
        if self.end is not None:
            self.totals.add("refused_calls")
            return Answer(None, "refused"), None, None, False
        self.tool_calls += 1
        try:
            return self._answer_running(turn, name, read_object(text), documents, is_refused)
        finally:
            if self.end is None and self.tool_calls == self.budget.tool_calls:
                self.end = "tool_calls"

    def _answer_running(
        self, turn: Turn, name: str, values: dict[str, Any] | None, documents: Mapping[int, str], is_refused: bool
    ) -> tuple[Answer, int | None, int | None, bool]:
        n, cap = self.n.text, self.budget.result_tokens
        names = {tool.name for tool in self.tools}
        field = {"act": "action", "take_notes": "text", "recall": "query", "read_result": "page"}.get(name)
        is_well_formed = name in names and values is not None
        if is_well_formed and name != "memory":
            assert values is not None
            is_well_formed = not values if field is None else [*values] == [field] and isinstance(values[field], str)
        if not is_well_formed:
            self.totals.add("malformed_calls")
            return Answer(None, "malformed"), None, None, False
        assert values is not None
        value = "" if field is None or name == "memory" else values[field]
        is_same = self.accepted.get(name) == values
        if name == "act":
            return self._act(turn, value, is_refused)
        if name == "observe":
            return self._observe(self.steps, "observe()", self.game.observation)
        if name == "read_manual":
            if self.facts["manual"] == "none":
                return Answer(self._cut(NO_MANUAL, cap)), None, None, False
            if self.facts["manual"] == "pinned":
                return Answer(self._cut(IN_HEAD, cap)), None, None, False
            text, is_new = cut_manual(self.game.manual, self.budget.manual_tokens, n), self.manual is None
            if is_new:
                self.manual = text
                first = self.head[0]
                self.head = [{**first, "content": f"{first['content']}\n\n{text}"}, *self.head[1:]]
            self.totals.add("cut_results", text != self.game.manual)
            return Answer(text), None, None, is_new
        if name == "take_notes":
            limit = self.budget.notes_tokens
            if n(value) > limit:
                self.totals.add("refused_notes")
                words = f"Error: These notes have {n(value)} tokens, more than {limit}. The earlier notes stand."
                return Answer(self._cut(words, cap), "notes"), None, None, False
            turn.notes = value if value.strip() else ""
            self.accepted[name] = values
            return Answer(self._cut(f"Noted: {n(value)} of {limit} tokens.", cap)), None, None, not is_same
        if name == "recall":
            self.totals.add("recalls")
            self.accepted[name] = values
            matches, is_cut = answer(value, documents, self.budget.recall_tokens, n)
            self.totals.add("cut_results", is_cut)
            return Answer(matches), max(self.observed, default=0), None, not is_same
        if name == "read_result":
            page = self.pages.read(value)
            if page is None:
                self.totals.add("malformed_calls")
                return Answer(None, "malformed"), None, None, False
            self.totals.add("pages")
            self.accepted[name] = values
            return Answer(page), max(self.observed, default=0), None, not is_same
        outcome = self.files.call(values)
        if outcome.kind == "malformed":
            self.totals.add("malformed_calls")
            return outcome, None, None, False
        self.totals.add("refused_memory", outcome.kind == "memory")
        if not outcome.kind:
            self.accepted[name] = values
        assert outcome.text is not None
        return Answer(self._cut(outcome.text, cap), outcome.kind), None, None, not outcome.kind and not is_same

    def _act(self, turn: Turn, value: str, is_refused: bool) -> tuple[Answer, int | None, int | None, bool]:
        names = [action.lower().removesuffix(".") for action in self.game.actions]
        act = next(tool for tool in self.tools if tool.name == "act")
        listed = re.findall(r"^([0-9]+)\. (.+?)\.?$", act.description.lower(), re.MULTILINE)
        numbered = {int(number): name for number, name in listed}
        wanted = value.strip().removesuffix(".").lower()
        number = re.fullmatch(r"([0-9]+)(?:\. +(.+))?", wanted)
        if number and (name := numbered.get(int(number[1]))) and number[2] in (None, name):
            wanted = name
        action = names.index(wanted) if wanted in names else -1
        if action < 0:
            self.totals.add("illegal_actions")
            return Answer(None, "illegal"), None, None, False
        if is_refused:
            self.totals.add("refused_calls")
            return Answer(None, "refused"), None, None, False
        text, _, terminated, truncated, _ = self.game.step(action)
        self.steps += 1
        turn.plays = True
        if terminated or truncated:
            self.end = "terminated"
        elif self.steps == self.facts["rollout"]:
            self.end = "rollout"
        if self.end is not None:
            text += OVER
        return self._observe(self.steps, f'act("{value.strip()}")', text)

    def _observe(self, step: int, call: str, text: str) -> tuple[Answer, int | None, int | None, bool]:
        picture, cap = self.facts["picture"], self.budget.result_tokens
        if self.facts["observation"] == "picture":
            text = PICTURE + (OVER if text.endswith(OVER) else "")
        if self.budget.beyond_result == "offload":
            shown = self.pages.offload(text, picture)
        else:
            shown = cut(text, None if cap is None else cap - picture, self.n.text)
        self.totals.add("cut_results", shown != text)
        is_new = step not in self.observed
        self.observed.setdefault(step, (shown, call))
        return Answer(shown), step, step, is_new
