"""The names of the settings in Gymnasium, `smartplay/<id>`, without importing Gymnasium before anybody needs it.

Gymnasium takes longer to import than all of this package, and it has no plugins: since version 1.0 a package that is
imported has to register its environments itself. So they are registered at once where Gymnasium is imported already,
and otherwise right after it has been.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from importlib.abc import Loader

GYMNASIUM = "gymnasium"


def gymnasium_is_ready() -> bool:
    """Whether Gymnasium has finished importing."""
    module = sys.modules.get(GYMNASIUM)
    return module is not None and not getattr(module.__spec__, "_initializing", False)


def announce_games() -> None:
    """Register the settings with Gymnasium, now or as soon as it is imported."""
    if gymnasium_is_ready():
        _register()
    elif not any(isinstance(finder, _AfterImport) for finder in sys.meta_path):
        sys.meta_path.insert(0, _AfterImport())


def _register() -> None:
    from smartplay_tools.games.specs import GAMES

    GAMES.tell_gymnasium()


class _AfterImport:
    """A finder that waits for the import of Gymnasium, leaves it to the others, and then registers the settings."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return None for other modules; for Gymnasium, what the other finders return, with a loader that registers."""
        if name != GYMNASIUM:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader = cast("Loader", _Registering(spec.loader))
        return spec


class _Registering:
    """A loader that runs another one, and then registers the settings."""

    def __init__(self, loader: Any) -> None:
        self._loader = loader

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module with its own loader, which it keeps, and register the settings."""
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        _register()
