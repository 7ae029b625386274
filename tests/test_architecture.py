"""The shape of the project: layers, circles, the public surface, packaging, and every place that asks a model."""

from __future__ import annotations

import ast
import importlib
import runpy
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from tests.test_docs import blocks

PACKAGE = Path(sp.__file__).parent
ROOT = Path(__file__).parents[1]

LAYERS = (
    "installation",
    "visible",
    "errors",
    "threads",
    "streams",
    "registry",
    "files",
    "providers",
    "terminal",
    "types",
    "statistics",
    "games",
    "transcript",
    "context",
    "compactors",
    "costs",
    "manager",
    "tool_formats",
    "episode",
    "conversation",
    "training",
    "players",
    "records",
    "testing",
    "evaluation",
    "web",
    "cli",
)
"""Lowest first. A module imports only from lower ones."""

ROOMS = {
    "suites": 0,
    "processes": 0,
    "run_folder": 1,
    "costs": 2,
    "analysis": 3,
    "pages": 4,
    "exports": 4,
    "runs": 5,
    "__init__": 6,
}
"""The rooms of `evaluation` with their heights. A room imports only from lower ones."""


def modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path.parent != PACKAGE or not path.stem.startswith("__")]


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def graph() -> dict[str, set[str]]:
    """For each module the modules that it imports, in functions and for type checkers, too."""
    if not (ROOT / ".ci").is_dir():
        pytest.skip("not in a checkout")
    return dict(sizes()["import_graph"](ROOT, with_types=True, parse=tree))


@cache
def sizes() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / ".ci" / "sizes.py"))


def below(room: str) -> Iterator[tuple[str, str]]:
    """Every import of a module below `room` by another one, by the names that follow `room`."""
    begins = f"{sp.__name__}.{room}".rstrip(".") + "."
    for module, imported in graph().items():
        for name in imported:
            if module.startswith(begins) and name.startswith(begins):
                yield module.removeprefix(begins), name.removeprefix(begins)


def test_imports_never_point_up():
    for module, imported in below(""):
        lower, upper = imported.split(".")[0], module.split(".")[0]
        if upper == "__main__":
            continue
        assert LAYERS.index(lower) <= LAYERS.index(upper), (
            f"{module} imports {imported}, which is above it in LAYERS: move what both need down, or pass it as an "
            "argument"
        )


def test_a_room_of_evaluation_imports_only_lower_ones():
    for module, imported in below("evaluation"):
        lower, upper = imported.split(".")[0], module.split(".")[0]
        assert lower == upper or ROOMS[lower] < ROOMS[upper], (
            f"evaluation.{module} imports {imported}, which is not below it in ROOMS: move what both need down, or "
            "pass it as an argument"
        )


ASK = {"reply", "areply", "reply_of", "ask", "aask", "create", "generate", "invoke", "ainvoke", "get_response"}
"""The names of functions that ask a player or a framework's model."""

ASK_HERE = {"handler", "send", "self.send", "self.asend", "super().send", "super().asend", "self._model_step"}
"""Expressions that ask where they are called: hooks of frameworks, functions of hosts, and players' own requests."""

LAST_HERE = {expression.rpartition(".")[2] for expression in ASK_HERE}
"""The last names of these expressions."""

OTHERS = {
    "smartplay_tools.cli": "a command is invoked",
    "smartplay_tools.evaluation.runs.executors.ray": "an event is sent",
    "smartplay_tools.games.crafter.world": "a world is generated",
    "smartplay_tools.players.human.player": "a person is asked",
    "smartplay_langchain.calls": "a tool is invoked",
    "smartplay_langchain.toolkit": "a tool is invoked",
    "smartplay_local.engine": "tokens are counted, and a template is written",
    "smartplay_mcp.server": "a message of the protocol is handled",
    "smartplay_gateway.window.app": "a request of a host is handed to its episode",
    "smartplay_pydantic_ai.capability.SmartPlay.wrap_tool_execute": "a tool is run",
}
"""Modules and functions in which these are something else, and what."""


def asking(tree: ast.AST, path: str = "") -> Iterator[str]:
    """The qualified names of the functions that ask, one by one."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Call):
            # A function may be handed on, as to a thread.
            for called in (node.func, *(each for each in node.args if isinstance(each, ast.Attribute))):
                name = getattr(called, "attr", getattr(called, "id", ""))
                if name not in ASK | LAST_HERE:
                    continue  # writing all of them as text takes a second
                text = ast.unparse(called)
                is_conversion = text in ("codec.reply", "self._interface.reply")
                is_asked = called is node.func or text.endswith("player.reply")
                if is_asked and (text in ASK_HERE or (name in ASK and not is_conversion)):
                    yield path
        is_named = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        yield from asking(node, f"{path}.{node.name}".lstrip(".") if is_named else path)


def test_every_place_that_asks_a_model_is_listed_with_its_bound():
    places = tomllib.loads((ROOT / "tests" / "asks_a_model.toml").read_text(encoding="utf-8"))["place"]
    listed = {f"{place['module']}.{name}" for place in places if place["at_most"] for name in place["functions"]}
    found, others = set(), set()
    for path in [*modules(), *ROOT.glob("adapters/**/*.py")]:
        top = ROOT / "adapters" if "adapters" in path.parts else ROOT
        module = ".".join(path.relative_to(top).with_suffix("").parts).removesuffix(".__init__")
        for name in asking(tree(path)):
            other = {module, f"{module}.{name}"} & OTHERS.keys()
            others |= other
            found |= set() if other else {f"{module}.{name}"}
    assert others == OTHERS.keys()
    assert found == listed, "list every place that asks a model in tests/asks_a_model.toml, with its bound"


def test_modules_import_in_no_circle():
    """Imports inside functions and those for type checkers count: who reads one module of a circle needs them all."""
    for circle in sizes()["circles"](graph()):
        pytest.fail(
            f"{' <-> '.join(circle)} import each other: move what they share into the lowest of them, or have the "
            "lower one take what it needs as an argument or a Protocol"
        )


SERVERS = (
    "smartplay_gateway",
    "smartplay_mcp",
    "smartplay_openenv",
)
"""The adapters that are servers, which share what `web` has."""


def test_adapters_do_without_the_laboratory():
    for module, imported in graph().items():
        if module.startswith(f"{sp.__name__}.") or module == sp.__name__:
            continue
        rooms = {name.split(".")[1] for name in imported if name.startswith(f"{sp.__name__}.")}
        not_for_it = {"evaluation", "cli", "testing"} | ({"web"} if not module.startswith(SERVERS) else set())
        assert not rooms & not_for_it, (
            f"{module} imports {sorted(rooms & not_for_it)}, which one episode does not need: move what both need down"
        )


CORE = """
import smartplay_tools as sp
with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=900), transcript="hanoi.jsonl") as episode:
    assert sp.play(episode, sp.get_player("rule")).completed
assert sp.replay("hanoi.jsonl").identical
"""


@pytest.mark.parametrize("session", ["core", "openai", pytest.param("langchain", marks=pytest.mark.slow)])
def test_an_episode_is_played_without_loading_the_laboratory(session, tmp_path):
    """Nobody who plays one episode, by whichever framework, loads what plays, keeps and shows many, or a server."""
    pytest.importorskip({"core": sp.__name__}.get(session, session))
    code = {"core": CORE, "openai": sizes()["OPENAI"], "langchain": sizes()["LANGCHAIN"]}[session]
    rooms = tuple(f"{sp.__name__}.{room}" for room in ("evaluation", "web", "cli", "testing"))
    code += f"\nimport sys\nprint([name for name in sys.modules if name.startswith({rooms})])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.stdout.strip() == "[]", f"import what needs them in functions\n{done.stdout}{done.stderr}"


@pytest.mark.slow
def test_a_run_is_played_without_loading_statistics_or_pages(tmp_path):
    program = f"""
        import sys
        import smartplay_tools as sp

        games, budget = ["Hanoi3Disk-v0"], sp.Budget(tool_calls=1)
        run = sp.evaluate(games, ["rule"], out={str(tmp_path)!r}, trials=1, budgets=budget, executor="inline")
        assert run.complete and run.status.finished == 1 and run.spending.total.tokens
        rooms = ("smartplay_tools.evaluation.analysis", "smartplay_tools.evaluation.pages")
        print([name for name in sys.modules if name.startswith(rooms)])
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", (
        f"a run imports statistics or pages: import them in the functions that use them\n{done.stdout}{done.stderr}"
    )


def test_the_public_surface_is_sorted_and_complete():
    constants = [name for name in sp.__all__ if name.isupper()]
    classes = [name for name in sp.__all__ if not name.isupper() and name[0].isupper()]
    functions = [name for name in sp.__all__ if name.islower()]
    assert sp.__all__ == [*sorted(constants), *sorted(classes), *sorted(functions)], "let lazy_exports sort the names"
    missing = [name for name in sp.__all__ if not hasattr(sp, name)]
    assert not missing, f"smartplay_tools exports {missing}, which are not there: correct the table in __init__.py"


def test_every_adapter_is_packaged_typed_and_an_extra():
    if not (ROOT / "pyproject.toml").exists():
        pytest.skip("not in a checkout")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    extras = project["project"]["optional-dependencies"]
    for folder in sorted((ROOT / "adapters").glob("smartplay_*")):
        where, extra = f"adapters/{folder.name}", folder.name.removeprefix("smartplay_").replace("_", "-")
        assert where in packages, (
            f"{where} would not be in the wheel: list it under packages of [tool.hatch.build.targets.wheel] in "
            "pyproject.toml"
        )
        assert (folder / "py.typed").exists(), f"type checkers would ignore {where}: add an empty {where}/py.typed"
        assert extra in extras, (
            f"nobody can install what {where} needs: add the extra {extra} to [project.optional-dependencies] in "
            "pyproject.toml"
        )


def public_names(module: str) -> list[str]:
    """The public names of a package or module."""
    return list(getattr(importlib.import_module(module), "__all__", ()))


def outside() -> list[tuple[str, str]]:
    """Code that uses the package as a user does: adapters, examples, and the blocks of README and docs."""
    files = [path for folder in ("adapters", "examples") for path in sorted((ROOT / folder).rglob("*.py"))]
    modules = [(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) for path in files]
    return [*modules, *((page.name, code) for page, code in blocks("python"))]


def test_what_users_import_is_public():
    """Nothing outside of the package imports a name that is in no `__all__`."""
    for name, code in outside():
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == sp.__name__:
                hidden = {alias.name for alias in node.names} - set(public_names(node.module or ""))
                assert not hidden, (
                    f"{name} imports {', '.join(sorted(hidden))} from {node.module}: add the names to its __all__, or "
                    "use public ones"
                )


BUILT_ON = {"smartplay_local": "smartplay_openai"}
"""The adapters that are another one with something in addition: a local model is asked by the OpenAI player."""


def test_no_adapter_imports_another():
    for path in sorted((ROOT / "adapters").rglob("*.py")):
        own = path.relative_to(ROOT / "adapters").parts[0]
        for node in ast.walk(tree(path)):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                package = name.split(".")[0]
                allowed = (own, sp.__name__, BUILT_ON.get(own))
                assert not package.startswith("smartplay_") or package in allowed, (
                    f"{path.relative_to(ROOT)} imports {name}: adapters are installed apart; move what both need into "
                    "smartplay_tools, or list the pair in BUILT_ON"
                )
