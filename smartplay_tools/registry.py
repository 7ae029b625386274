"""Registry: things by name, each given as the place where it is found, "module:attribute".

Players, executors, Minecraft's engines and the classes of games are found this way, so none of them is imported before
it is asked for. A registry may have a group of entry points too, under which installed packages declare more things;
their names are read from the packages' metadata, which imports nothing.

`FILE.py:CLASS` names a class in a file of the user's, without a package around it. The name alone says where the class
is, so it goes to worker processes as text, and each imports the file itself. A file is known by its resolved path and
the digest of its content: one that was edited is imported again, and its earlier classes stay what they were.

`lazy_exports` gives a package names that are imported when they are first used, so that importing the package takes
milliseconds (PEP 562). The package lists them twice: for type checkers and editors as ordinary imports under
`TYPE_CHECKING`, and for Python as the table that it passes. A test keeps the two equal. For the same reason this module
imports what its functions need when they are called.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, UnknownNameError, in_one_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint
    from pathlib import Path
    from types import ModuleType

__all__ = ["lazy_exports"]


def resolve(place: str) -> Any:
    """Import and return what is at "module:attribute"."""
    from pkgutil import resolve_name

    return resolve_name(place)


def load_declared(kind: str, declared: EntryPoint) -> Any:
    """Import and return what an installed package declares; one that is broken is an `InvalidArgumentError`."""
    try:
        return declared.load()
    except SmartPlayError:
        raise
    except Exception as error:  # whatever a foreign package does when it is imported
        raise InvalidArgumentError(
            f"The {kind} {declared.name} of the package {package_of(declared)} cannot be loaded; "
            f"repair or remove the package: {error}"
        ) from error


def declared_in(group: str) -> Sequence[EntryPoint]:
    """Return what installed packages declare under a group, from their metadata."""
    from importlib.metadata import entry_points  # takes longer to import than a list of the games takes to print

    return list(entry_points(group=group))


def package_of(declared: EntryPoint) -> str:
    """Return the name of the package that declares an entry point."""
    return declared.dist.name if declared.dist else declared.value


def is_in_file(name: str) -> bool:
    """Return whether a name is that of a class in a file."""
    return name.rpartition(":")[0].endswith(".py")


class FileClass(NamedTuple):
    """A class that was read from a file of the user's."""

    make: Callable[..., Any]
    sha256: str
    """The digest of the file's content as it was imported."""


def read_file(name: str, kind: str = "player") -> FileClass:
    """Import the file of `FILE.py:CLASS` and return the class; `InvalidArgumentError` if it is not there.

    `kind` is what the class is called in messages.
    """
    from hashlib import sha256
    from pathlib import Path

    place, _, attribute = name.rpartition(":")
    path = Path(place)
    if not path.is_file():
        raise InvalidArgumentError(f"There is no file {path}; name a {kind} of your own as FILE.py:CLASS.")
    source = path.read_bytes()
    digest = sha256(source).hexdigest()
    held = getattr(_module(path, source, digest), attribute, None)
    if not callable(held):
        raise InvalidArgumentError(f"{path} has no class {attribute!r}; name a {kind} of it as {path}:CLASS.")
    return FileClass(held, digest)


def _module(path: Path, source: bytes, digest: str) -> ModuleType:
    """Return the module of a file with this content, imported once in each process, with its folder on `sys.path`.

    The content is compiled here: Python's cache would take a file of the same size and second for the same file.
    """
    from hashlib import sha256
    from importlib.util import module_from_spec, spec_from_file_location

    whole = path.resolve()
    name = f"smartplay_file_{sha256(f'{whole} {digest}'.encode()).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, whole)
    assert spec is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    if (folder := str(whole.parent)) not in sys.path:
        sys.path.append(folder)
    try:
        exec(compile(source, whole, "exec", dont_inherit=True), vars(module))
    except Exception as error:  # whatever the user's file does when it is imported
        del sys.modules[name]
        raise InvalidArgumentError(
            f"{path} cannot be imported: {type(error).__name__}: {in_one_line(error)}."
        ) from error
    return module


class Registry(Mapping[str, Any]):
    """Things of one kind by name, those of this package first. An unknown name raises `UnknownNameError`.

    Arguments:
        kind: what the things are called in messages.
        places: name -> "module:attribute".
        group: the group of entry points under which installed packages declare more; none of `places` can be taken.
    """

    def __init__(self, kind: str, places: Mapping[str, str], group: str | None = None) -> None:
        self._kind, self.places, self._group = kind, dict(places), group

    def __getitem__(self, name: str) -> Any:
        if name in self.places:
            return resolve(self.places[name])
        for declared in self._declared():
            if declared.name == name:
                return load_declared(self._kind, declared)
        raise UnknownNameError(self._kind, name, self)

    def __iter__(self) -> Iterator[str]:
        yield from dict.fromkeys([*self.places, *sorted(declared.name for declared in self._declared())])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return name in list(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._kind}: {', '.join(self)})"

    def _declared(self) -> list[EntryPoint]:
        return [] if self._group is None else list(declared_in(self._group))


def lazy_exports(
    package: str, modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package.

    `modules` maps each module to the names that the package exports from it, separated by spaces.
    """
    places = {name: module for module, names in modules.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(places[name]), name)
        setattr(sys.modules[package], name, value)  # the next time it is an ordinary attribute
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *places})

    return find, names, sorted(places, key=_constants_classes_functions)


def _constants_classes_functions(name: str) -> tuple[bool, bool, str]:
    return not name.isupper(), name.islower(), name
