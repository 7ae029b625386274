"""What a setting is, and the registry of settings by id: of the benchmark, the running program, installed packages.

An installed package declares a setting as an entry point of the group `smartplay_tools.games`, whose name is the
setting's id and whose value is its `GameSpec`. Names are read from the packages' metadata, which imports nothing; the
package itself is imported when its setting is asked for. Every setting is a Gymnasium environment too, as
`smartplay/<id>`, from the moment when both packages are imported (`gymnasium_names`).
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, fields
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal

from smartplay_tools.errors import InvalidArgumentError, UnknownNameError, warned_if_not_closed
from smartplay_tools.games.gymnasium_names import gymnasium_is_ready
from smartplay_tools.games.paper_tables import normalize
from smartplay_tools.registry import declared_in, load_declared, package_of, resolve

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from smartplay_tools.games.base import TextGame

__all__ = ["Pack"]

ENTRY_POINTS = "smartplay_tools.games"
"""The group under which other packages declare settings."""

ID = re.compile(r"[A-Za-z0-9]\w*(?:[-.]\w+)*-v\d+", flags=re.ASCII)
"""The format of an id: Gymnasium's name and version, in characters that a file name may have."""


_IMPORTS: ContextVar[bool] = ContextVar("imports", default=True)
"""Whether a setting that an installed package declares is imported when it is asked for."""


@contextmanager
def importing_packages(allowed: bool) -> Iterator[None]:
    """Decide, for the code in this context, whether the settings of installed packages are imported.

    Records come from strangers, and a name in one must not import a package that its reader did not ask for. Settings
    that the program has already registered or loaded are known in any case.
    """
    before = _IMPORTS.set(allowed)
    try:
        yield
    finally:
        _IMPORTS.reset(before)


def packages_are_imported() -> bool:
    """Return whether the code in this context trusts the names in records."""
    return _IMPORTS.get()


class PackageNotImportedError(UnknownNameError):
    """A setting is declared by an installed package that must not be imported."""

    def __init__(self, declared: EntryPoint) -> None:
        super().__init__("game", declared.name, ())
        self.message = f"{declared.name} is a game of the package {package_of(declared)}; --plugins imports it."


@dataclass(frozen=True, kw_only=True)
class Scoring:
    """What the scores of a setting can be, as statistics need it; the record of an episode holds it.

    `rollout` is the number of steps, and `human_score` and `min_score` are those that normalise a score.
    `score_bounds` are the lowest and the highest score that an episode can have, if they are close enough to be of use,
    and `two_valued` says that every score is one of the two: intervals follow from them.
    `worst_step` is the least that a step adds to the score; None where the score is that of a final state, as in Hanoi.
    `best_step` is the most that a step adds to it, and `points_of_step` are the least and the most that a step pays:
    with a cap on calls, scores and points cannot be further apart than these allow.
    """

    rollout: int
    human_score: float | None = None
    min_score: float | None = None
    score_bounds: tuple[float, float] | None = None
    two_valued: bool = False
    worst_step: float | None = None
    best_step: float | None = None
    points_of_step: tuple[float, float] | None = None

    def bounds_in(self, steps: int) -> tuple[float, float] | None:
        """Return the lowest and the highest score that an episode of at most so many steps can have, if declared."""
        if self.score_bounds is None or self.best_step is None:
            return self.score_bounds
        low, high = self.score_bounds
        return low, max(low, min(high, min(steps, self.rollout) * self.best_step))

    def points_in(self, steps: int) -> tuple[float, float] | None:
        """Return the least and the most that an episode of at most so many steps can pay, if that is declared."""
        if self.points_of_step is None:
            return None
        low, high = (min(steps, self.rollout) * points for points in self.points_of_step)
        return min(low, 0), max(high, 0)

    def normalize(self, score: float) -> float | None:
        """The normalised score, or None if there is no human score."""
        if self.human_score is None or self.min_score is None:
            return None
        return normalize(score, self.human_score, self.min_score)

    def least_score(self, score: float, steps: int) -> float:
        """Return the least that an episode could have scored, had it not ended early with this score after `steps`."""
        lowest = -math.inf if self.score_bounds is None else self.score_bounds[0]
        if self.worst_step is not None:
            return max(lowest, score + (self.rollout - steps) * self.worst_step)
        return score if self.score_bounds is None else min(lowest, score)

    def scoring(self) -> dict[str, Any]:
        """Return these facts as plain data, without those at their defaults."""
        known = {each.name: getattr(self, each.name) for each in fields(Scoring)}
        return {name: value for name, value in known.items() if value is not None and value is not False}


@dataclass(frozen=True, kw_only=True)
class GameSpec(Scoring):
    """One setting: a game and its parameters.

    `entry_point` is the game's class or its location ("module:Class"), and `kwargs` are its arguments. `history`
    (past steps shown), `rollout` (steps) and `trials` are, for the benchmark's own, the paper's (table
    `table:environments`); `human_score` and `min_score` (table `table:llm_perf_absolute`) exist for the settings that
    people played for the paper. `challenges` rates how much of each capability the game requires; a setting without
    ratings is not part of the capability scores. What scores can be is explained at `Scoring`.

    `memory` is the number of past steps that the right action depends on, "all", or None for unknown.

    `file` and `sha256` are the name (`FILE.py:NAME`) and the digest of the file that the setting was read from, if the
    user has named it so; they are not given.

    `action_count` is how many actions the game has, for lists of settings; without it the class is asked.
    `gymnasium_entry_point` ("module:name") says what `gymnasium.make` gives if that is more than the text game.
    """

    id: str
    family: str
    entry_point: str | type[TextGame]
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    history: int
    trials: int
    challenges: Mapping[str, int] = field(default_factory=dict)
    memory: int | Literal["all"] | None = None
    action_count: int | None = None
    gymnasium_entry_point: str | None = None
    file: str | None = None
    sha256: str | None = None

    def load(self) -> type[TextGame]:
        """Import and return the game's class."""
        if not isinstance(self.entry_point, str):
            return self.entry_point
        game: type[TextGame] = resolve(self.entry_point)
        return game

    def make(self, **options: Any) -> TextGame:
        """Build the game. `options` override the setting's own keyword arguments."""
        return self.load()(**{"history": self.history, **self.kwargs, **options})

    def count_actions(self) -> int:
        """Return how many actions the game has."""
        return len(self.load().actions) if self.action_count is None else self.action_count

    def __getstate__(self) -> dict[str, Any]:
        # The benchmark's ratings are read-only views, which do not pickle.
        return {**vars(self), "challenges": dict(self.challenges)}


def close_game(game: TextGame) -> None:
    """Close a game, whose environment or engine may raise anything: that is a `ClosingWarning`."""
    with warned_if_not_closed(f"The game {type(game).__name__}"):
        game.close()


PACKS = (
    "smartplay_tools.games.specs:LOCKERS",
    "smartplay_popgym:CARDS",
    "smartplay_minigrid:ROOMS",
)
"""The packs of games that come with this package and are not the benchmark's."""


@dataclass(frozen=True)
class Pack:
    """Settings beyond the benchmark's; their environments may be another package's, which an extra installs."""

    extra: str | None
    packages: tuple[str, ...]
    """What has to be installed to play them."""
    settings: tuple[GameSpec, ...]

    @property
    def is_installed(self) -> bool:
        """Whether they can be played here."""
        return all(find_spec(package) is not None for package in self.packages)


@functools.cache
def _packs() -> tuple[Pack, ...]:
    """The packs that are there: the core of this package works without its adapters."""
    return tuple(resolve(place) for place in PACKS if find_spec(place.partition(":")[0]) is not None)


class Games(Mapping[str, GameSpec]):
    """The settings by id, the benchmark's first. An unknown id raises `UnknownNameError`, a `KeyError`."""

    def __init__(self, benchmark: Iterable[GameSpec]) -> None:
        self._specs = {spec.id: spec for spec in benchmark}
        self.benchmark = frozenset(self._specs)
        """The ids of the paper's settings."""

    def __getitem__(self, game: str) -> GameSpec:
        if game in self._specs:
            return self._specs[game]
        if game not in self._packed:
            for declared in self._declared():
                if declared.name == game and not _IMPORTS.get():
                    raise PackageNotImportedError(declared)
                if declared.name == game:
                    return self.register(_load(declared))
            raise UnknownNameError("game", game, self, " The command `smartplay-tools games` lists all.")
        return self._packed[game]

    def __iter__(self) -> Iterator[str]:
        declared = sorted(declared.name for declared in self._declared())
        yield from dict.fromkeys([*self._specs, *self._installed(), *declared])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self)})"

    def is_loaded(self, game: str) -> bool:
        """Return whether a setting is this package's or was registered here, so that nothing foreign is imported."""
        return game in self._specs or game in self._packed

    def register(self, spec: GameSpec) -> GameSpec:
        """Add a setting, or replace one that was added before; those of the benchmark cannot be replaced."""
        if not ID.fullmatch(spec.id):
            raise InvalidArgumentError(
                f"{spec.id!r} cannot be an id: write letters, digits and a version, as in Nim-v0."
            )
        if spec.id in self.benchmark:
            raise InvalidArgumentError(f"{spec.id} is a setting of the benchmark; give yours another id.")
        self._specs[spec.id] = spec
        if gymnasium_is_ready():
            _register_with_gymnasium(spec)
        return spec

    def added(self) -> list[str]:
        """Return the settings beyond the benchmark's that were registered or loaded in this process."""
        return [game for game in self._specs if game not in self.benchmark]

    def is_declared(self, game: str) -> bool:
        """Return whether a setting is this or another installed package's, and so known in every process."""
        return (
            game in self.benchmark
            or game in self._packed
            or any(declared.name == game for declared in self._declared())
        )

    def tell_gymnasium(self) -> None:
        """Register every setting with Gymnasium; settings that packages declare, by name only."""
        for spec in {**self._installed(), **self._specs}.values():
            _register_with_gymnasium(spec)
        for declared in self._declared():
            if declared.name not in self._specs:
                _announce_to_gymnasium(declared, self)

    @functools.cached_property
    def _packed(self) -> dict[str, GameSpec]:
        """The settings of all packs: they are known where they cannot be played, so that their results can be read."""
        return {spec.id: spec for pack in _packs() for spec in pack.settings}

    def _installed(self) -> dict[str, GameSpec]:
        """The settings of the packs that can be played here."""
        return {spec.id: spec for pack in _packs() if pack.is_installed for spec in pack.settings}

    def _declared(self) -> list[EntryPoint]:
        """The settings that installed packages declare, without those that have an id of the benchmark."""
        return [point for point in declared_in(ENTRY_POINTS) if point.name not in self.benchmark]


def _load(declared: EntryPoint) -> GameSpec:
    """Import the setting that a package declares."""
    spec = load_declared("game", declared)
    if getattr(spec, "id", None) != declared.name:
        raise InvalidArgumentError(
            f"The game {declared.name} of the package {package_of(declared)} is invalid: {declared.value} is not a "
            "GameSpec of that id."
        )
    setting: GameSpec = spec
    return setting


def _register_with_gymnasium(spec: GameSpec) -> None:
    import gymnasium

    name = f"smartplay/{spec.id}"
    creator: Any = spec.gymnasium_entry_point or spec.entry_point
    gymnasium.registry.pop(name, None)  # Gymnasium warns if a name is registered twice
    gymnasium.register(
        name,
        creator,
        kwargs=_with_lists({"history": spec.history, **spec.kwargs}),
        max_episode_steps=spec.rollout,
    )


def _with_lists(value: Any) -> Any:
    """Return arguments with lists in place of tuples, as Gymnasium reads a specification from JSON."""
    if isinstance(value, Mapping):
        return {name: _with_lists(each) for name, each in value.items()}
    return [*map(_with_lists, value)] if isinstance(value, list | tuple) else value


def _announce_to_gymnasium(declared: EntryPoint, games: Games) -> None:
    """Register only the name in Gymnasium: the package is imported when anything else is asked of its setting."""
    from gymnasium import registry
    from gymnasium.envs.registration import EnvSpec

    class DeclaredSpec(EnvSpec):
        """A specification that becomes a usual one with the first question beyond its name."""

        def __getattribute__(self, name: str) -> Any:
            if name not in ("id", "namespace", "name", "version"):
                _register_with_gymnasium(games[declared.name])  # imports the package
                facts = vars(registry[f"smartplay/{declared.name}"])
                object.__setattr__(self, "__class__", EnvSpec)
                self.__dict__.update(facts)
            return object.__getattribute__(self, name)

    if ID.fullmatch(declared.name):
        spec = EnvSpec(f"smartplay/{declared.name}")
        spec.__class__ = DeclaredSpec
        registry[spec.id] = spec
