"""EpisodeSelection: which finished episodes of a run are exported, and how many are left out and why.

Training on everything that was played teaches a model its mistakes, too: most data sets keep the completed or the best
episodes. What is left out is counted by its reason, so that a data set says what it is a part of.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from smartplay_tools.evaluation.run_folder.folder import records_in
from smartplay_tools.records.groups import grouped
from smartplay_tools.records.record import Record


class EpisodeSelection(BaseModel):
    """The episodes to export. By default all that are finished."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    games: tuple[str, ...] = ()
    """Only these settings; all if empty."""
    players: tuple[str, ...] = ()
    """Only these players; all if empty."""
    completed: bool = False
    """Only episodes whose game was completed."""
    min_score: float | None = None
    """Only episodes with at least this score."""
    min_normalized_score: float | None = None
    """Only episodes with at least this normalised score; settings without a human score have none."""
    best: int | None = Field(default=None, ge=1)
    """Only the best episodes of every game and player, this many; of equal scores, those of the lower seeds."""

    def choose(self, source: Path, *, pictures: bool = False) -> tuple[list[Path], Counter[str]]:
        """Return the records of the chosen episodes, in order, and the number of those left out by reason.

        Episodes whose observations are pictures are chosen with `pictures` only.
        """
        matching: list[tuple[Path, Record]] = []
        left_out: Counter[str] = Counter()
        for path in records_in(source):
            record = Record.head(path)
            if record.start is None:
                continue  # not the record of an episode: a run's own files are JSON Lines, too
            reason = (
                self._reason_against(record, pictures=pictures) if record.outcome == "finished" else record.end_reason
            )
            if reason is None:
                matching.append((path, record))
            else:
                left_out[reason] += 1
        chosen = self._best(matching)
        left_out.update({"not among the best": len(matching) - len(chosen)} if len(chosen) < len(matching) else {})
        return [path for path, _ in chosen], left_out

    def _reason_against(self, record: Record, *, pictures: bool) -> str | None:
        result = record.result_data
        assert result is not None
        score, normalized = result["score"], result["normalized_score"]
        if record.config.observation != "text" and not pictures:
            return "observations are pictures"
        if self.games and result["game"] not in self.games:
            return "another game"
        if self.players and record.player not in self.players:
            return "another player"
        if self.completed and not result["completed"]:
            return "not completed"
        if self.min_score is not None and score < self.min_score:
            return "score too low"
        if self.min_normalized_score is not None and (normalized is None or normalized < self.min_normalized_score):
            return "normalised score too low"
        return None

    def _best(self, matching: Sequence[tuple[Path, Record]]) -> list[tuple[Path, Record]]:
        if self.best is None:
            return list(matching)
        ordered = sorted(matching, key=lambda pair: (-pair[1].result.score, pair[1].result.seed, pair[0]))
        groups = grouped(ordered, lambda pair: (pair[1].game, pair[1].player))
        kept = {path for group in groups.values() for path, _ in group[: self.best]}
        return [pair for pair in matching if pair[0] in kept]
