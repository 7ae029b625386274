"""A function that is called as soon as Gymnasium has been imported, without importing it before anybody needs it.

Every setting is also an environment of Gymnasium, `smartplay/<id>`. Since version 1.0 Gymnasium has no plugins: a
package registers its environments when it is imported. This package is imported in milliseconds, and Gymnasium in half
a second, so the settings are registered at once where Gymnasium is there already, and otherwise right after its import.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from importlib.abc import Loader

GYMNASIUM = "gymnasium"


def gymnasium_is_ready() -> bool:
    """Return whether Gymnasium has finished importing."""
    module = sys.modules.get(GYMNASIUM)
    return module is not None and not getattr(module.__spec__, "_initializing", False)


def when_gymnasium_is_imported(register: Callable[[], None]) -> None:
    """Call a function once: now if Gymnasium has been imported, otherwise right after its import."""
    if gymnasium_is_ready():
        register()
    else:
        sys.meta_path.insert(0, _AfterImport(register))


class _AfterImport:
    """A finder that finds Gymnasium by the other finders, and gives it a loader that calls a function afterwards.

    Looking for Gymnasium is not importing it: programs look for a package to learn whether it is installed. So the
    finder stays until the loader has run.
    """

    def __init__(self, register: Callable[[], None]) -> None:
        self.register = register

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return None for other modules; for Gymnasium, what the other finders find, with the loader."""
        if name != GYMNASIUM:
            return None
        others = [finder for finder in sys.meta_path if finder is not self]
        found = (finder.find_spec(name, path, target) for finder in others)
        spec = next((spec for spec in found if spec is not None), None)
        if spec is not None and spec.loader is not None:
            spec.loader = cast("Loader", _Registering(spec.loader, self))
        return spec


class _Registering:
    """A loader that runs another one, and then calls the finder's function."""

    def __init__(self, loader: Any, finder: _AfterImport) -> None:
        self._loader, self._finder = loader, finder

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module with its own loader, which it keeps; then take the finder out and call its function."""
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        if self._finder in sys.meta_path:
            sys.meta_path.remove(self._finder)
            self._finder.register()
