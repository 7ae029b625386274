"""What a trial of a chain takes over from the one before it: docs/evaluation.md, from the calls on record alone."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.audit import audit
from smartplay_tools.transcript import Event
from smartplay_tools.types import ResolvedBudget

from .counting import PRIMING, Counting, read_object
from .cutting import cut
from .files import Files
from .play import FOREIGN, OPEN, TOOLED, random_budget
from .refusals import in_numbers, is_refused
from .replies import Speaker

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "MessengerL1-v0")
AGAIN = "You have played this game before, in another world."
RESULT, NOTES = "The last result there was:\n", "Your notes at its end were:\n"


class Restless:
    """Answers at random, right and wrong."""

    name = "restless"

    def __init__(self, *, seed: int) -> None:
        self._rng = random.Random(seed)
        self._speaker: Speaker | None = None

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        """Draw a reply."""
        if self._speaker is None:
            self._speaker = Speaker(self._rng, prompt.tools, ("1", "2", "Rock", "Paper", "Stay"), FOREIGN.name)
        message: Any = self._speaker.reply() if prompt.purpose == "play" else self._speaker.summary()
        return sp.Reply(message)


@dataclass
class Left:
    """What a trial leaves."""

    result: str | None = None
    notes: str | None = None
    files: Mapping[str, str] = field(default_factory=dict)

    def after(self, record: Sequence[Event], n: Counting) -> Left:
        """Return what a trial leaves that began with this."""
        notes, result, files = self.notes, None, Files(10**9, n.text)
        files.texts = dict(self.files)
        for call in (event for event in record if event["event"] == "call"):
            if call["data"].get("mistake") == "over":
                continue
            result = call["text"]
            if not call["is_error"] and call["name"] in ("take_notes", "memory"):
                values = read_object(call["arguments"])
                assert values is not None
                if call["name"] == "memory":
                    files.call(values)
                else:
                    notes = values["text"] if values["text"].strip() else None
        return Left(result, notes, files.texts)

    def message(self, carry: str, longest: int | None, n: Counting) -> sp.Message:
        """Return what the next trial is told; `longest` is None without a cap on prompts."""
        notes = self.notes if carry == "notes" else None

        def message_with(result: str | None) -> sp.Message:
            parts = [AGAIN]
            parts += [] if result is None else [RESULT + result]
            parts += [] if notes is None else [NOTES + notes]
            return {"role": "user", "content": "\n\n".join(parts)}

        whole = message_with(self.result)
        if self.result is None or longest is None or n.message(whole) <= longest:
            return whole
        around = Counting(lambda text: n.message(message_with(text)), n.picture)
        return message_with(cut(self.result, longest, around.text))


def longest_message(carry: str, budget: ResolvedBudget, n: Counting) -> int:
    """Return the tokens that are reserved for what a trial is told."""
    caps = [cap for cap in (budget.result_tokens, budget.manual_tokens, budget.recall_tokens) if cap is not None]
    empty = n.message(Left("", "").message(carry, None, n))
    return empty + max(caps, default=0) + ((budget.notes_tokens or 0) if carry == "notes" else 0)


def play_chains(seed: int, out: Path) -> int:
    """Play chains under a random budget, and compare what each trial begins with; return how many were carried to.

    A budget is refused exactly where it should be, and every record replays.
    """
    rng = random.Random(seed)
    game, carry = rng.choice(GAMES), rng.choice(("notes", "memory"))
    probe = sp.Episode(game, seed=seed)
    n = Counting(probe.counter.text, probe.counter.image)
    head = n.messages(probe.head) + n.tools(probe.tools)
    limits = random_budget(rng, head + PRIMING, "text")
    limits.pop("strategy", None)
    limits |= {"notes_tokens": rng.choice((5, 40))} if carry == "notes" else {"memory_tokens": rng.choice((20, 200))}
    budget, spec = sp.Budget(**limits), sp.GAMES[game]
    numbers = in_numbers(budget, spec, head, 0)
    tooled = {name: limits[name] for name in TOOLED if name in limits}
    tools = sp.Episode(game, seed=seed, budget=sp.Budget(**tooled | OPEN)).tools
    capped = budget.prompt_tokens is not None
    longest = longest_message(carry, numbers, n) if capped else 0
    refused = is_refused(numbers, n, probe.head, tools, 0, "text", longest)
    refused |= capped and numbers.result_tokens is None
    options: dict[str, Any] = {"trials": 4, "chain": rng.choice((2, 4)), "carry": carry, "seed": seed}
    where = f"seed {seed}, {game}, {limits}, {options}"
    try:
        run = sp.evaluate([game], {"restless": Restless}, budgets=budget, out=out, executor="inline", **options)
    except sp.InvalidArgumentError as error:
        if not refused:
            raise AssertionError(f"{where}: refused") from error
        return 0
    assert not refused, f"{where}: not refused"
    before, carried = Left(), 0
    for row in run.rows:
        record = sp.read_transcript(run.transcript(row["key"]))
        messages = next(event for event in record if event["event"] == "head")["messages"]
        if row["trial"] % options["chain"] == 0:
            before = Left()
            assert messages == list(probe.head), where
        else:
            carried += 1
            carried_message = before.message(carry, longest if capped else None, n)
            assert messages == [*probe.head, carried_message], f"{where}: {messages[-1]}, expected {carried_message}"
            files = record[0]["carried"].get("files") or {}
            assert files == (before.files if carry == "memory" else {}), f"{where}: {files}, {before.files}"
        before = before.after(record, n)
    assert not any(finding.differences for finding in audit(run.folder, 1)), where
    return carried
