"""Fits random conversations under random settings, and has every prompt judged.

    python -m tests.manager.fuzz --prompts 1000000 --seed 1

A conversation grows as that of an agent does, and one manager fits each of its prompts, those of other conversations
between them. Prints how many prompts there were, and every fault.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import random
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import smartplay_tools as sp
from smartplay_tools.context import ContextOverflowError
from smartplay_tools.errors import PromptOverflowError
from tests.manager.histories import FORMS, KINDS, Messages, history
from tests.manager.judge import Judge, Letters, kind as kind_of, total

CAPS = (400, 1_000, 2_000, 4_000, 8_000)
SUMMARY, QUESTION = 60, 700
"""The tokens of a summary, and of a question for one."""


def settings(rng: random.Random) -> dict[str, Any]:
    """Options of a manager."""
    past = rng.choice([None, None, 3, 8])
    options = {
        "slack": rng.choice([0, 0.25, 0.5, 0.75]),
        "history": past,
        "beyond_history": "drop" if past is None else rng.choice(["drop", "mask"]),
        "head": rng.choice(["task", "task", "system"]),
        "result_tokens": rng.choice(["auto", None]),
        "own_words": rng.choice([None, None, None, 2]),
        "first_turns": rng.choice([None, None, None, 2]),
        "strategy": None,
    }
    if rng.random() < 0.06:
        options |= {"beyond_history": "drop", "first_turns": None, "strategy": rng.choice(STRATEGIES)}
        if options["strategy"] is not Chosen:
            options |= {"own_words": None, "question_tokens": QUESTION}
        return options
    is_at_every_step = not options["slack"] or (past and options["slack"] * past < 1)
    if not is_at_every_step and rng.random() < 0.3:
        options["strategy"] = sp.Summaries(SUMMARY, question_tokens=QUESTION)
    return options


class Chosen:
    """Chooses turns by a digest of what they say, masks some and writes before one; remembers what it was asked."""

    def __init__(self) -> None:
        self.asked = 0

    def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
        self.asked += 1
        assert room is not None
        turns, masked = list[int](), list[int]()
        for turn in past.turns:
            said = hashlib.sha256(f"{self.asked} {turn.messages}".encode()).digest()[0]
            size = turn.masked_tokens if said % 2 else turn.tokens
            if turn.is_pinned or said < 60 or size > room:
                continue
            turns.append(turn.number)
            masked += [turn.number] * (said % 2)
            room -= size
        text = f"Before: {self.asked}"
        texts = {turns[-1]: text} if turns and past.text_tokens(text) <= room else {}
        return sp.Choice(turns, masked, texts)


class Rewritten:
    """Asks for a summary of what is older, once the messages are long, and keeps the newest."""

    persistent = True

    def compact(self, history: Any, room: Any) -> Any:
        messages = [*history]
        if room.count(messages) < 0.7 * room.tokens:
            return messages
        kept = messages[-5:]
        while kept and kept[0]["role"] == "tool":
            kept = kept[1:]
        kept = kept or messages[-1:]
        try:
            answer = yield [{"role": "user", "content": f"Summarize: {str(messages)[:1_500]}"}]
        except ContextOverflowError:
            return messages
        return [{"role": "user", "content": f"So far: {answer['content'][:200]}"}, *whole(messages, kept)]


def whole(messages: Any, kept: Any) -> Any:
    """The messages that are kept, with the call of a result that would be without it."""
    return messages if kept[0]["role"] == "tool" else kept


def cleared(history: Any, room: Any) -> Any:
    """Clears the results but the newest, and the words of every third reply."""
    changed = []
    for at, message in enumerate(history):
        own = {**message}
        if message["role"] == "tool" and at < len(history) - 5:
            own["content"] = "[cleared]"
        elif message["role"] == "assistant" and at % 3 == 0 and message.get("tool_calls"):
            own["content"] = "shorter"
        changed.append(own)
    return changed


STRATEGIES: list[Any] = [Chosen, Rewritten, cleared]
"""A strategy that chooses turns, a compactor that asks, and a function that clears results."""


def ask(messages: Messages, max_tokens: int) -> str:
    """A model that writes summaries, some of them too long: what it is asked decides what it writes."""
    assert total("chat", messages) <= QUESTION, "a question is over its cap"
    digest = hashlib.sha256(messages[-1]["content"].encode()).hexdigest()
    return f"{len(messages[-1]['content'])} letters: {digest * (1 + 9 * (digest < '4'))}"


def nobody(messages: Messages, max_tokens: int) -> str:
    raise AssertionError("the memo has no summary of what was summarised before")


def fitted(manager: sp.ContextManager, messages: Messages) -> sp.FittedPrompt | str:
    """A prompt, or the sentence of its refusal."""
    try:
        return manager.fit(messages)
    except PromptOverflowError as error:
        return str(error)


TOGETHER = 4
"""How many conversations one manager fits, in turn."""


@dataclass(frozen=True)
class Drawn:
    """A random conversation, and the settings under which it is fitted."""

    kind: str
    form: str
    cap: int
    options: dict[str, Any]
    given: Messages
    rng: random.Random

    @classmethod
    def of(cls, number: int, seed: int) -> Drawn:
        shared, rng = random.Random(f"{seed}:{number // TOGETHER}"), random.Random(f"{seed}:{number}:own")
        kind, form, cap, options = KINDS[number % 5], shared.choice([*FORMS]), shared.choice(CAPS), settings(shared)
        return cls(kind, form, cap, options, history(rng, kind, form), rng)

    def manager(self, **asked: Any) -> sp.ContextManager:
        """A manager that was asked nothing; without `asked`, its strategy has a separate memo."""
        asked = asked or {"ask": ask, "memo": {}}
        asked = asked if self.options["strategy"] else {}
        return sp.ContextManager(self.cap, form=self.form, tokenizer=Letters(), **self.options, **asked)

    @property
    def ends(self) -> list[int]:
        """The lengths at which a request is made: before each reply, at the end, and where an agent is interrupted."""
        kinds = [kind_of(self.form, message) for message in self.given]
        replies = [at for at in range(2, len(kinds)) if kinds[at] == "reply" != kinds[at - 1]]
        return sorted({*replies, len(kinds), *self.rng.choices(range(1, len(kinds)), k=2)})


def digests(numbers: Iterable[int], seed: int) -> dict[int, str]:
    """The digest of each conversation's prompt, where one manager for each settings is asked in this order."""
    used, found = dict[int, sp.ContextManager](), dict[int, str]()
    for number in numbers:
        drawn = Drawn.of(number, seed)
        manager = used.setdefault(number // TOGETHER, drawn.manager())
        found[number] = hashlib.sha256(repr(fitted(manager, drawn.given)).encode()).hexdigest()
    return found


class Asked:
    """Conversations that one manager fits, in turn, as they grow; every prompt is judged.

    That a prompt is the same from a manager that was asked nothing, from one with the memo alone, and after others of
    the conversation, changed in place and cut at both ends, is seen at a drawn part of the prompts.
    """

    def __init__(self, first: int, seed: int) -> None:
        self.drawn = {number: Drawn.of(number, seed) for number in range(first, first + TOGETHER)}
        self.seed, self.rows, self.found = seed, Counter[str](), list[str]()
        self._memo: dict[str, str] = {}
        self._manager = self.drawn[first].manager(ask=ask, memo=self._memo)

    def judge(self) -> None:
        """Fit and judge all prompts; the shortest conversations come first."""
        judges = {n: Judge(each.form, each.given, each.cap, each.options) for n, each in self.drawn.items()}
        requests = sorted((end, number) for number, each in self.drawn.items() for end in each.ends)
        for end, number in requests:
            self._judge(number, end, judges[number])
        for number, judge in judges.items():
            self._name(number, judge.changed())

    def _name(self, number: int, faults: Iterable[str]) -> None:
        each = self.drawn[number]
        where = f"{self.seed}:{number} {each.kind} {each.form} {each.cap} {each.options}"
        self.found += [f"{where}: {fault}" for fault in faults]

    def _judge(self, number: int, end: int, judge: Judge) -> None:
        drawn, row = self.drawn[number], self.rows
        given = drawn.given[:end]
        if is_drawn := drawn.rng.random() < 0.05:
            self._ask_others(number, given)
        prompt = fitted(self._manager, given)
        row["prompts"] += 1
        if is_drawn:
            self._compare(number, given, prompt)
        if isinstance(prompt, str):
            row[f"refused at {drawn.cap}"] += 1
            return
        self._name(number, judge.faults(end, prompt))
        row["of fewer messages"] += bool(prompt.dropped)
        row["with summaries"] += bool(prompt.summary)
        row["with cuts"] += bool(prompt.cut)
        row["repaired"] += bool(prompt.repaired or prompt.made)
        row["by a strategy"] += drawn.options["strategy"] in STRATEGIES
        row["rewritten"] += bool(prompt.rewritten)
        if drawn.kind != "broken" and judge.is_defined and not (prompt.cut or prompt.made):
            row["compared with the definition"] += 1
            wanted = judge.chosen(end)
            if wanted != {source for source in prompt.sources if source is not None}:
                self._name(number, [f"shows {prompt.sources}, and should show {sorted(wanted or ())}"])

    def _ask_others(self, number: int, given: Messages) -> None:
        """Ask the manager for other prompts of the conversation, and compare them with those of a new one."""
        drawn, changed = self.drawn[number], copy.deepcopy(given)
        rng = drawn.rng
        at = rng.randrange(len(changed))
        if isinstance(changed[at].get("content"), str):
            changed[at]["content"] = "changed"
        others = [changed, given[: rng.randrange(1, len(given) + 1)], given[:2] + given[rng.randrange(len(given)) :]]
        for other in others:
            self.rows["asked before"] += 1
            if fitted(self._manager, other) != fitted(drawn.manager(), other):
                self._name(number, ["another prompt from a manager that was asked before"])

    def _compare(self, number: int, given: Messages, prompt: sp.FittedPrompt | str) -> None:
        drawn = self.drawn[number]
        self.rows["made again by a new manager"] += 1
        if prompt != fitted(drawn.manager(), given):
            self._name(number, ["another prompt from a manager that was asked before"])
        if drawn.options["strategy"] and prompt != fitted(drawn.manager(ask=nobody, memo=self._memo), given):
            self._name(number, ["another prompt from another manager with the same memo"])


def some(first: int, stop: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Counts and faults of consecutive conversations."""
    rows, found = Counter[str](), list[str]()
    for number in range(first, stop, TOGETHER):
        asked = Asked(number, seed)
        asked.judge()
        rows += asked.rows
        found += asked.found
    return rows, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prompts", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows, found, number = Counter[str](), list[str](), 0
    while rows["prompts"] < options.prompts:
        row, faulty = some(number, number + TOGETHER, options.seed)
        rows, number = rows + row, number + TOGETHER
        found += faulty
    rows["conversations"] = number
    for name, count in sorted(rows.items()):
        print(f"{name:32}{count:>12,}")
    print(f"{'faults':32}{len(found):>12,}")
    for fault in found[:20]:
        print(fault)
    raise SystemExit(bool(found))


if __name__ == "__main__":
    main()
