"""The check of one record: it is replayed, its row computed anew, and its prompts compared with its budget.

It runs in its own process (`check`), under limits of time and memory. Whatever a hostile record makes go
wrong is a finding, not a traceback.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_args

from pydantic import Field, TypeAdapter

from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.errors import SmartPlayError, in_one_line
from smartplay_tools.evaluation.board.submissions.bundle import Finding, error, remark, some
from smartplay_tools.evaluation.board.submissions.metadata import Name
from smartplay_tools.records.driver import EXTERNAL_ENDS
from smartplay_tools.records.prices import Price
from smartplay_tools.records.record import EXCEPTION, INTERRUPTED, Record
from smartplay_tools.records.replays import replay_record
from smartplay_tools.records.resumption import chain_fault
from smartplay_tools.records.rows import LATER, Row, row_of
from smartplay_tools.transcript.file import broken_links
from smartplay_tools.transcript.hashing import event_line
from smartplay_tools.types import EndReason, EpisodeResult, Usage
from smartplay_tools.types.arguments import canonical_text
from smartplay_tools.types.messages import Message, calls_of

SHOWN_DIFFERENCES = 3
"""Of a record that plays differently; the first is what matters, the others mostly follow from it."""

MOST_FINDINGS = 20
"""Errors, and remarks, of one record: a hostile one could have any number."""

MOST_COST = 1e6
"""US dollars of an episode."""

ENDS = frozenset((*get_args(EndReason), EXCEPTION, INTERRUPTED))
"""How an attempt can end."""

VERSIONS = TypeAdapter(Annotated[dict[Name, Name], Field(max_length=50)])
"""What the versions in a record look like."""

Say: TypeAlias = Callable[[str, str], Finding]
"""Makes a finding that is an error in a standard submission, and a remark in a custom one."""


@dataclass(frozen=True)
class RecordJob:
    """A record to check, and what it should be."""

    record: Path
    config: EpisodeConfig
    trial: int
    row: bytes | None
    """Its line of the results; None if there is none."""
    price: Price | None
    attempts: tuple[Path, ...]
    """Records of earlier attempts at the same episode."""
    before: Path | None
    """The record of the trial that it takes something over from."""
    tokenizer: str | None
    standard: bool
    """Whether prompts have to be the library's own."""


@dataclass
class CheckedRecord:
    """What was found in a record."""

    findings: list[Finding] = field(default_factory=list)
    row: Row | None = None
    """Its row, computed from the record; None if it does not replay."""
    replies: int = 0
    prompts: int = 0
    """Prompts that were rebuilt and have the recorded sha256."""
    calls: int = 0
    provider: bool = False
    """Whether a provider's count of tokens is on record."""
    versions: dict[str, str] = field(default_factory=dict)
    attempts: list[str] = field(default_factory=list)
    """Why each earlier attempt has no result."""


def check_record(job: RecordJob) -> CheckedRecord:
    """Check one record; nothing that is in it raises."""
    checked = CheckedRecord()
    counts: Counter[str] = Counter()
    try:
        for finding in _check(job, checked):
            counts[finding.level] += 1
            checked.findings += [finding] if counts[finding.level] <= MOST_FINDINGS else []
    except SmartPlayError as fault:
        checked.findings.append(error("record", _of_bundle(str(fault), job.record)))
    except MemoryError:
        raise
    except Exception as fault:  # a hostile record may reach any part of the game with any value
        what = f"{type(fault).__name__}: {in_one_line(fault)}"
        checked.findings.append(error("record", f"The record cannot be replayed: {_of_bundle(what, job.record)}."))
    for level, count in counts.items():
        if count > MOST_FINDINGS:
            text = f"There are {count - MOST_FINDINGS:,} more of these in this record."
            checked.findings.append((error if level == "error" else remark)("record", text))
    if any(finding.level == "error" for finding in checked.findings):
        checked.row = None
    checked.findings = [replace(finding, key=job.config.key) for finding in checked.findings]
    return checked


def _of_bundle(text: str, record: Path) -> str:
    """Name a file as it is called in the bundle, not where it was unpacked."""
    return text.replace(f"{record.parent.parent}/", "")


def _check(job: RecordJob, checked: CheckedRecord) -> Iterator[Finding]:
    record = Record.read(job.record, {job.config.player or "": job.price} if job.price else {})
    if record.config != job.config:
        config = record.config
        names = [name for name in type(config).model_fields if getattr(config, name) != getattr(job.config, name)]
        yield error("record", f"The record is of another episode than the manifest says: {some(names)} differ.")
        return
    played = replay_record(record, tokenizer=job.tokenizer)
    for difference in played.differences[:SHOWN_DIFFERENCES]:
        yield error("record", difference)
    if len(played.differences) > SHOWN_DIFFERENCES:
        yield error("record", f"{len(played.differences) - SHOWN_DIFFERENCES} more differences in this record.")
    if played.not_compared is not None:
        yield remark("record", played.not_compared)
    if not record.is_complete:
        yield error("record", "The record breaks off: it does not say how the episode ended.")
    if played.result is None:
        return
    if b"".join(event_line(event) + b"\n" for event in record.events) != record.written:
        yield error("record", "The record is not written as this library writes it.")
    if fault := chain_fault(record, job.before):
        yield error("record", fault)
    say = error if job.standard else remark
    yield from _check_host(record, say, has_host_part=played.has_host_part)
    yield from _check_budget(record)
    _count(record, checked)
    if record.outcome != "finished":
        yield error("record", f"The record is not a finished episode: it ended as {record.end_reason}.")
        return
    yield from _check_end(record, say)
    checked.row = row_of(record, job.trial)
    yield from _check_row(job.row, checked.row)
    yield from _check_deviations(record, played.result, checked.row)
    continued: set[str] = set()
    yield from _check_attempts(job, record, checked, continued)
    yield from _check_continuations(record, continued)


def _count(record: Record, checked: CheckedRecord) -> None:
    checked.replies = len(_replies(record))
    checked.prompts = len(record.views)
    checked.calls = len(record.calls)
    reported = filter(None, map(Usage.reported, record.usages))
    checked.provider = any(usage.has_tokens for usage in reported)
    checked.versions = record.versions


def _check_host(record: Record, say: Say, *, has_host_part: bool) -> Iterator[Finding]:
    """What the library did not decide: who saw the game, what a host put into prompts, and which calls it played."""
    if record.reveals:
        yield error("privileged", "The player was given the game itself, and so knew what no prompt says.")
    if record.pictures:
        yield error("privileged", "The player was shown pictures of the game, which no prompt has.")
    if record.config.context == "host":
        yield say("prompts", "The host owned the context, so nothing is known of what the model saw.")
    elif not record.heads:
        yield say("prompts", "The record holds no prompts: the calls were made without a conversation.")
    if has_host_part:
        yield say("prompts", "The host added messages or tools to every prompt.")
    if any(message["by"] == "host" for message in record.messages):
        yield say("prompts", "The host added messages to the conversation.")
    has_own_calls = any("host" in call for call in record.calls)
    if has_own_calls or (record.heads and not record.is_paper and not _plays_all(record)):
        yield say("prompts", "The host edited, refused, moved or left out calls of the model.")


def _plays_all(record: Record) -> bool:
    """Whether every call of every reply was answered, in the order of the message."""
    sent = [(message["turn"], at) for message in record.messages for at in range(len(calls_of(message["message"])))]
    return sent == [(call["turn"], call["position"]) for call in record.calls]


def _check_budget(record: Record) -> Iterator[Finding]:
    """Check every prompt and reply against the caps, independently of the replay, which made the prompts anew."""
    cap = record.budget["prompt_tokens"]
    for view in record.views:
        if cap is not None and view["tokens"] > cap:
            yield error("budget", f"The prompt of turn {view['turn']} has {view['tokens']} tokens.")
    total = sum(usage["prompt"] + usage["reply"] for usage in record.usages if "reply" in usage)
    overruns = sum(bool(usage.get("overrun")) for usage in record.usages)
    if overruns:
        yield remark("budget", f"{overruns} replies were longer than their cap, and are charged in full.")
    cap = record.budget["episode_tokens"]
    if cap is not None and total > cap and not overruns:
        yield error("budget", f"The episode took {total} tokens under a cap of {cap}.")


def _check_end(record: Record, say: Say) -> Iterator[Finding]:
    """Check what a replay takes from the recorded end."""
    if record.end_reason in EXTERNAL_ENDS:
        why = f"{record.end_reason}: {record.result.detail}" if record.result.detail else record.end_reason
        yield say("end", f"The host ended the episode ({why}), not the game, a budget or the player.")
    if record.error is not None or record.traceback is not None:
        yield error("record", "The record says that a finished episode failed.")
    if record.cost is not None and not 0 <= record.cost <= MOST_COST:
        yield error("record", f"The episode cost {record.cost:,.0f} US dollars, which cannot be.")


def _check_row(line: bytes | None, row: Row) -> Iterator[Finding]:
    if line is None:
        yield error("row", "The results hold no row for this episode.")
        return
    submitted = json.loads(line)
    for name in sorted(row.keys() & submitted.keys()):
        if canonical_text(row[name]) != canonical_text(submitted[name]):
            yield error("row", f"The row says {name} is {submitted[name]!r}, the record {row[name]!r}.")
    if others := sorted((row.keys() ^ submitted.keys()) - (LATER - submitted.keys())):
        yield error("row", f"The row has other fields than the record gives: {some(others)}.")


def _check_deviations(record: Record, replayed: EpisodeResult, row: Row) -> Iterator[Finding]:
    """Check the deviations, which follow from the config in a way that another version may see differently.

    The row gets those of this version.
    """
    listed, row["deviations"] = row["deviations"], replayed.model_dump(mode="json")["deviations"]
    if listed != row["deviations"]:
        differs = error if record.versions.get("smartplay-tools") == metadata.version("smartplay-tools") else remark
        yield differs(
            "record", f"The record lists the deviations {some(listed)}, the replay {some(row['deviations'])}."
        )


def _check_attempts(job: RecordJob, finished: Record, checked: CheckedRecord, continued: set[str]) -> Iterator[Finding]:
    """Check earlier attempts: whether the finished episode continues each of them, or started over.

    `continued` gets the chain at which each of them stopped.
    """
    played = _replies(finished)
    for path in job.attempts:
        if Record.head(path).start is None:
            checked.attempts.append(EXCEPTION)
            continue
        attempt = Record.read(path)
        name = f"attempt {attempt.attempt}"
        if attempt.config != job.config or next(broken_links(attempt.events), None) is not None:
            yield error("attempts", f"The record of {name} was changed, or is of another episode.")
            continue
        if attempt.end_reason not in ENDS:
            yield error("attempts", f"The record of {name} says that it ended as {attempt.end_reason!r}.")
            continue
        checked.attempts.append(attempt.end_reason)
        continued.add(next(event["chain"] for event in reversed(attempt.events) if event is not attempt.ending))
        replies = _replies(attempt)
        if attempt.outcome == "finished":
            yield error("attempts", f"The record of {name} is a finished episode, which another one replaced.")
        elif replies != played[: len(replies)]:
            text = f"After {name} ({attempt.end_reason}, {len(replies)} replies) the episode was begun anew."
            yield remark("attempts", text)


def _check_continuations(record: Record, continued: set[str]) -> Iterator[Finding]:
    """Check the events that no replay plays, because they are about the record itself, and the versions in them."""
    if record.exceptions:
        yield error("record", "An exception stands in the record of a finished episode.")
    before = {event["chain"]: previous["chain"] for previous, event in pairwise(record.events)}
    for resume in map(dict[str, Any], record.resumes):
        if resume.keys() != {"event", "versions", "chain"}:
            yield error("record", f"A resume event has the fields {some(resume)}.")
        if before[resume["chain"]] not in continued:
            text = "The record says that it continues an attempt, which the bundle does not hold."
            yield error("attempts", text)
    recorded = [event["versions"] for event in (record.start, *record.resumes) if event is not None]
    try:
        for versions in recorded:
            VERSIONS.validate_python(versions)
    except ValueError as fault:
        yield error("record", f"The versions in the record are invalid: {in_one_line(fault)}.")
    if record.result.versions != recorded[-1]:
        yield error("record", "The versions at the end of the record are not those that played it.")


def _replies(record: Record) -> list[Message]:
    return [event["message"] for event in record.messages if event["by"] == "player"]
