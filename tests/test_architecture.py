"""The shape of the project: layers, imports, the public surface, and that it speaks of itself only."""

from __future__ import annotations

import ast
import importlib
import tomllib
from pathlib import Path

import pytest

import smartplay_tools as sp
from tests.test_docs import blocks

PACKAGE = Path(sp.__file__).parent
ROOT = Path(__file__).parents[1]

LAYERS = (
    "lazy",
    "errors",
    "registry",
    "web",
    "json_text",
    "arguments",
    "messages",
    "tokens",
    "types",
    "prompts",
    "games",
    "transcript",
    "episode",
    "context",
    "conversation",
    "replays",
    "players",
    "testing",
    "evaluation",
    "exports",
    "cli",
)
"""Lowest first. A module imports only from lower ones."""


def modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path.parent != PACKAGE or not path.stem.startswith("__")]


def imported(tree: ast.AST, *, when_called: bool = True) -> set[str]:
    """The modules of this package that a module imports, those for type checkers only left out.

    With `when_called` also those that its functions import.
    """
    functions = [] if when_called else [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    guarded = {id(node) for function in functions for node in ast.walk(function)}
    guarded |= {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.dump(branch.test)
        for node in ast.walk(branch)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.ImportFrom)
            and id(node) not in guarded
            and (node.module or "").split(".")[0] == sp.__name__
        ):
            if node.module == sp.__name__:
                found |= {f"{node.module}.{alias.name}" for alias in node.names}
            else:
                found.add(node.module)
    return found


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_never_point_up(path):
    layer = LAYERS.index(path.relative_to(PACKAGE).parts[0].removesuffix(".py"))
    for module in imported(ast.parse(path.read_text(encoding="utf-8"))):
        assert LAYERS.index(module.split(".")[1]) <= layer, f"{path.name} imports {module}"


def without_functions(path: Path) -> ast.Module:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return ast.Module([node for node in tree.body if not isinstance(node, ast.FunctionDef | ast.ClassDef)], [])


def reached(start: str) -> set[str]:
    """The modules that are loaded with a sub-package of `evaluation`; imports in functions are left out."""
    own = [path for path in modules() if ".".join(path.relative_to(PACKAGE.parent).parts).startswith(start + ".")]
    found: set[str] = set()
    waiting = list(own)
    while waiting:
        for name in imported(without_functions(waiting.pop())) - found:
            found.add(name)
            module = PACKAGE.parent / Path(*name.split("."))
            waiting += [path for path in (module.with_suffix(".py"), module / "__init__.py") if path.exists()]
    return found


@pytest.mark.parametrize(
    ("package", "others"),
    [
        ("run", ("analysis", "figures", "report", "sweeps")),
        ("analysis", ("run", "figures", "report", "sweeps")),
        ("figures", ("run", "report", "sweeps")),
        ("report", ("run", "sweeps")),
        ("submissions", ("run", "figures", "report", "sweeps")),
    ],
)
def test_playing_a_run_and_drawing_it_do_not_need_each_other(package, others):
    for name in reached(f"smartplay_tools.evaluation.{package}"):
        parts = name.split(".")
        assert parts[1] != "evaluation" or len(parts) < 3 or parts[2] not in others, f"{package} comes to {name}"


def test_nothing_is_keyed_by_identity():
    for path in modules():
        calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
        assert not [node for node in calls if isinstance(node.func, ast.Name) and node.func.id == "id"], path


def test_the_public_surface_is_sorted_and_complete():
    constants = [name for name in sp.__all__ if name.isupper()]
    classes = [name for name in sp.__all__ if not name.isupper() and name[0].isupper()]
    functions = [name for name in sp.__all__ if name.islower()]
    assert sp.__all__ == [*sorted(constants), *sorted(classes), *sorted(functions)]
    assert all(hasattr(sp, name) for name in sp.__all__)


def test_every_public_name_is_documented():
    for name in sp.__all__:
        thing = getattr(sp, name)
        if callable(thing):
            assert thing.__doc__, name


def test_every_module_says_what_it_is():
    for path in modules():
        assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path


def test_every_adapter_is_packaged_typed_and_an_extra():
    if not (ROOT / "pyproject.toml").exists():
        pytest.skip("not in a checkout")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    for folder in sorted((ROOT / "adapters").glob("smartplay_*")):
        assert f"adapters/{folder.name}" in packages
        assert (folder / "py.typed").exists()
        assert folder.name.removeprefix("smartplay_").replace("_", "-") in project["project"]["optional-dependencies"]


def public_names(module: str) -> list[str]:
    """The public names of a package or module."""
    return list(getattr(importlib.import_module(module), "__all__", ()))


def outside() -> list[tuple[str, str]]:
    """Code that uses the package as a user does: adapters, examples, and the blocks of README and docs."""
    files = [path for folder in ("adapters", "examples") for path in sorted((ROOT / folder).rglob("*.py"))]
    found = [(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) for path in files]
    return [*found, *((page.name, code) for page, code in blocks("python"))]


def test_what_users_import_is_public():
    """Nothing outside of the package imports a name that is in no `__all__`."""
    for name, code in outside():
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == sp.__name__:
                hidden = {alias.name for alias in node.names} - set(public_names(node.module or ""))
                assert not hidden, f"{name} imports {', '.join(hidden)} from {node.module}"


def test_every_package_says_what_it_offers():
    offered = {*PACKAGE.glob("*/__init__.py"), *(PACKAGE / "evaluation").glob("*/__init__.py")}
    for path in sorted(offered - {PACKAGE / "cli" / "__init__.py", PACKAGE / "data" / "__init__.py"}):
        module = ".".join(path.parent.relative_to(PACKAGE.parent).parts)
        for name in public_names(module):
            assert getattr(importlib.import_module(module), name) is not None
        assert public_names(module), f"{module} has no __all__"
