"""Fits random conversations under random settings, and has every prompt judged.

    python -m tests.manager.fuzz --prompts 1000000 --seed 1 [--processes 2]

A conversation is fitted by a fresh manager, and by one that has been asked many others before: grown, changed in place,
cut at both ends. Prints how many prompts there were, and every fault.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import json
import random
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields
from typing import Any

import smartplay_tools as sp
from smartplay_tools.context import ContextOverflowError
from smartplay_tools.errors import PromptOverflowError
from tests.manager.histories import FORMS, KINDS, Messages, history
from tests.manager.judge import Letters, chosen, faults, total

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
        "result_tokens": rng.choice(["auto", "auto", None]),
        "own_words": rng.choice([None, None, 2]),
        "first_turns": rng.choice([None, None, 2]),
        "strategy": None,
    }
    if rng.random() < 0.3:
        options |= {"beyond_history": "drop", "first_turns": None, "strategy": rng.choice(STRATEGIES)}
        if options["strategy"] is not Chosen:
            options |= {"own_words": None, "question_tokens": QUESTION}
        return options
    is_at_every_step = not options["slack"] or (past and options["slack"] * past < 1)
    if not is_at_every_step and rng.random() < 0.4:
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
        rng = random.Random(f"{seed}:{number}")
        kind, form, cap, options = KINDS[number % 5], rng.choice([*FORMS]), rng.choice(CAPS), settings(rng)
        return cls(kind, form, cap, options, history(rng, kind, form), rng)

    @property
    def key(self) -> Any:
        return self.form, self.cap, *self.options.values()

    def manager(self, **asked: Any) -> sp.ContextManager:
        """A manager that was asked nothing; without `asked`, its strategy has a separate memo."""
        asked = asked or {"ask": ask, "memo": {}}
        asked = asked if self.options["strategy"] else {}
        return sp.ContextManager(self.cap, form=self.form, tokenizer=Letters(), **self.options, **asked)


def digests(numbers: Iterable[int], seed: int) -> dict[int, str]:
    """The digest of each conversation's prompt, where one manager for each settings is asked in this order."""
    used, found = dict[Any, sp.ContextManager](), dict[int, str]()
    for number in numbers:
        drawn = Drawn.of(number, seed)
        manager = used.setdefault(drawn.key, drawn.manager())
        found[number] = hashlib.sha256(repr(fitted(manager, drawn.given)).encode()).hexdigest()
    return found


def judged(number: int, seed: int, used: dict[Any, Any]) -> tuple[Counter[str], list[str]]:
    """Counts and faults of one conversation. `used` keeps the managers that have been asked before."""
    drawn, row, found = Drawn.of(number, seed), Counter[str](), list[str]()
    kind, form, cap, options, given, rng = (getattr(drawn, field.name) for field in fields(drawn))
    before = json.dumps(given)
    fresh = drawn.manager
    memo: Any = used.setdefault("memo", {})
    manager = used.setdefault(drawn.key, fresh(ask=ask, memo=memo))
    if number % 4 == 0:
        changed = copy.deepcopy(given)
        at = rng.randrange(len(changed))
        if isinstance(changed[at].get("content"), str):
            changed[at]["content"] = "changed"
        ends = sorted(rng.choices(range(1, len(given) + 1), k=3))
        others = [*(given[:end] for end in ends), changed, given[:2] + given[rng.randrange(2, len(given) + 1) :]]
        for other in others:
            row["asked before"] += 1
            if fitted(manager, other) != fitted(fresh(), other):
                found.append("another prompt from a manager that was asked before")
    prompt = fitted(fresh(), given)
    if prompt != fitted(manager, given):
        found.append("another prompt from a manager that was asked before")
    if options["strategy"] and prompt != fitted(fresh(ask=nobody, memo=memo), given):
        found.append("another prompt from another manager with the same memo")
    row["prompts"] += 1
    if isinstance(prompt, str):
        row[f"refused at {cap}"] += 1
    else:
        found += faults(form, given, before, prompt, cap, options)
        row["with summaries"] += bool(prompt.summary)
        row["with cuts"] += bool(prompt.cut)
        row["repaired"] += bool(prompt.repaired or prompt.made)
        row["by a strategy"] += options["strategy"] in STRATEGIES
        row["with rewritten messages"] += bool(prompt.rewritten)
        is_defined = options["strategy"] not in STRATEGIES and all(
            options[name] is None for name in ("result_tokens", "own_words", "first_turns")
        )
        if kind != "broken" and is_defined and not prompt.cut:
            row["compared with the definition"] += 1
            wanted = chosen(form, given, cap, options)
            if wanted != {source for source in prompt.sources if source is not None}:
                found.append(f"shows {prompt.sources}, and should show {sorted(wanted or ())}")
    return row, [f"{seed}:{number} {kind} {form} {cap} {options}: {fault}" for fault in found]


def some(first: int, stop: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Counts and faults of consecutive conversations."""
    rows, found, used = Counter[str](), list[str](), dict[Any, Any]()
    for number in range(first, stop):
        row, faulty = judged(number, seed, used)
        rows += row
        found += faulty
    return rows, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prompts", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    share = min(2_000, -(-options.prompts // options.processes))
    firsts = range(0, options.prompts, share)
    rows, found = Counter[str](), list[str]()
    with ProcessPoolExecutor(options.processes) as pool:
        tasks = [pool.submit(some, first, min(first + share, options.prompts), options.seed) for first in firsts]
        for task in tasks:
            row, faulty = task.result()
            rows += row
            found += faulty
    for name, count in sorted(rows.items()):
        print(f"{name:32}{count:>12,}")
    print(f"{'faults':32}{len(found):>12,}")
    for fault in found[:20]:
        print(fault)
    raise SystemExit(bool(found))


if __name__ == "__main__":
    main()
