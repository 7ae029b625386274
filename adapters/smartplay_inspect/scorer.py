"""The scorer, which reads the episode's result, and this package's intervals as metrics of Inspect's.

`save_records` writes the records of a log's episodes to files, which can be replayed.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path

from inspect_ai.log import EvalLog, EvalSample, read_eval_log
from inspect_ai.scorer import (
    Metric,
    SampleScore,
    Score,
    Scorer,
    Target,
    Value,
    mean,
    metric,
    scorer,
    stderr,
    value_to_float,
)
from inspect_ai.solver import TaskState
from inspect_ai.util import store_as

from smartplay_inspect.solver import Played
from smartplay_tools import GAMES, EpisodeResult
from smartplay_tools.errors import TranscriptError
from smartplay_tools.statistics.intervals import mean_estimate
from smartplay_tools.transcript import write_records
from smartplay_tools.types.groups import grouped


def _values(scores: list[SampleScore]) -> list[float]:
    to_float = value_to_float()
    return [to_float(score.score.value) for score in scores]


def _ends(scores: list[SampleScore]) -> dict[str, float]:
    if not scores:
        return {}
    estimate = mean_estimate(_values(scores))
    ends = {"low": estimate.low, "high": estimate.high}
    return {name: value for name, value in ends.items() if value is not None}


@metric
def interval() -> Metric:
    """The ends of the 95 % interval of the mean, `low` and `high`, where the episodes give one."""
    return _ends


@metric
def by_game() -> Metric:
    """The mean of every game by itself, and the ends of its interval: scores of different games have no common mean."""

    def figures(scores: list[SampleScore]) -> Value:
        games = grouped(scores, lambda score: str((score.sample_metadata or {})["game"]))
        figures: dict[str, float] = {}
        for game, own in games.items():
            figures[game] = mean_estimate(_values(own)).mean
            figures |= {f"{game} {end}": value for end, value in _ends(own).items()}
        return figures

    return figures


VALUES: dict[str, list[Metric]] = {
    "score": [mean(), stderr(), interval()],
    "normalized_score": [mean(), stderr(), interval()],
    "completed": [mean()],
    "illegal_actions": [mean()],
    "malformed_calls": [mean()],
    "prompt_tokens": [mean()],
    "reply_tokens": [mean()],
}
"""The values of a score, and their metrics."""


def metrics_for(games: Collection[str]) -> dict[str, list[Metric]]:
    """Return the metrics of a task: for one game over all samples, for several by game.

    `normalized_score` is left out where no game has a human score: Inspect would show 0 for it.
    """
    has_human = any(GAMES[game].human_score is not None for game in games)
    values = {name: metrics for name, metrics in VALUES.items() if has_human or name != "normalized_score"}
    return values if len(games) == 1 else {name: [by_game()] for name in values}


@scorer(metrics=VALUES)
def smartplay_scorer() -> Scorer:
    """Score a sample by its episode's result: score, normalised score, completion, mistakes and budget tokens."""

    async def score(state: TaskState, target: Target) -> Score:
        kept = store_as(Played).result
        if not kept:
            return Score(value=math.nan, explanation="The episode has no result: its solver did not begin it.")
        result = EpisodeResult(**kept)
        normalized = result.normalized_score
        return Score(
            value={
                "score": result.score,
                "normalized_score": math.nan if normalized is None else normalized,
                "completed": float(result.completed),
                "illegal_actions": result.illegal_actions,
                "malformed_calls": result.malformed_calls,
                "prompt_tokens": result.tokens.prompt,
                "reply_tokens": result.tokens.reply,
            },
            answer=f"{result.score:g}",
            explanation=result.end_reason + (f": {result.detail}" if result.detail else ""),
            metadata=result.model_dump(mode="json"),
        )

    return score


def save_records(log: str | Path | EvalLog, folder: str | Path) -> list[Path]:
    """Write the record of every episode in a log to its own file, and return the files.

    A file is named by its sample and epoch. An existing file, or a log without records of this package's, is a
    `TranscriptError`.
    """
    whole = log if isinstance(log, EvalLog) else read_eval_log(str(log), resolve_attachments=True)
    texts = {f"{sample.id}.{sample.epoch}.jsonl": _record(sample) for sample in whole.samples or ()}
    if not any(texts.values()):
        raise TranscriptError("The log holds no record of an episode; it has to be a log of smartplay_inspect's tasks.")
    return write_records(texts, folder)


def _record(sample: EvalSample) -> str:
    record: str = sample.store_as(Played).record
    return record
