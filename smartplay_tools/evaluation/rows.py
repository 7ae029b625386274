"""Rows: the results of episodes as plain data, read from the records of attempts.

A row is one line of `results.jsonl`. This module is used for playing, statistics and reports, so that `run` and
`analysis` do not have to import each other.

An attempt at an episode leaves a record, which alone determines the outcome. An episode that ended by itself, including
by a spent budget, is a result and has a row. An attempt that failed, was interrupted or was paused by a cap of the run
is not a result: it is in no mean, and the episode is continued or played again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field

from smartplay_tools.episode.config import RULES, EpisodeConfig, recorded_facts
from smartplay_tools.errors import InvalidArgumentError, in_one_line
from smartplay_tools.evaluation.prices import Price
from smartplay_tools.transcript.events import Event
from smartplay_tools.transcript.file import parse_json, scan
from smartplay_tools.types import Budget, EndReason, EpisodeResult, ResolvedBudget, Usage

Row = dict[str, Any]
"""A row of `results.jsonl`: an `EpisodeResult` in JSON, and the configuration of its episode."""

FAILURES = ("player_error", "game_error")
"""Ends of an episode that failed."""

PAUSED: EndReason = "run_budget"
"""The end of an attempt whose next call could have exceeded a cap of the run."""

UNFINISHED = ("closed", PAUSED)
"""Ends of an episode that was stopped from outside and can be continued."""

INTERRUPTED = "interrupted"
"""The end reason of an attempt that was stopped or killed."""

COPIED = ("player", "player_options", *RULES, "options", "tokenizer", "prompts", "budget", "asked")
"""The fields of a row that come from the first event of the record."""

UNANSWERED = "CancelledError: the run stopped while a reply was awaited"
"""The exception event of an attempt that was stopped during a call, which may be charged."""


def read_row(record: Path, trial: int, price: Price | None = None) -> Row:
    """Return the row of a finished episode, from its record."""
    kinds = ("start", "end") if price is None else ("start", "usage", "end")
    return row_of(list(scan(record, *kinds)), record.stem, trial, price)


def row_of(
    events: Sequence[Event], key: str, trial: int, price: Price | None = None, config: EpisodeConfig | None = None
) -> Row:
    """Return the row of a finished episode, from the events of its record; `config` is the record's, if it is known.

    Its cost is in US dollars: 0 if no provider reported any tokens, None if one did and the price of the
    player's model is not known.
    """
    start, end = events[0], next(event for event in reversed(events) if event["event"] == "end")
    facts = recorded_facts(start, config)
    copied = {name: facts[name] for name in COPIED}
    cost: float | None = None
    if price is not None:
        cost = sum(price.cost(usage_of(event)) for event in events if event["event"] == "usage")
    elif end["result"]["tokens"]["provider"] is None:
        cost = 0.0
    return {"key": key, **end["result"], **copied, "trial": trial, "cost": cost}


class _Row(EpisodeResult):
    """A row: the fields of an `EpisodeResult`, and what a run and the record's configuration add."""

    model_config = ConfigDict(extra="ignore")

    key: Annotated[str, Field(pattern="^[0-9a-f]{16}$")]
    player: str
    player_options: dict[str, Any]
    protocol: str
    manual: str
    batch: str
    options: dict[str, Any]
    tokenizer: str
    prompts: str
    budget: ResolvedBudget
    asked: Budget
    trial: int
    cost: float | None


def row_fault(row: Any) -> str | None:
    """Return what keeps a row from being read, None if nothing does."""
    try:
        _Row.model_validate(row)
    except (TypeError, ValueError) as error:
        return in_one_line(error)[:200]
    return None


def usage_of(event: Event) -> Usage:
    """Return the tokens of a `usage` event: the provider's count if there is one, else ours."""
    if event["provider"] is not None:
        return Usage(**event["provider"])
    return Usage(prompt=event["prompt"], reply=event["reply"])


def reason_of(end: Event | None) -> tuple[str | None, str | None]:
    """Return the reason why an attempt has no result (None if it has one), and the error if there was one."""
    if end is None:
        return INTERRUPTED, None
    if end["event"] == "exception":
        return (INTERRUPTED if is_unanswered(end) else "exception"), end["error"]
    reason, error = end["result"]["end_reason"], end["result"]["error"]
    if reason in (*FAILURES, PAUSED):
        return reason, error
    return (INTERRUPTED if reason in UNFINISHED else None), error


def is_unanswered(event: Event) -> bool:
    """Return whether an event says that the attempt was stopped during a call."""
    return bool(event["event"] == "exception" and event["error"] == UNANSWERED)


def read_ends(record: Path) -> tuple[Event | None, Event | None]:
    """Return the first event of a record and the event of its end; None for a missing one."""
    start = end = None
    for event in scan(record, "start", "end", "exception"):
        if event["event"] == "start":
            start = event
        else:
            end = event
    return start, end


def json_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the objects of a file of JSON lines, without an incomplete last line."""
    if path.exists():
        with path.open(encoding="utf-8", errors="replace") as lines:
            for number, line in enumerate(lines, start=1):
                try:
                    value = json_line(line)
                except (ValueError, RecursionError):
                    raise InvalidArgumentError(f"Line {number} of {path} is damaged: it is not JSON.") from None
                if value is not None:
                    yield value


def json_line(line: str) -> dict[str, Any] | None:
    """Return the object of a line; None if the line is incomplete."""
    if not line.endswith("\n"):
        return None
    value: dict[str, Any] = parse_json(line)
    return value


def unplayed(rows: Iterable[Row]) -> list[str]:
    """Return a sentence for every player, game and cause with episodes that ended without a single action.

    Such an episode is a result, but says nothing about how well its player plays.
    """
    found: Counter[tuple[str, str, str]] = Counter()
    for row in rows:
        if is_unplayed(row):
            found[row["player"], row["game"], _cause(row)] += 1
    return [
        f"{count} {'episode' if count == 1 else 'episodes'} of {player} at {game} ended without any action: {cause}."
        for (player, game, cause), count in found.items()
    ]


def is_unplayed(row: Row) -> bool:
    """Return whether an episode ended without a single action, for which not its budget is the reason."""
    return bool(row["steps"] == 0 and row["end_reason"] != "prompt_tokens")


def _cause(row: Row) -> str:
    if row["idle_replies"] == row["turns"]:
        return (
            "its replies contain no tool calls, so the server may pass them on as text (vLLM needs "
            "--enable-auto-tool-choice and --tool-call-parser), or the model has none (--protocol paper asks for text)"
        )
    if row["malformed_calls"] or row["illegal_actions"]:
        return "all its calls were malformed or named no legal action; its records show them"
    return f"they ended as {row['end_reason']} before; its records show why"
