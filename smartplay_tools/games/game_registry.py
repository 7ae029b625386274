"""The registry of settings by id: those of the benchmark, of the running program, and of installed packages.

An installed package declares a setting as an entry point of the group `smartplay_tools.games`, whose name is the
setting's id and whose value is its `GameSpec`. Names are read from the packages' metadata, which imports nothing; the
package itself is imported when its setting is asked for. Every setting is a Gymnasium environment too, as
`smartplay/<id>`, from the moment when both packages are imported (`gymnasium_names`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from smartplay_tools.errors import InvalidArgumentError, UnknownNameError
from smartplay_tools.games.gymnasium_names import gymnasium_is_ready
from smartplay_tools.registry import declared_in, load_declared, package_of

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    import gymnasium

    from smartplay_tools.games.specs import GameSpec

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


class Games(Mapping[str, "GameSpec"]):
    """The settings by id, the benchmark's first. An unknown id raises `UnknownNameError`, a `KeyError`."""

    def __init__(self, benchmark: Iterable[GameSpec]) -> None:
        self._specs = {spec.id: spec for spec in benchmark}
        self._benchmark = frozenset(self._specs)

    def __getitem__(self, game: str) -> GameSpec:
        if game not in self._specs:
            for declared in self._declared():
                if declared.name == game and not _IMPORTS.get():
                    raise PackageNotImportedError(declared)
                if declared.name == game:
                    return self.register(_load(declared))
            raise UnknownNameError("game", game, self)
        return self._specs[game]

    def __iter__(self) -> Iterator[str]:
        yield from dict.fromkeys([*self._specs, *sorted(declared.name for declared in self._declared())])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self)})"

    def is_loaded(self, game: str) -> bool:
        """Return whether a setting is the benchmark's or was registered here, so that nothing is imported for it."""
        return game in self._specs

    def register(self, spec: GameSpec) -> GameSpec:
        """Add a setting, or replace one that was added before; those of the benchmark cannot be replaced."""
        if not ID.fullmatch(spec.id):
            raise InvalidArgumentError(
                f"{spec.id!r} cannot be an id: write letters, digits and a version, as in Nim-v0."
            )
        if spec.id in self._benchmark:
            raise InvalidArgumentError(f"{spec.id} is a setting of the benchmark; give yours an id of its own.")
        self._specs[spec.id] = spec
        if gymnasium_is_ready():
            _register_with_gymnasium(spec)
        return spec

    def added(self) -> list[str]:
        """Return the settings beyond the benchmark's that were registered or loaded in this process."""
        return [game for game in self._specs if game not in self._benchmark]

    def is_declared(self, game: str) -> bool:
        """Return whether a setting is the benchmark's or an installed package's, and so known in every process."""
        return game in self._benchmark or any(declared.name == game for declared in self._declared())

    def tell_gymnasium(self) -> None:
        """Register every setting with Gymnasium; settings that packages declare, by name only."""
        for spec in self._specs.values():
            _register_with_gymnasium(spec)
        for declared in self._declared():
            if declared.name not in self._specs:
                _announce_to_gymnasium(declared, self)

    def _declared(self) -> list[EntryPoint]:
        """The settings that installed packages declare, without those that have an id of the benchmark."""
        return [point for point in declared_in(ENTRY_POINTS) if point.name not in self._benchmark]


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
    keywords = {"history": spec.history, **spec.kwargs}
    _tell_gymnasium(
        spec.id,
        spec.gymnasium_entry_point or spec.entry_point,
        kwargs=keywords,
        max_episode_steps=spec.rollout,
    )


def _announce_to_gymnasium(declared: EntryPoint, games: Games) -> None:
    """Register only the name in Gymnasium: the first `make` imports the package and registers the setting itself."""

    def make(**options: Any) -> gymnasium.Env[str, Any]:
        from gymnasium.wrappers import TimeLimit

        spec = games[declared.name]
        return TimeLimit(spec.make(**options), spec.rollout)

    if ID.fullmatch(declared.name):
        _tell_gymnasium(declared.name, make)


def _tell_gymnasium(name: str, creator: Any, **facts: Any) -> None:
    import gymnasium

    name = f"smartplay/{name}"
    gymnasium.registry.pop(name, None)  # Gymnasium warns if a name is registered twice
    gymnasium.register(name, creator, **facts)
