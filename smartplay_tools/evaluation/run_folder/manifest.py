"""The manifest of a run: its plan, caps and prices, written before its first episode.

Playing a run and checking the run of another both derive seeds and shards here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, ValidationInfo, field_validator

from smartplay_tools.episode.config import CellConfig
from smartplay_tools.records.prices import Price

FORMAT: Literal[1] = 1
"""The version of the layout of a run's folder; folders with another version are refused."""


def trial_seed(seed: int, game: str, trial: int) -> int:
    """Return the seed of a trial: below 2**31, different for every trial of a game.

    It follows from the seed of the run, so one number determines all its worlds.
    """
    start = hashlib.sha256(f"{seed} {game}".encode()).digest()[:4]
    return (int.from_bytes(start, "big") + trial) % 2**31


def player_seed(seed: int, repeat: int) -> int:
    """Return the seed of a player in a world: the world's, or another one each time it is played again."""
    if not repeat:
        return seed
    return int.from_bytes(hashlib.sha256(f"{seed} {repeat}".encode()).digest()[:4], "big") % 2**31


def shard_of(digest: str, chain: int, count: int) -> int:
    """Return the number (from 1) of the shard, of `count`, that plays a chain of the cell with this digest.

    Without `carry` every trial is a chain of its own (`CellConfig.chain_of`). The shard depends only on the cell and
    the chain, so an episode stays in its shard when a run is extended.
    """
    return (int(digest, 16) + chain) % count + 1


def _price(value: Any) -> Price:
    try:
        return value if isinstance(value, Price) else Price.from_json(value)
    except (KeyError, TypeError):
        raise ValueError("it is not a price") from None


@dataclass(frozen=True, slots=True)
class ManifestEpisode:
    """An episode in a manifest; `cell` is the number of its cell there. There may be a million of them."""

    key: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    """It is part of the names of files."""
    cell: Annotated[int, Field(ge=0)]
    trial: Annotated[int, Field(ge=0)]
    seed: Annotated[int, Field(ge=0, lt=2**31)]


@dataclass(frozen=True)
class Until:
    """What ends a run before its planned trials: its comparisons are decided (`evaluation.analysis.stopping`)."""

    margin: str
    """What does not matter, in points or in human scores: "0.5" or "0.1h"."""
    clip: float | None = None
    """The largest difference that counts, for games without bounds."""
    by: Literal["score", "wins"] = "score"
    """How much the scores of a pair differ, or only which is higher."""


class Manifest(BaseModel):
    """The content of `manifest.json`. All shards of a run have the whole plan."""

    model_config = ConfigDict(frozen=True)

    format: Literal[1] = FORMAT
    seed: Annotated[int, Field(ge=0)]
    cells: tuple[CellConfig, ...]
    episodes: tuple[ManifestEpisode, ...]
    shard: tuple[int, int] | None
    """The part of the run that this folder is for, as (i, n); None for the whole run."""
    caps: Mapping[str, Any] = Field(default_factory=dict)
    """`tokens` and `cost`, each None if there is no cap."""
    prices: dict[str, Annotated[Price, BeforeValidator(_price), PlainSerializer(Price.to_json)]]
    """By player."""
    versions: dict[str, str] = Field(default_factory=dict)
    repeats: int | None = None
    """How often each world is played, one trial after the other; None for once."""
    run_file: str | None = None
    """The text of the run file, if there is one."""
    until: Until | None = None
    """What ends the run early; declared before its first episode."""
    spending: dict[str, Any] | None = None
    """What the run had used when it was last stopped (`Spending.to_json`)."""

    @field_validator("episodes")
    @classmethod
    def _have_listed_cells(
        cls, episodes: tuple[ManifestEpisode, ...], info: ValidationInfo
    ) -> tuple[ManifestEpisode, ...]:
        count = len(info.data.get("cells", ()))
        for episode in episodes:
            if episode.cell >= count:
                raise ValueError(f"{episode.key} has the cell {episode.cell}, which is not listed")
        return episodes

    @property
    def planned(self) -> tuple[ManifestEpisode, ...]:
        """The episodes of this part of the run."""
        if self.shard is None:
            return self.episodes
        number, count = self.shard
        digests, cells = [cell.digest for cell in self.cells], self.cells
        return tuple(
            e for e in self.episodes if shard_of(digests[e.cell], cells[e.cell].chain_of(e.trial), count) == number
        )

    @cached_property
    def predecessors(self) -> dict[str, str]:
        """The key of the trial before it, by the key of every episode that takes something over (`Rules.carry`)."""
        carrying = [cell.carry is not None for cell in self.cells]
        if not any(carrying):
            return {}
        chained = [episode for episode in self.episodes if carrying[episode.cell]]
        keys = {(episode.cell, episode.trial): episode.key for episode in chained}
        before: dict[str, str] = {}
        for episode in chained:
            cell, earlier = self.cells[episode.cell], (episode.cell, episode.trial - 1)
            if earlier in keys and cell.chain_of(episode.trial - 1) == cell.chain_of(episode.trial):
                before[episode.key] = keys[earlier]
        return before

    def to_json(self) -> dict[str, Any]:
        """Return the manifest as plain data; what there is not is left out."""
        absent = {name for name in ("repeats", "run_file", "until", "spending") if getattr(self, name) is None}
        return self.model_dump(mode="json", exclude=absent)
