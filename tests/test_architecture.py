"""The shape of the project: layers, imports, the public surface, and that it speaks of itself only."""

from __future__ import annotations

import ast
import importlib
import re
import runpy
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import smartplay_tools as sp
from tests.test_docs import blocks

PACKAGE = Path(sp.__file__).parent
ROOT = Path(__file__).parents[1]

LAYERS = (
    "visible",
    "errors",
    "registry",
    "terminal",
    "types",
    "games",
    "transcript",
    "context",
    "episode",
    "conversation",
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
    "quantities": 0,
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
def nodes(path: Path) -> list[ast.AST]:
    """Everything in a module, which several tests look at."""
    return [*ast.walk(tree(path))]


def imported(nodes: list[ast.AST]) -> set[str]:
    """The modules of this package that a module imports when it is loaded or when its functions are called.

    Imports for type checkers only are left out.
    """
    for_types = {
        id(node)
        for branch in nodes
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in (getattr(branch.test, name, "") for name in ("id", "attr"))
        for statement in branch.body
        for node in ast.walk(statement)
    }
    names: set[str] = set()
    for node in nodes:
        if id(node) in for_types:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"line {node.lineno}: write the whole name of the module, {sp.__name__}.…"
            places = (sp.__name__, f"{sp.__name__}.evaluation")  # their rooms are what is imported
            names |= {f"{node.module}.{alias.name}" for alias in node.names} if node.module in places else {node.module}
    return {name for name in names if name.split(".")[0] == sp.__name__}


def test_imports_never_point_up():
    for path in modules():
        layer = LAYERS.index(path.relative_to(PACKAGE).parts[0].removesuffix(".py"))
        for module in imported(nodes(path)):
            assert LAYERS.index(module.split(".")[1]) <= layer, (
                f"{path.relative_to(ROOT)} imports {module}, which is above it in LAYERS: move what both need down, "
                "or pass it as an argument"
            )


ARCHITECTURE = ROOT / "docs" / "architecture.md"


def section(title: str) -> str:
    """The text of docs/architecture.md below a heading."""
    return ARCHITECTURE.read_text(encoding="utf-8").partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def test_the_drawing_has_a_line_for_every_room():
    rooms = {path.stem for path in PACKAGE.iterdir() if path.is_dir() and (path / "__init__.py").exists()}
    rooms |= {path.stem for path in PACKAGE.glob("*.py") if not path.stem.startswith("__")}
    assert rooms == set(LAYERS), "list every folder and module of smartplay_tools in LAYERS, lowest first"
    drawn = [line.split()[0] for line in section("The rooms").split("```")[1].splitlines() if line]
    assert drawn == [*reversed(LAYERS)], "give every room a line in the drawing of docs/architecture.md, highest first"


PROMPT_ROOMS = ("types", "context", "transcript", "episode", "conversation")


def test_what_can_happen_to_a_prompt_is_listed_by_file():
    listed = re.findall(r"^\| `([\w/.]+)` \|", section("What can happen to a prompt"), flags=re.MULTILINE)
    gone = [name for name in listed if not (PACKAGE / name).exists()]
    assert not gone, f"docs/architecture.md lists {gone}, which are not there: correct the list"
    for path in sorted(path for room in PROMPT_ROOMS for path in (PACKAGE / room).rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        assert any(name == entry or (entry.endswith("/") and name.startswith(entry)) for entry in listed), (
            f"{name} is not in docs/architecture.md under 'What can happen to a prompt': add a line that says what it "
            "decides"
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
    "smartplay_local.engine": "tokens are counted, a template is written, and a model is tried with 40 tokens",
    "smartplay_mcp.server": "a message of the protocol is handled",
    "smartplay_openai.window.app": "a request of a host is handed to its episode",
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
    page = (ROOT / "docs" / "budgets.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| `(smartplay_[\w.]+)` \| (.+?) \| (.+?) \|$", page, flags=re.MULTILINE)
    listed = {f"{module}.{name}" for module, names, _ in lines for name in re.findall(r"`([\w.]+)`", names)}
    found, others = set(), set()
    for path in [*modules(), *ROOT.glob("adapters/**/*.py")]:
        top = ROOT / "adapters" if "adapters" in path.parts else ROOT
        module = ".".join(path.relative_to(top).with_suffix("").parts).removesuffix(".__init__")
        for name in asking(tree(path)):
            other = {module, f"{module}.{name}"} & OTHERS.keys()
            others |= other
            found |= set() if other else {f"{module}.{name}"}
    assert others == OTHERS.keys()
    assert found == listed, "list every place that asks a model in docs/budgets.md, with its bound"


def test_a_room_of_evaluation_imports_only_lower_ones():
    for path in sorted((PACKAGE / "evaluation").rglob("*.py")):
        room = path.relative_to(PACKAGE / "evaluation").parts[0].removesuffix(".py")
        for module in imported(nodes(path)):
            parts = module.split(".")
            if parts[1] == "evaluation" and parts[2] != room:
                assert ROOMS[parts[2]] < ROOMS[room], (
                    f"{path.relative_to(ROOT)} imports {module}, which is not below it in ROOMS: move what both need "
                    "down, or pass it as an argument"
                )


def test_modules_import_in_no_circle():
    """Imports inside functions and those for type checkers count: who reads one module of a circle needs them all."""
    if not (ROOT / ".ci").is_dir():
        pytest.skip("not in a checkout")
    sizes = runpy.run_path(str(ROOT / ".ci" / "sizes.py"))
    for circle in sizes["circles"](sizes["import_graph"](ROOT, with_types=True, parse=tree)):
        pytest.fail(
            f"{' <-> '.join(circle)} import each other: move what they share into the lowest of them, or have the "
            "lower one take what it needs as an argument or a Protocol"
        )


DEFERRED = """
import os

def now(): import smartplay_tools.cli

class Table:
    async def rows(self):
        from smartplay_tools import records
        from smartplay_tools.evaluation import runs

if TYPE_CHECKING:
    from smartplay_tools.web import guard
else:
    import smartplay_tools.registry
"""


def test_an_import_in_a_function_or_a_method_counts():
    names = {
        "smartplay_tools.cli",
        "smartplay_tools.records",
        "smartplay_tools.evaluation.runs",
        "smartplay_tools.registry",
    }
    assert imported([*ast.walk(ast.parse(DEFERRED))]) == names


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


KINDS_ARE_TESTED_BY = (
    "records",
    "transcript",
    "episode/stalls.py",
    "episode/stats.py",
    "context/turns.py",
    "smartplay_otel/spans.py",
)
"""What takes events apart: records, the counters and turns of a game under way, and spans, one event after another."""


def test_only_records_tell_events_apart():
    """Everything else asks a `Record`, so a new kind of event is a type, a case of `Record` and a row of the docs."""
    adapters = sorted((ROOT / "adapters").rglob("*.py"))
    for path in [*modules(), *adapters]:
        where = path.relative_to(ROOT / "adapters" if path in adapters else PACKAGE).as_posix()
        if where.startswith(KINDS_ARE_TESTED_BY):
            continue
        for node in nodes(path):
            tested = node.left if isinstance(node, ast.Compare) else getattr(node, "subject", None)
            if not tested or "event" not in (getattr(part, "value", "") for part in ast.walk(tested)):
                continue  # writing all of them as text takes two seconds
            assert not ast.unparse(tested).endswith(("['event']", ".get('event')")), (
                f"{where}:{node.lineno} tests the kind of an event; ask a Record"
            )


def test_only_the_episode_uses_its_private_members():
    """Conversations and readers of records use `episode.ledger`, whose members have public names."""
    adapters = sorted((ROOT / "adapters").rglob("*.py"))
    for path in [*modules(), *adapters]:
        if path.parent == PACKAGE / "episode":
            continue
        for node in nodes(path):
            if isinstance(node, ast.Attribute) and node.attr.startswith("_"):
                owner = getattr(node.value, "attr", getattr(node.value, "id", "")).lstrip("_")
                assert owner not in ("episode", "ledger", "resumed"), f"{path}:{node.lineno} uses {owner}.{node.attr}"


def test_nothing_is_keyed_by_identity():
    for path in modules():
        calls = [node for node in nodes(path) if isinstance(node, ast.Call)]
        found = [node.lineno for node in calls if isinstance(node.func, ast.Name) and node.func.id == "id"]
        assert not found, f"{path.relative_to(ROOT)} calls id() in lines {found}: an id is used again; use a key"


def test_the_public_surface_is_sorted_and_complete():
    constants = [name for name in sp.__all__ if name.isupper()]
    classes = [name for name in sp.__all__ if not name.isupper() and name[0].isupper()]
    functions = [name for name in sp.__all__ if name.islower()]
    assert sp.__all__ == [*sorted(constants), *sorted(classes), *sorted(functions)], "let lazy_exports sort the names"
    missing = [name for name in sp.__all__ if not hasattr(sp, name)]
    assert not missing, f"smartplay_tools exports {missing}, which are not there: correct the table in __init__.py"


def test_every_public_name_is_documented():
    for name in sp.__all__:
        thing = getattr(sp, name)
        if callable(thing):
            assert thing.__doc__, f"{name} is public and has no docstring: write one"


def test_every_module_says_what_it_is():
    for path in modules():
        assert ast.get_docstring(tree(path)), (
            f"{path.relative_to(ROOT)} has no docstring: say what the module is, and why"
        )


ROW = re.compile(r" *(\w+/?(?:, \w+/?)*) {2,}\S")
"""A line of a table in a docstring: a name or several, and what they are."""


def test_a_packages_table_lists_modules_that_are_there_or_names_of_its_code():
    for path in [*sorted(PACKAGE.rglob("__init__.py")), *sorted((ROOT / "adapters").rglob("__init__.py"))]:
        rows = map(ROW.match, (ast.get_docstring(tree(path)) or "").splitlines())
        listed = {name for row in rows if row for name in re.split("/?, |/", row[1]) if name}
        there = {other.stem for other in path.parent.iterdir()}
        named = {node.value for node in nodes(path) if isinstance(node, ast.Constant)}
        assert listed <= there | named, (
            f"the table in the docstring of {path.relative_to(ROOT)} lists {sorted(listed - there - named)}, which are "
            "not there: correct the table"
        )


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


OFFERED_TO_SEVERAL_HOSTS = {"PlayerModel", "SmartPlayHarness"}
"""Classes that adapters offer to different hosts under one name, because they are the same thing there."""


def test_a_class_name_is_defined_once():
    places: dict[str, list[str]] = {}
    for path in [*sorted(PACKAGE.rglob("*.py")), *sorted((ROOT / "adapters").rglob("*.py"))]:
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    doubled = {name: paths for name, paths in places.items() if len(paths) > 1}
    assert doubled.keys() == OFFERED_TO_SEVERAL_HOSTS, (
        f"{doubled}: give one of two classes another name, or list it in OFFERED_TO_SEVERAL_HOSTS if both are the same "
        "thing for two hosts; take out of that list what is defined once"
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
        for node in nodes(path):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                package = name.split(".")[0]
                allowed = (own, sp.__name__, BUILT_ON.get(own))
                assert not package.startswith("smartplay_") or package in allowed, (
                    f"{path.relative_to(ROOT)} imports {name}: adapters are installed apart; move what both need into "
                    "smartplay_tools, or list the pair in BUILT_ON"
                )


def test_every_package_says_what_it_offers():
    for path in sorted(
        {*PACKAGE.glob("*/__init__.py")} - {PACKAGE / room / "__init__.py" for room in ("cli", "data", "evaluation")}
    ):
        module = ".".join(path.parent.relative_to(PACKAGE.parent).parts)
        missing = [name for name in public_names(module) if not hasattr(importlib.import_module(module), name)]
        assert not missing, f"{module} offers {missing}, which are not there: correct its __all__"
        assert public_names(module), f"{module} has no __all__: list the names that other packages may import"
