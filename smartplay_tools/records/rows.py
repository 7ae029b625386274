"""Rows: the results of episodes as plain data, read from the records of attempts.

A row is one line of `results.jsonl`. Playing, statistics and reports all use this module, so that `runs` and `analysis`
need not import each other.

An attempt at an episode leaves a record, which alone determines the outcome. An episode that ended by itself, including
by a spent budget, is a result and has a row. An attempt that failed, was interrupted or was paused by a cap of the run
is not a result: it is in no mean, and the episode is continued or played again.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, Field

from smartplay_tools.episode.config import RULES, SCORING, Rules
from smartplay_tools.errors import in_one_line
from smartplay_tools.files.growing_lines import GrowingLines
from smartplay_tools.files.lines import parse_json
from smartplay_tools.games.game_registry import Scoring
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.best_choices import best_choice
from smartplay_tools.records.damage import DamageError, warn_damaged
from smartplay_tools.records.record import Record
from smartplay_tools.records.remembered import remembered
from smartplay_tools.transcript.events import Amount, Count, RecordedResult
from smartplay_tools.types import STRATEGIES, RecordedBudget, ResolvedBudget, Usage
from smartplay_tools.types.result import UNUSUAL_ENDS

Row = dict[str, Any]
"""A row of `results.jsonl`: an `EpisodeResult` in JSON, and the configuration of its episode."""

FILES = ("game_file", "game_sha256", "strategy_sha256")
"""The fields of a row about files of the user's."""

COPIED = ("player", "player_options", *RULES, "options", "tokenizer", *FILES, "prompts", "budget", "asked", "scoring")
"""The fields of a row that come from the first event of the record."""


OPTIONAL = ("scoring", "memory", "best")
"""The fields of a row about what its game declares: what scores can be (`Scoring`), the shares of `remembered`, and the
scores of `best_choice`."""

COUNTED = ("peak_prompt_tokens", "limited_prompts", "play_sha256", "cost", "question_cost")
"""The fields of a row that are counted from the record's events; `Record` has their meanings."""

LATER = frozenset({*COUNTED, "observation", *FILES, *OPTIONAL} - {"cost"})
"""The fields that rows of older versions do not have."""

_UNSAID: Mapping[str, Any] = {**Rules.later, **dict.fromkeys((*FILES, "scoring"))}
"""The fields that a row has only where there is something to say, each with the value that it leaves out."""


def row_of(record: Record, trial: int) -> Row:
    """Return the row of a finished episode, from its record."""
    facts = record.facts
    copied = {name: facts[name] for name in COPIED if name not in _UNSAID or facts[name] != _UNSAID[name]}
    result = record.result_data or {}
    names = COUNTED if result.get("questions") else [name for name in COUNTED if name != "question_cost"]
    counted = {name: getattr(record, name) for name in names}
    declared: Row = {}
    if (shares := remembered(record)) is not None:
        declared["memory"] = shares
        if (best := best_choice(record.config)) is not None:
            declared["best"] = vars(best)
    return {"key": record.key, **result, **copied, "trial": trial, **counted, **declared}


def has_reported_tokens(row: Row) -> bool:
    """Return whether a provider has counted tokens of an episode."""
    provider = row["tokens"]["provider"]
    return provider is not None and Usage(**provider).has_tokens


def is_managed(row: Row) -> bool:
    """Return whether a provider managed the context of an episode, so that its record has not what the model saw."""
    return bool((row["tokens"]["provider"] or {}).get("managed"))


EARLY_ENDS = frozenset(
    {
        *("prompt_tokens", "episode_tokens", "episode_cost", "tool_calls"),
        *("stalled_turns", "no_tool_call", "strategy_error", "game_error"),
    }
)
"""Of the early ends, those that a budget, a stall, a strategy or a wrong value of the game causes."""


def has_early_end(row: Row) -> bool:
    """Return whether an episode ended early, in a game whose means count that."""
    return row["end_reason"] in EARLY_ENDS and row["game"] not in GAMES.benchmark


def mean_score(row: Row) -> float:
    """Return the score that means use; after an early end, the least that the missing steps could have led to.

    Otherwise an agent that loses points with its steps would do better where a budget ends its episodes sooner. The
    paper's settings keep the paper's score, and so does a game of which nothing is known here.
    """
    scoring = scoring_of(row) if has_early_end(row) else None
    return float(row["score"]) if scoring is None else scoring.least_score(float(row["score"]), row["steps"])


def scoring_of(row: Row) -> Scoring | None:
    """Return what scores can be in the setting of a row, as its record says, or else as it is registered here.

    None if neither is so: rows of older versions say nothing of scores.
    """
    recorded = row.get("scoring")
    return GAMES.get(row["game"]) if recorded is None else SCORING.validate_python(recorded)


def recorded_score(record: Record) -> float:
    """Return the `mean_score` of the finished episode of a record."""
    return mean_score({**(record.result_data or {}), "scoring": record.facts["scoring"]})


def is_whole(row: Row) -> bool:
    """Return whether every prompt of an episode showed all that had happened before.

    Rows of older versions do not say so: theirs did if no limit of the window can have been reached.
    """
    budget, limited = row["budget"], row.get("limited_prompts")
    if any(budget.get(name, default) != default for name, default in STRATEGIES.items()):
        return False
    if limited is not None:
        return bool(limited == 0)
    unlimited = budget["history"] is None or budget["history"] >= row["steps"]
    return unlimited and budget["prompt_tokens"] is None


def unit_of(*rows: Row) -> int:
    """Return the independent unit of statistics that a row, or a pair of rows of one trial, belongs to.

    It is the world or, where trials carry something over (`Rules.carry`), the chain; with chains of different lengths
    on the two sides, as many trials as both divide.
    """
    chains = [row.get("chain") for row in rows if row.get("carry") is not None]
    if not chains:
        return int(rows[0]["seed"])
    lengths = [length for length in chains if length is not None]
    return rows[0]["trial"] // math.lcm(*lengths) if len(lengths) == len(chains) else 0


class _Row(RecordedResult):
    """A row: the fields of an `EpisodeResult`, and what a run and the record's configuration add."""

    deviations: dict[str, dict[str, Any]]
    key: Annotated[str, Field(pattern="^[0-9a-f]{16}$")]
    player: str
    player_options: dict[str, Any]
    protocol: str
    manual: str
    batch: str
    options: dict[str, Any]
    tokenizer: str
    game_file: str | None = None
    game_sha256: str | None = None
    strategy_sha256: str | None = None
    scoring: Scoring | None = None
    memory: dict[str, tuple[int, int]] | None = None
    best: dict[str, float] | None = None
    prompts: str
    budget: ResolvedBudget
    asked: RecordedBudget
    trial: Count
    peak_prompt_tokens: Count = 0
    limited_prompts: Count | None = None
    play_sha256: str | None = None
    cost: Amount | None
    question_cost: Amount | None = None


class Timing(BaseModel):
    """The row of an attempt in `timings.jsonl`, as far as it is read again."""

    key: str
    attempt: Count
    seconds: Amount
    game_seconds: Amount
    processor_seconds: Amount
    began_again: str | None = None


_HALF = re.compile(rb"\\u[dD][89a-fA-F][0-9a-fA-F]{2}")
"""Half a character in JSON, which Pydantic does not read."""


def read_row(line: bytes, kind: type[BaseModel] = _Row) -> Row:
    """Read a row from a line of JSON, and check the types of its fields; `DamageError` if one is wrong."""
    try:
        row: Row = parse_json(line)
        kind.model_validate_json(_HALF.sub(rb"\\ufffd", line), strict=True)
    except (TypeError, ValueError, RecursionError) as error:
        raise DamageError(in_one_line(error)[:200].rstrip(".")) from None
    return row


def read_rows(path: Path, kind: type[BaseModel] = _Row) -> Iterator[Row]:
    """Yield the rows of a file; a damaged one is left out with a `DamageWarning`, and a missing file has none."""
    lines, _ = GrowingLines(path).read()
    for number, line in enumerate(lines, start=1):
        try:
            yield read_row(line, kind)
        except DamageError as error:
            warn_damaged(f"Line {number} of {path} is damaged and left out: {error}.")


MORE_TOKENS = "raise --reply-tokens, or the server's own cap; a model that reasons may need thousands"
"""The remedy for replies that are cut at their length."""


WRITTEN_CALLS: Mapping[str, re.Pattern[str]] = {
    "hermes": re.compile(r"<tool_call>"),
    "mistral": re.compile(r"\[TOOL_CALLS\]"),
    "llama": re.compile(r"<\|python_tag\|>|^\s*\{\s*\"name\"\s*:\s*\"(act|observe|read_manual)\""),
}
"""How the formats begin in which models write calls as text."""


def without_calls(text: str) -> str:
    """Return what is wrong with a reply that calls no tool, and the remedy: the end of a sentence about its model."""
    for name, pattern in WRITTEN_CALLS.items():
        if pattern.search(text):
            return (
                "writes its calls as text, which its server does not read: start vLLM with --enable-auto-tool-choice "
                f"and --tool-call-parser {name}, or play with --player-option "
                f"parse_calls={name}"
            )
    return (
        "has called no tool: start a vLLM server with --enable-auto-tool-choice and --tool-call-parser, or ask for "
        "calls with --player-option tool_choice=required; a model without tools can play with --protocol paper"
    )


FirstReply: TypeAlias = Callable[[Row], str]
"""Returns the text of the first reply of a row's episode."""


def unread(row: Row) -> str:
    """Return no text, where the records of rows are not at hand."""
    return ""


def unplayed(rows: Iterable[Row], first_reply: FirstReply = unread) -> list[str]:
    """Return a sentence for every player, game and cause with episodes that ended without a single action.

    Such an episode is a result, but says nothing about how well its player plays. Of each player and game, the reply
    of one episode is looked at.
    """
    counts: Counter[tuple[str, str, str]] = Counter()
    texts: dict[tuple[str, str], str] = {}
    for row in rows:
        if is_unplayed(row):
            of = row["player"], row["game"]
            if row["turns"] and of not in texts:
                texts[of] = first_reply(row)
            counts[*of, _cause(row, texts.get(of, ""))] += 1
    return [
        f"{count} {'episode' if count == 1 else 'episodes'} of {player} at {game} ended without any action: {cause}."
        for (player, game, cause), count in counts.items()
    ]


def warnings(row: Row, first_reply: FirstReply = unread) -> list[str]:
    """Return a sentence for each problem of an episode that comes from its settings, not from its player."""
    sentences, tokens = unplayed([row], first_reply), row["tokens"]
    if tokens["overruns"]:
        sentences.append(
            f"{tokens['overruns']} of {row['turns']} replies were longer than --reply-tokens allows, with their "
            "reasoning; they were charged in full. Check that the server obeys its cap (max_tokens)."
        )
    if cut := (tokens["provider"] or {}).get("cut", 0):
        sentences.append(f"{cut} of {row['turns']} replies were cut at their length (finish_reason); {MORE_TOKENS}.")
    if is_managed(row):
        told = Usage(**tokens["provider"])
        sentences.append(
            f"{told.managed} of {row['turns']} prompts were left to the provider's context management, which reports "
            f"{told.edits} edits and {told.cleared:,} cleared tokens: the record has not what the model saw, and no "
            "count is exact."
        )
    for name, words in UNUSUAL_ENDS.items():
        if count := (tokens["provider"] or {}).get(name, 0):
            sentences.append(f"{count} of {row['turns']} replies were {words}.")
    return sentences


def is_unplayed(row: Row) -> bool:
    """Return whether an episode ended without a single action for a reason other than its budget."""
    return bool(row["steps"] == 0 and row["end_reason"] != "prompt_tokens")


def _cause(row: Row, text: str) -> str:
    if row["turns"] and 2 * (row["tokens"]["provider"] or {}).get("cut", 0) > row["turns"]:
        return f"its replies were cut at their length before they called a tool; {MORE_TOKENS}"
    for name, words in UNUSUAL_ENDS.items():
        if row["turns"] and 2 * (row["tokens"]["provider"] or {}).get(name, 0) > row["turns"]:
            return f"its replies were {words}"
    if row["turns"] and row["idle_replies"] == row["turns"]:
        return f"it {without_calls(text)}"
    if row["malformed_calls"] or row["illegal_actions"]:
        return "all its calls were malformed or named no legal action"
    return f"the end is {row['end_reason'].replace('_', ' ')}"
