"""The threads of context managers: which files are their records, and what each of them comes to.

A thread is the prompts of one conversation of an agent that plays no game. It has no score and no end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from smartplay_tools.costs.cached import Unit, same_and_stable
from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.manager.record import RecordedPrompt, RecordedThread, is_thread_record
from smartplay_tools.records.requests import Request, RequestLog

__all__ = ["thread_files", "thread_requests", "thread_row"]

COUNTED = ("dropped", "masked", "trimmed", "elided", "cut", "repaired")
"""What a row counts prompts by: those in which this became of a message."""


def thread_files(paths: Sequence[Path]) -> list[Path]:
    """Return the records of threads that files and folders are or hold; none where all of them are something else."""
    found = {path: _files(path) for path in paths}
    if others := [str(path) for path, files in found.items() if not files]:
        if len(others) < len(found):
            raise InvalidArgumentError(
                f"{', '.join(others)} holds no record of a context manager, unlike the others; show them apart."
            )
        return []
    return [*dict.fromkeys(file for files in found.values() for file in files)]


def _files(path: Path) -> list[Path]:
    if path.is_dir() and not (path / "manifest.json").exists():
        return [file for file in sorted(path.glob("*.jsonl")) if is_thread_record(file)]
    return [path] if path.is_file() and is_thread_record(path) else []


def thread_row(thread: RecordedThread) -> dict[str, Any]:
    """Return the figures of a thread, of which the provider's are None where it has reported none."""
    prompts = thread.prompts
    largest = max(prompts, key=lambda prompt: prompt.facts["tokens"], default=None)
    counted = [(prompt.reported, prompt.facts["tokens"]) for prompt in prompts if prompt.reported is not None]
    return {
        "thread": thread.path.stem,
        "prompts": len(prompts),
        "tokens": sum(prompt.facts["tokens"] for prompt in prompts),
        "largest": None if largest is None else largest.facts["tokens"],
        "cap": None if largest is None else largest.facts["cap"],
        "prefix_tokens": sum(prompt.facts["prefix_tokens"] for prompt in prompts),
        "refusals": len(thread.refusals),
        **{change: sum(1 for prompt in prompts if prompt.facts.get(change)) for change in COUNTED},
        "managed": sum(prompt.managed for prompt in prompts),
        "counted": len(counted),
        "over": sum(prompt.is_over for prompt in prompts),
        "ratio": sum(theirs for theirs, _ in counted) / max(1, sum(ours for _, ours in counted)) if counted else None,
        "most_above": max((theirs - ours for theirs, ours in counted), default=None),
    }


def thread_requests(thread: RecordedThread) -> RequestLog:
    """Return the requests of a thread as a provider's cache sees them; replies are not on record and cost nothing.

    Where the provider has counted prompts, all are counted in its tokens.
    """
    row = thread_row(thread)
    if not thread.prompts:
        raise TranscriptError(f"{thread.path} has no prompts, so nothing can be said about their cost.")
    if row["managed"]:
        raise TranscriptError(
            f"{thread.path} has prompts that the provider managed itself; what they cost is not known."
        )
    ratio = None if row["ratio"] is None else Fraction(row["ratio"]).limit_denominator(10**6)
    known: dict[Any, Unit] = {}
    prompts = [[*_units(prompt, known)] for prompt in thread.prompts]
    requests: list[Request] = []
    before: list[Unit] = []
    for at, (prompt, units) in enumerate(zip(thread.prompts, prompts, strict=True)):
        same, stable = same_and_stable(units, before)
        following = prompts[at + 1] if at + 1 < len(prompts) else []
        is_continued = len(following) > len(units) and following[: len(units)] == units
        answer = following[len(units)] if is_continued else Unit(-1 - at, 0, 1, is_system=False)
        ours = prompt.facts["tokens"]
        tokens = ours if ratio is None else ours * ratio.numerator // ratio.denominator
        tokens = tokens if prompt.reported is None else prompt.reported
        requests.append(Request(units, same, stable, "play", tokens, 0, answer, 0.0, None))
        before = units
    return RequestLog(requests, ratio)


def _units(prompt: RecordedPrompt, known: dict[Any, Unit]) -> Iterator[Unit]:
    """What is beside the messages as one unit, then each message; equal ones are the same object."""
    facts = prompt.facts
    rest = max(0, facts["tokens"] - sum(facts["costs"]))
    system: Mapping[str, Any] = {"role": "system"}
    parts = [(tuple(sorted(facts["beside"].items())), rest, system)]
    parts += zip(prompt.sent_parts, facts["costs"], prompt.messages, strict=True)  # type: ignore[arg-type]
    for number, tokens, message in parts:
        is_system = message.get("role") in ("system", "developer")
        yield known.setdefault((number, tokens), Unit(len(known), tokens, 1, is_system))
