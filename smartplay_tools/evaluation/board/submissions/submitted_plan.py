"""The plan of a submitted run: which cells and episodes its manifest lists, and whether they may be replayed here.

A config from a stranger decides what a replay imports, reads and allocates. So nothing is replayed before its config is
found to be of a kind that is safe: a setting of the benchmark with the benchmark's numbers, an engine inside this
process, a tokenizer that ships with the package, and options that are plain choices. The person who checks has to allow
anything else: a game of an installed package, an engine that is its own program, another tokenizer.

Results of a submission: the mean of every game under every budget, from rows.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import fmean
from typing import Annotated, Any

from pydantic import AfterValidator, FailFast, Field, ValidationError, field_validator

from smartplay_tools.context.prompts.wording import versions
from smartplay_tools.context.tokens import DEFAULT_TOKENIZER
from smartplay_tools.context.tokens.tokenizers import split_rule
from smartplay_tools.episode.config import CellConfig, EpisodeConfig, Setting
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, in_one_line
from smartplay_tools.evaluation.board.submissions.bundle import Finding, error, some
from smartplay_tools.evaluation.board.submissions.metadata import CellResult
from smartplay_tools.evaluation.run_folder.folder import Manifest, ManifestEpisode, trial_seed
from smartplay_tools.evaluation.suites import SUITES, Suite
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.rows import Row, grouped, mean_score
from smartplay_tools.transcript.hashing import canonical_json

ENGINES_HERE = (None, "fast", "crafter", "voxel")
"""Engines that play inside of the process; any other one is a program that would be started."""

PLAIN_OPTIONS = ("text", "split", "sentences", "start")
"""Options of games that are words; another one may be a path or a size."""

TOKENIZERS = (DEFAULT_TOKENIZER, "approximate")
"""Tokenizers that need no file and no download."""

MOST_EPISODES = 65_000
MOST_CELLS = 5_000

MOST_CELL_BYTES = 32 << 10
"""The JSON of a cell, the player's options included; every record and every row repeats them."""

MOST_PRICE_BYTES = 4 << 10
"""The JSON of the prices: one, of one player."""


@dataclass(frozen=True)
class Allowed:
    """What a replay may use in addition to what is always safe."""

    engines: Sequence[str] = ()
    """Engines that are separate programs."""
    plugins: bool = False
    """Games of installed packages, which are imported for it."""
    tokenizer: str | None = None
    """The tokenizer to count with; the records have to name its vocabulary."""


def _small(cell: CellConfig) -> CellConfig:
    size = len(canonical_json(cell.to_json()))
    if size > MOST_CELL_BYTES:
        raise ValueError(f"a cell, with its player's options, has {size:,} bytes; {MOST_CELL_BYTES:,} are allowed")
    return cell


class SubmittedPlan(Manifest):
    """The manifest of a whole run, of a size that can be checked."""

    cells: Annotated[
        tuple[Annotated[CellConfig, AfterValidator(_small)], ...],
        FailFast(),
        Field(min_length=1, max_length=MOST_CELLS),
    ]
    episodes: Annotated[tuple[ManifestEpisode, ...], FailFast(), Field(min_length=1, max_length=MOST_EPISODES)]
    shard: None
    run_file: None = None
    game_files: None = None
    strategy_files: None = None
    spending: None = None

    @field_validator("prices", mode="before")
    @classmethod
    def _are_few(cls, prices: Any) -> Any:
        if len(canonical_json(prices)) > MOST_PRICE_BYTES:
            raise ValueError(f"they have more than {MOST_PRICE_BYTES:,} bytes")
        return prices

    def config(self, episode: ManifestEpisode) -> EpisodeConfig:
        """Return the config of an episode, which shares the parts of its cell."""
        return EpisodeConfig.model_construct(**dict(self.cells[episode.cell]), seed=episode.seed)

    @cached_property
    def digests(self) -> list[str]:
        """The digests of the cells."""
        return [cell.digest for cell in self.cells]


def read_plan(manifest: Any) -> SubmittedPlan:
    """Return the plan in a manifest; an invalid one is an `InvalidArgumentError` that names the field."""
    try:
        return SubmittedPlan.model_validate(manifest)
    except ValidationError as invalid:
        raise InvalidArgumentError(f"manifest.json, {in_one_line(invalid)}.") from None


@dataclass
class CheckedPlan:
    """What was found in a plan, and which of its cells may be replayed."""

    findings: list[Finding] = field(default_factory=list)
    replayable: set[int] = field(default_factory=set)
    """Numbers of cells."""


def check_plan(plan: SubmittedPlan, allowed: Allowed) -> CheckedPlan:
    """Check cells, keys and seeds of a plan."""
    checked = CheckedPlan()
    for number, cell in enumerate(plan.cells):
        faults = list(_unsafe(cell, allowed))
        checked.findings += faults
        if not faults:
            checked.replayable.add(number)
    players = {(cell.player, repr(cell.player_options)) for cell in plan.cells}
    if len(players) > 1:
        text = f"The run has {len(players)} players; a submission has one player, with one set of options."
        checked.findings.append(error("plan", text))
    checked.findings += _check_episodes(plan, checked.replayable)
    return checked


def _unsafe(cell: CellConfig, allowed: Allowed) -> Iterator[Finding]:
    """Yield why a cell is not replayed."""
    game = cell.game[:100]
    if cell.game_file is not None:
        yield error("plan", f"{game} was played from the file {cell.game_file[:100]!r}; files are not imported.")
        return
    if not GAMES.is_loaded(cell.game) and not allowed.plugins:
        yield error(
            "engine", f"{game!r} is not a setting of the benchmark; --plugins replays games of installed packages."
        )
        return
    try:
        registered = Setting.of(GAMES[cell.game])
    except SmartPlayError as unregistered:
        yield error("engine", str(unregistered))
        return
    if Setting.model_validate_json(registered.model_dump_json()) != cell.setting:
        yield error("plan", f"{game} was played with other numbers than the benchmark's: {cell.setting!r}.")
    if cell.engine not in (*ENGINES_HERE, *allowed.engines):
        yield error(
            "engine", f"{game} was played on the engine {cell.engine!r}, a program that --engine NAME allows to start."
        )
    if unsafe := {name: value for name, value in cell.options.items() if not _is_plain(name, value)}:
        yield error("plan", f"{game} was played with the options {unsafe!r}, which are not replayed.")
    if (strategy := cell.budget.strategy) is not None and (".py:" in strategy or not allowed.plugins):
        yield error(
            "plan",
            f"{game} was played with the strategy {strategy[:100]!r}; those of installed packages alone are replayed, "
            "with --plugins.",
        )
    if split_rule(cell.tokenizer)[0] not in TOKENIZERS and allowed.tokenizer is None:
        yield error(
            "plan", f"{game} was counted with the tokenizer {cell.tokenizer!r}; name it with --tokenizer to replay it."
        )
    if cell.prompts not in versions():
        yield error(
            "plan", f"{game} has prompts {cell.prompts!r}; this version knows {', '.join(map(repr, versions()))}."
        )


def _is_plain(name: str, value: Any) -> bool:
    return name in PLAIN_OPTIONS and isinstance(value, str) and len(value) <= 22


def _check_episodes(plan: SubmittedPlan, replayable: set[int]) -> Iterator[Finding]:
    keys = Counter(episode.key for episode in plan.episodes)
    if doubled := [key for key, count in keys.items() if count > 1]:
        yield error("plan", f"The manifest lists episodes twice: {some(doubled)}.")
    episodes = grouped(plan.episodes, lambda episode: episode.cell)
    for number, cell in enumerate(plan.cells):
        members = episodes.get(number, [])
        for episode in members:
            if episode.seed != trial_seed(plan.seed, cell.game, episode.trial):
                text = f"Trial {episode.trial} of {cell.game} has a seed that does not follow from the run's."
                yield error("seed", text, episode.key)
        if number in replayable:
            for episode, key in zip(members, cell.episode_keys(episode.seed for episode in members), strict=True):
                if episode.key != key:
                    yield error("plan", "The manifest gives an episode a key that is not its config's.", episode.key)
        if not members or sorted(episode.trial for episode in members) != list(range(len(members))):
            yield error("plan", f"The trials of cell {number} ({cell.game}) are not 0, 1, 2 and so on.")


def check_suite(plan: SubmittedPlan, name: str | None, kind: str) -> Iterator[Finding]:
    """Check that a plan covers the suite that it names; a standard submission has to follow a fixed suite."""
    suite = SUITES.get(name or "")
    if name is not None and suite is None:
        yield error("suite", f"There is no suite {name!r}; the suites are {', '.join(SUITES)}.")
        return
    if kind == "standard" and (suite is None or not suite.is_fixed):
        fixed = ", ".join(name for name, each in SUITES.items() if each.is_fixed)
        yield error("suite", f"A standard submission is a run of a fixed suite ({fixed}); another one is custom.")
    if suite is not None:
        yield from _check_fixed(plan, suite) if suite.is_fixed else _check_games(plan, suite)


def _check_games(plan: SubmittedPlan, suite: Suite) -> Iterator[Finding]:
    if missing := set(suite.games) - {cell.game for cell in plan.cells}:
        yield error("suite", f"The suite {suite.name} is not covered: {some(sorted(missing))} is missing.")


def _check_fixed(plan: SubmittedPlan, suite: Suite) -> Iterator[Finding]:
    first = plan.cells[0]
    # A suite is played under the newest version of the prompts, and was under an earlier one before.
    cells = suite.cells(first.player, first.player_options)
    in_version = [cell.model_copy(update={"prompts": first.prompts}) for cell in cells]
    expected = {cell.digest: cell for cell in in_version}
    played = Counter(plan.digests[episode.cell] for episode in plan.episodes if episode.cell < len(plan.cells))
    for digest, cell in expected.items():
        name = f"{cell.game} with {cell.budget.describe() or 'the default budget'}"
        trials = suite.trials[cell.game]
        if played[digest] != trials:
            yield error("suite", f"{suite.name} has {trials} episodes of {name}; the run has {played[digest]}.")
    if others := [cell.game for cell, digest in zip(plan.cells, plan.digests, strict=True) if digest not in expected]:
        yield error(
            "suite",
            f"{len(others)} cells of the run differ from {suite.name} in rules, budget or engine: {some(others)}.",
        )


DIGITS = 6


def by_cell(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """Return rows by their game and by what was asked for in their budget, as JSON."""
    return grouped(rows, lambda row: (row["game"], json.dumps(row["asked"], sort_keys=True)))


def cell_results(rows: Iterable[Row]) -> list[CellResult]:
    """Return a result for every game and budget that was asked for, in the order of the rows."""
    return [_result(game, members) for (game, _), members in by_cell(rows).items()]


def normalized_scores(rows: Iterable[Row]) -> list[float]:
    """Return the normalised scores of a cell; none if an episode has none."""
    scores = [row["normalized_score"] for row in rows]
    return [] if None in scores else scores


def total_cost(rows: Iterable[Row]) -> float | None:
    """Return the cost of all episodes in US dollars; None where it is not known."""
    costs = [row["cost"] for row in rows]
    return None if None in costs else math.fsum(costs)


def _result(game: str, rows: list[Row]) -> CellResult:
    normalized, cost = normalized_scores(rows), total_cost(rows)
    return CellResult(
        game=game,
        budget=rows[0]["asked"],
        episodes=len(rows),
        score=round(fmean(map(mean_score, rows)), DIGITS),
        normalized_score=round(fmean(normalized), DIGITS) if normalized else None,
        cost=None if cost is None else round(cost, DIGITS),
    )
