"""The plan of a submitted run: which cells and episodes its manifest lists, and whether they may be replayed here.

A config from a stranger decides what a replay imports, reads and allocates. So nothing is replayed before its config is
found to be of a kind that is safe: a setting of the benchmark with the benchmark's numbers, an engine inside this
process, a tokenizer that ships with the package, and options that are plain choices. The person who checks has to allow
anything else: a game of an installed package, an engine that is a program of its own, another tokenizer.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from smartplay_tools import prompts
from smartplay_tools.episode.config import CellConfig, EpisodeConfig, Setting
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, in_one_line
from smartplay_tools.evaluation.board.submissions.findings import Finding, error, some
from smartplay_tools.evaluation.suites import SUITES, Suite
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.prices import Price
from smartplay_tools.records.seeds import trial_seed
from smartplay_tools.tokens import DEFAULT_TOKENIZER

ENGINES_HERE = (None, "fast", "crafter", "voxel")
"""Engines that play inside of the process; any other one is a program that would be started."""

PLAIN_OPTIONS = ("text", "split", "sentences")
"""Options of games that are words; another one may be a path or a size."""

TOKENIZERS = (DEFAULT_TOKENIZER, "approximate")
"""Tokenizers that need no file and no download."""

MOST_EPISODES = 65_000
MOST_CELLS = 5_000


@dataclass(frozen=True)
class Allowed:
    """What a replay may use in addition to what is always safe."""

    engines: Sequence[str] = ()
    """Engines that are programs of their own."""
    plugins: bool = False
    """Games of installed packages, which are imported for it."""
    tokenizer: str | None = None
    """The tokenizer to count with; the records have to name its vocabulary."""


class PlannedEpisode(BaseModel):
    """An episode in a manifest."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    key: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    cell: Annotated[int, Field(ge=0)]
    trial: Annotated[int, Field(ge=0)]
    seed: Annotated[int, Field(ge=0, lt=2**31)]


class SubmittedPlan(BaseModel):
    """What a manifest says of its run."""

    model_config = ConfigDict(frozen=True, extra="ignore", arbitrary_types_allowed=True)

    format: Literal[1]
    seed: Annotated[int, Field(ge=0)]
    cells: Annotated[list[CellConfig], Field(min_length=1, max_length=MOST_CELLS)]
    episodes: Annotated[list[PlannedEpisode], Field(min_length=1, max_length=MOST_EPISODES)]
    shard: None
    prices: dict[str, dict[str, Any]] = {}

    def config(self, episode: PlannedEpisode) -> EpisodeConfig:
        """Return the config of an episode."""
        return self.cells[episode.cell].with_seed(episode.seed)

    def price(self, player: str | None) -> Price | None:
        """Return the price of a player's tokens as the manifest gives it; None where it gives none that can be read."""
        try:
            return Price.from_json(self.prices[player or ""])
        except (KeyError, TypeError, ValueError):
            return None


def read_plan(manifest: Any) -> SubmittedPlan:
    """Return the plan in a manifest; one that is none is an `InvalidArgumentError` that names the field."""
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
    found = CheckedPlan()
    for number, cell in enumerate(plan.cells):
        faults = list(_unsafe(cell, allowed))
        found.findings += faults
        if not faults:
            found.replayable.add(number)
    found.findings += _check_players(plan)
    found.findings += _check_episodes(plan, found.replayable)
    return found


def _unsafe(cell: CellConfig, allowed: Allowed) -> Iterator[Finding]:
    """Yield why a cell is not replayed."""
    game = cell.game[:100]
    if not GAMES.is_loaded(cell.game) and not allowed.plugins:
        yield error(
            "engine", f"{game!r} is not a setting of the benchmark; --plugins replays games of installed packages."
        )
        return
    try:
        known = Setting.of(GAMES[cell.game])
    except SmartPlayError as unknown:
        yield error("engine", str(unknown))
        return
    if Setting.model_validate_json(known.model_dump_json()) != cell.setting:
        yield error("plan", f"{game} was played with other numbers than the benchmark's: {cell.setting!r}.")
    if cell.engine not in (*ENGINES_HERE, *allowed.engines):
        yield error(
            "engine", f"{game} was played on the engine {cell.engine!r}, a program that --engine NAME allows to start."
        )
    if unsafe := {name: value for name, value in cell.options.items() if not _is_plain(name, value)}:
        yield error("plan", f"{game} was played with the options {unsafe!r}, which are not replayed.")
    if cell.tokenizer not in TOKENIZERS and allowed.tokenizer is None:
        yield error(
            "plan", f"{game} was counted with the tokenizer {cell.tokenizer!r}; name it with --tokenizer to replay it."
        )
    if cell.prompts != prompts.VERSION:
        yield error("plan", f"{game} has prompts {cell.prompts!r}; this version knows {prompts.VERSION!r}.")


def _is_plain(name: str, value: Any) -> bool:
    return name in PLAIN_OPTIONS and isinstance(value, str) and len(value) <= 22


def _check_players(plan: SubmittedPlan) -> Iterator[Finding]:
    players = {(cell.player, repr(cell.player_options)) for cell in plan.cells}
    if len(players) > 1:
        yield error(
            "plan", f"The run has {len(players)} players; a submission has one player, with one set of options."
        )


def _check_episodes(plan: SubmittedPlan, replayable: set[int]) -> Iterator[Finding]:
    keys = Counter(episode.key for episode in plan.episodes)
    if doubled := [key for key, count in keys.items() if count > 1]:
        yield error("plan", f"The manifest lists episodes twice: {some(doubled)}.")
    trials: dict[int, list[int]] = {number: [] for number in range(len(plan.cells))}
    for episode in plan.episodes:
        if episode.cell not in trials:
            yield error(
                "plan", f"The manifest gives an episode the cell {episode.cell}, which it does not list.", episode.key
            )
            continue
        cell = plan.cells[episode.cell]
        trials[episode.cell].append(episode.trial)
        if episode.seed != trial_seed(plan.seed, cell.game, episode.trial):
            yield error(
                "seed",
                f"Trial {episode.trial} of {cell.game} has a seed that does not follow from the run's.",
                episode.key,
            )
        if episode.cell in replayable and plan.config(episode).key != episode.key:
            yield error("plan", "The manifest gives an episode a key that is not its config's.", episode.key)
    for number, found in trials.items():
        if sorted(found) != list(range(len(found))) or not found:
            yield error("plan", f"The trials of cell {number} ({plan.cells[number].game}) are not 0, 1, 2 and so on.")


def check_suite(plan: SubmittedPlan, name: str | None, kind: str) -> Iterator[Finding]:
    """Check that a plan covers the suite that it names; a standard submission has to follow a fixed suite."""
    suite = SUITES.get(name or "")
    if name is not None and suite is None:
        yield error("suite", f"There is no suite {name!r}; the suites are {', '.join(SUITES)}.")
        return
    if kind == "standard" and (suite is None or not suite.is_fixed):
        fixed = ", ".join(one.name for one in SUITES.values() if one.is_fixed)
        yield error("suite", f"A standard submission is a run of a fixed suite ({fixed}); another one is custom.")
    if suite is not None:
        yield from _check_fixed(plan, suite) if suite.is_fixed else _check_games(plan, suite)


def _check_games(plan: SubmittedPlan, suite: Suite) -> Iterator[Finding]:
    if missing := set(suite.games) - {cell.game for cell in plan.cells}:
        yield error("suite", f"The suite {suite.name} is not covered: {some(sorted(missing))} is missing.")


def _check_fixed(plan: SubmittedPlan, suite: Suite) -> Iterator[Finding]:
    first = plan.cells[0]
    expected = {cell.digest: cell for cell in suite.cells(first.player, first.player_options)}
    played = Counter(_digest_at(plan, episode.cell) for episode in plan.episodes)
    for digest, cell in expected.items():
        name = f"{cell.game} with {cell.budget.describe() or 'the default budget'}"
        trials = suite.trials[cell.game]
        if played[digest] != trials:
            yield error("suite", f"{suite.name} has {trials} episodes of {name}; the run has {played[digest]}.")
    if others := [cell.game for cell in plan.cells if cell.digest not in expected]:
        yield error(
            "suite",
            f"{len(others)} cells of the run differ from {suite.name} in rules, budget or engine: {some(others)}.",
        )


def _digest_at(plan: SubmittedPlan, number: int) -> str | None:
    return plan.cells[number].digest if number < len(plan.cells) else None
