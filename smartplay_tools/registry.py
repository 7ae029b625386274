"""Registry: things by name, each given as the place where it is found, "module:attribute".

Players, executors, Minecraft's engines and the classes of games are found this way, so none of them is imported before
it is asked for. A registry may have a group of entry points too, under which installed packages declare more things;
their names are read from the packages' metadata, which imports nothing.

`FILE.py:CLASS` names a class in a file of the user's, without a package around it. The name alone says where the class
is, so it goes to worker processes as text, and each imports the file itself. A file is known by its resolved path and
the digest of its content: one that was edited is imported again, and its earlier classes stay what they were. What a
record names in this way has its digest beside the name, and is not imported for the record: see `NamedInFiles`.

`lazy_exports` gives a package names that are imported when they are first used, so that importing the package takes
milliseconds (PEP 562). The package lists them once, as imports under `TYPE_CHECKING`: type checkers and editors read
them there, and so does `lazy_exports`. For the same reason this module imports what its functions need when they are
called.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
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


class InFile(NamedTuple):
    """A class or another object that was read from a file of the user's."""

    value: Any
    sha256: str
    """The digest of the file's content as it was imported."""
    path: Path
    """The file, as the user has named it."""


def read_file(name: str, kind: str = "player", noun: str = "class", is_one: Callable[[Any], bool] = callable) -> InFile:
    """Import the file of `FILE.py:CLASS` and return the class; `InvalidArgumentError` if it is not there.

    `kind` and `noun` say in messages what the class is and what it is called; `is_one` returns whether an object of
    the file is one.
    """
    from hashlib import sha256
    from pathlib import Path

    place, _, attribute = name.rpartition(":")
    path = Path(place or attribute)
    if not path.is_file():
        raise InvalidArgumentError(f"There is no file {path}; name a {kind} of your own as FILE.py:{noun.upper()}.")
    source = path.read_bytes()
    digest = sha256(source).hexdigest()
    held = getattr(_module(path, source, digest), attribute, None)
    if not is_one(held):
        raise InvalidArgumentError(f"{path} has no {noun} {attribute!r}; name a {kind} of it as {path}:{noun.upper()}.")
    return InFile(held, digest, path)


def without_folders(name: str) -> str:
    """Return `FILE.py:CLASS` as records have it: the name of the file alone."""
    from pathlib import Path

    file, _, attribute = name.rpartition(":")
    return f"{Path(file).name}:{attribute}"


class NamedInFiles:
    """What the user has named in files in this process: strategies, or games.

    A record has the name of such a file, without its folders, and the digest of its content. It can come from a
    stranger, so it never imports a file: the user names the file, which may have been moved, and its content decides.

    Arguments:
        kind: what it is, which is also the option of `replay` that names it.
        noun: what it is called in messages.
        is_one: returns whether an object of a file is one.
    """

    def __init__(self, kind: str, noun: str = "class", is_one: Callable[[Any], bool] = callable) -> None:
        self._kind, self._noun, self._is_one = kind, noun, is_one
        self.read: dict[tuple[str | None, str], InFile] = {}
        """By the digest of the file, and the name in it."""

    def load(self, name: str, digest: str | None = None, path: Path | None = None) -> InFile:
        """Import the file that a user has named; `InvalidArgumentError` if that is not possible.

        `digest` is that of the file as it has to be; None for the file as it is now. `path` is the file, where `name`
        has no folder.
        """
        file, _, attribute = name.rpartition(":")
        if digest is None or (digest, attribute) not in self.read:
            if digest is not None and _digest_of(path or file) not in (None, digest):
                raise InvalidArgumentError(
                    f"{path or file} has changed since its episodes were planned; put the earlier file back, or play "
                    "again with the new one."
                )
            found = read_file(f"{path or file}:{attribute}", self._kind, self._noun, self._is_one)
            self.read[found.sha256, attribute] = found
            digest = found.sha256
        return self.read[digest, attribute]

    def check(self, name: str, digests: Collection[str | None]) -> None:
        """Refuse a file that a user names for records if it is none of theirs, before it is imported."""
        file = name.rpartition(":")[0]
        known = {digest for digest in digests if digest is not None}
        if known and _digest_of(file) not in (None, *known):
            raise InvalidArgumentError(
                f"{file} is not the file of the record, or has changed since, so it is not imported; name an unchanged "
                f"copy with --{self._kind}."
            )

    def recorded(self, name: str, digest: str | None) -> InFile:
        """Return what a record names, without importing a file for it; `digest` is that of its file."""
        attribute = name.rpartition(":")[2]
        if (digest, attribute) in self.read:
            return self.read[digest, attribute]
        if without_folders(name) in {f"{found.path.name}:{own}" for (_, own), found in self.read.items()}:
            raise InvalidArgumentError(
                f"{name} has changed since the record was made; name an unchanged copy of the file with --{self._kind}."
            )
        raise InvalidArgumentError(
            f"The record was played with the {self._kind} {name}; name it with --{self._kind}, with the path of its "
            "file, to import it."
        )


def _digest_of(file: str | Path) -> str | None:
    """The digest of a file; None if it cannot be read."""
    from hashlib import sha256
    from pathlib import Path

    try:
        return sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return None


def _module(path: Path, source: bytes, digest: str) -> ModuleType:
    """Return the module of a file with this content, imported once in each process, with its folder on `sys.path`.

    The content is compiled here: Python's cache would take a file of the same size and second for the same file.
    """
    from hashlib import sha256
    from importlib.util import module_from_spec, spec_from_file_location

    whole = path.resolve()
    place = sha256(os.fsencode(f"{whole} {digest}")).hexdigest()[:16]
    name = f"smartplay_file_{place}"
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


def lazy_exports(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package, from the imports that it has for type checkers.

    These are read from its source: every `X as X` in `from MODULE import ...` below `if TYPE_CHECKING`.
    """
    spec = sys.modules[package].__spec__
    source = spec.loader.get_data(spec.origin).decode("utf-8")  # type: ignore[union-attr]
    imports = re.findall(r"^    from (\S+) import (\([^)]*\)|.*)$", source, re.MULTILINE)
    places = {name: module for module, names in imports for name in re.findall(r"\b(\w+) as \1\b", names)}

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
