"""One record of a submission, checked: replayed, its row computed anew, its budget and prompts held against it.

It runs in a process of its own (`workers`), under limits of time and memory. Whatever a hostile record makes go wrong
is a finding, not a traceback.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from smartplay_tools import prompts
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.errors import SmartPlayError, in_one_line
from smartplay_tools.evaluation.board.submissions.findings import Finding, error, remark, some
from smartplay_tools.messages import Message
from smartplay_tools.records.prices import Price
from smartplay_tools.records.record import EXCEPTION, Record
from smartplay_tools.records.replays import replay_record
from smartplay_tools.records.rows import Row, row_of
from smartplay_tools.transcript.events import HeadEvent
from smartplay_tools.transcript.file import broken_links
from smartplay_tools.types import TOOL_NAMES

SHOWN_DIFFERENCES = 3
"""Of a record that plays differently; the first is what matters, the others mostly follow from it."""


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
    found, key = CheckedRecord(), job.config.key
    try:
        found.findings += _check(job, found)
    except SmartPlayError as fault:
        found.findings.append(error("record", _of_bundle(str(fault), job.record), key))
    except MemoryError:
        raise
    except Exception as fault:  # a hostile record may reach any part of the game with any value
        what = f"{type(fault).__name__}: {in_one_line(fault)}"
        found.findings.append(error("record", f"The record cannot be replayed: {_of_bundle(what, job.record)}.", key))
    if any(finding.level == "error" for finding in found.findings):
        found.row = None
    return found


def _of_bundle(text: str, record: Path) -> str:
    """Name a file as it is called in the bundle, not where it was unpacked."""
    return text.replace(f"{record.parent.parent}/", "")


def _check(job: RecordJob, found: CheckedRecord) -> Iterator[Finding]:
    key, record = job.config.key, Record.read(job.record, {job.config.player or "": job.price} if job.price else {})
    if record.config != job.config:
        config = record.config
        names = [name for name in type(config).model_fields if getattr(config, name) != getattr(job.config, name)]
        yield error("record", f"The record is of another episode than the manifest says: {some(names)} differ.", key)
        return
    yield from _check_host(record, key, standard=job.standard)
    played = replay_record(record, tokenizer=job.tokenizer)
    for difference in played.differences[:SHOWN_DIFFERENCES]:
        yield error("record", difference, key)
    if len(played.differences) > SHOWN_DIFFERENCES:
        yield error("record", f"{len(played.differences) - SHOWN_DIFFERENCES} more differences in this record.", key)
    if not played.complete:
        yield error("record", "The record breaks off: it does not say how the episode ended.", key)
        return
    yield from _check_budget(record, key)
    _count(record, found)
    if record.outcome != "finished":
        yield error("record", f"The record is not a finished episode: it ended as {record.end_reason}.", key)
        return
    found.row = row_of(record, job.trial)
    yield from _check_row(job.row, found.row, key)
    yield from _check_attempts(job, record, found)


def _count(record: Record, found: CheckedRecord) -> None:
    found.replies = len(_replies(record))
    found.prompts = len(record.views)
    found.calls = len(record.calls)
    found.provider = any(usage["provider"] is not None for usage in record.usages)
    found.versions = record.versions


def _check_host(record: Record, key: str, *, standard: bool) -> Iterator[Finding]:
    """What was not left to the library: who saw the game, and what a host put into prompts."""
    if record.reveals:
        yield error("privileged", "The player was given the game itself, and so knew what no prompt says.", key)
    if record.pictures:
        yield error("privileged", "The player was shown pictures of the game, which no prompt has.", key)
    say = error if standard else remark
    if record.config.context == "host":
        yield say("prompts", "The host owned the context, so nothing is known of what the model saw.", key)
    if record.heads and not record.is_paper:
        if any(_has_more_than_the_game(head) for head in record.heads):
            yield say("prompts", "The host added messages or tools of its own to every prompt.", key)
    elif not record.heads and record.config.context != "host":
        yield say("prompts", "The record holds no prompts: the calls were made without a conversation.", key)
    if any(message["by"] == "host" for message in record.messages):
        yield say("prompts", "The host added messages to the conversation.", key)
    if any("host" in call for call in record.calls):
        yield say("prompts", "The host edited or refused calls of the model.", key)


def _has_more_than_the_game(head: HeadEvent) -> bool:
    """Whether a head has messages or tools that are not the game's."""
    tools = [tool["name"] for tool in head["tools"]]
    return len(head["messages"]) > len(prompts.head()) or len(tools) > len(set(tools) & set(TOOL_NAMES))


def _check_budget(record: Record, key: str) -> Iterator[Finding]:
    """Check every prompt and reply against the caps, independently of the replay, which made the prompts anew."""
    cap = record.budget["prompt_tokens"]
    for view in record.views:
        if cap is not None and view["tokens"] > cap:
            yield error("budget", f"The prompt of turn {view['turn']} has {view['tokens']} tokens.", key)
    total = sum(usage["prompt"] + usage["reply"] for usage in record.usages if "reply" in usage)
    overruns = sum(bool(usage.get("overrun")) for usage in record.usages)
    if overruns:
        yield remark("budget", f"{overruns} replies were longer than their cap, and are charged in full.", key)
    cap = record.budget["episode_tokens"]
    if cap is not None and total > cap and not overruns:
        yield error("budget", f"The episode took {total} tokens under a cap of {cap}.", key)


def _check_row(line: bytes | None, row: Row, key: str) -> Iterator[Finding]:
    if line is None:
        yield error("row", "The results hold no row for this episode.", key)
        return
    submitted = json.loads(line)
    for name in sorted(row.keys() | submitted.keys()):
        if row.get(name) != submitted.get(name) or (name in row) != (name in submitted):
            yield error("row", f"The row says {name} is {submitted.get(name)!r}, the record {row.get(name)!r}.", key)


def _check_attempts(job: RecordJob, finished: Record, found: CheckedRecord) -> Iterator[Finding]:
    """Check earlier attempts: whether the finished episode continues each of them, or started over."""
    key, played = job.config.key, _replies(finished)
    for path in job.attempts:
        if Record.head(path).start is None:
            found.attempts.append(EXCEPTION)
            continue
        attempt = Record.read(path)
        name = f"attempt {attempt.attempt}"
        if attempt.config != job.config or next(broken_links(attempt.events), None) is not None:
            yield error("attempts", f"The record of {name} was changed, or is of another episode.", key)
            continue
        found.attempts.append(attempt.end_reason)
        replies = _replies(attempt)
        if attempt.outcome == "finished":
            yield error("attempts", f"The record of {name} is a finished episode, which another one replaced.", key)
        elif replies != played[: len(replies)]:
            yield remark(
                "attempts",
                f"After {name} ({attempt.end_reason}, {len(replies)} replies) the episode was begun anew.",
                key,
            )


def _replies(record: Record) -> list[Message]:
    return [event["message"] for event in record.messages if event["by"] == "player"]
