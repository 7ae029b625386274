"""Print how large the project is and how much of it a reader or a program meets, as a table.

    python .ci/sizes.py                   # the working tree
    python .ci/sizes.py --against REF     # the commit REF beside it

Code lines are lines that hold a token: no comments, no docstrings, no blank lines. A circle is a set of modules that
import each other, imports inside functions included; imports for type checkers count in a row of their own. What a
program loads is measured in a new process: the modules of ours in `sys.modules` after episodes of three calls, with the
packages of the environment that runs this script. The LangChain session plays one by the middleware, which is built on
the session for graphs, one by the toolkit and one by the player; the session of `openai:MODEL` asks a server of the
standard library.
"""

from __future__ import annotations

import argparse
import ast
import io
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tokenize
from collections.abc import Callable, Iterable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = "smartplay_tools"
GATEWAY = "smartplay_gateway"
"""The adapter that is servers for other people's agents."""
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
PROMPT_ROOMS = ("types", "prompts", "tokens", "context", "episode", "conversation", "transcript")
"""Where a prompt is decided, beside the modules at the root, as long as docs/architecture.md has no list of it."""
READING_LIST = "## What can happen to a prompt"
"""The heading in docs/architecture.md below which paths in backticks are the files and folders to read."""

OPENAI = """
import json, threading
from http.server import BaseHTTPRequestHandler, HTTPServer
import smartplay_tools as sp

CALL = {"name": "act", "arguments": json.dumps({"action": "1"})}
MESSAGE = {"role": "assistant", "content": None, "tool_calls": [{"id": "c", "type": "function", "function": CALL}]}
ANSWER = {"id": "a", "object": "chat.completion", "created": 0, "model": "m",
          "choices": [{"index": 0, "finish_reason": "tool_calls", "message": MESSAGE}]}

class Server(BaseHTTPRequestHandler):
    def do_POST(self):
        self.rfile.read(int(self.headers["content-length"]))
        body = json.dumps(ANSWER).encode()
        self.send_response(200)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
    def log_message(self, *words): ...

server = HTTPServer(("127.0.0.1", 0), Server)
threading.Thread(target=server.serve_forever, daemon=True).start()
player = sp.get_player("openai:m", base_url=f"http://127.0.0.1:{server.server_port}/v1", api_key="none")
with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(tool_calls=3)) as episode:
    assert sp.play(episode, player).end_reason == "tool_calls"
server.shutdown()
"""
LANGCHAIN = """
from langchain.agents import create_agent
from langchain_core.language_models import GenericFakeChatModel
from langchain_core.messages import AIMessage
from smartplay_langchain import LangChainPlayer, SmartPlayMiddleware, SmartPlayToolkit
import smartplay_tools as sp

class Model(GenericFakeChatModel):
    def bind_tools(self, tools, **options):
        return self

def model():
    calls = [{"name": "act", "args": {"action": "1"}, "id": str(number)} for number in range(3)]
    return Model(messages=iter([*(AIMessage("", tool_calls=[call]) for call in calls), AIMessage("I stop.")]))

def episode(**options):
    return sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(tool_calls=3), **options)

with episode() as by_middleware:
    create_agent(model(), middleware=[SmartPlayMiddleware(by_middleware)]).invoke({"messages": []})
with episode(context="host") as by_toolkit:
    tools = SmartPlayToolkit(episode=by_toolkit).get_tools()
    create_agent(model(), tools).invoke({"messages": [("user", "Play.")]})
with episode() as by_player:
    sp.play(by_player, LangChainPlayer(model()))
assert all(each.result.end_reason == "tool_calls" for each in (by_middleware, by_toolkit, by_player))
"""
LOADED = """
import sys
ours = [module for name, module in sorted(sys.modules.items()) if name.startswith("smartplay_")]
print(*{module.__file__ for module in ours if getattr(module, "__file__", None)}, sep="\\n")
"""


def code_lines(path: Path) -> int:
    """The number of code lines of a Python file."""
    text = path.read_text(encoding="utf-8")
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            held.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            held.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(held)


def files(root: Path, *folders: str, endings: tuple[str, ...] = (".py",)) -> list[Path]:
    """Files of these folders, without what git ignores; in an unpacked commit, all of them."""
    if (root / ".git").exists():
        command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", *folders]
        names = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout.splitlines()
        found = [root / name for name in names]
    else:
        found = [path for folder in folders for path in (root / folder).rglob("*")]
    return sorted(path for path in set(found) if path.name.endswith(endings) and path.is_file())


def total(paths: Iterable[Path]) -> int:
    """The code lines of several files."""
    return sum(map(code_lines, paths))


def imports(tree: ast.AST, *, typed: bool = False) -> Iterator[ast.Import | ast.ImportFrom]:
    """The imports below a node: those that run, or with `typed` those for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.expr):
            continue
        if isinstance(node, ast.Import | ast.ImportFrom):
            if not typed:
                yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            yield from imports(ast.Module(node.body if typed else node.orelse, []))
        else:
            yield from imports(node, typed=typed)


def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def import_graph(
    root: Path, *, with_types: bool = False, parse: Callable[[Path], ast.Module] = parsed
) -> dict[str, set[str]]:
    """For each module the modules that it imports; a name that a package exports late is where it is defined.

    `with_types` adds what modules import for type checkers; in an `__init__` these are the names that it exports late.
    """
    trees: dict[str, ast.AST] = {}
    packages: set[str] = set()
    for path in files(root, PACKAGE, "adapters"):
        parts = path.relative_to(root).with_suffix("").parts
        parts = parts[1:] if parts[0] == "adapters" else parts
        name = ".".join(parts).removesuffix(".__init__")
        trees[name] = parse(path)
        if parts[-1] == "__init__":
            packages.add(name)
    exported = {
        (module, alias.asname or alias.name): node.module
        for module, tree in trees.items()
        for node in imports(tree, typed=True)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    graph: dict[str, set[str]] = {}
    for module, tree in trees.items():
        reached: set[str] = set()
        for_types = imports(tree, typed=True) if with_types and module not in packages else ()
        for node in (*imports(tree), *for_types):
            if isinstance(node, ast.Import):
                reached.update(alias.name for alias in node.names)
                continue
            for alias in node.names:
                below = f"{node.module}.{alias.name}"
                reached.add(
                    below if below in trees else exported.get((node.module or "", alias.name), node.module or "")
                )
        graph[module] = (reached & trees.keys()) - {module}
    return graph


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Sets of modules that import each other: while there is a cycle, it is made one node."""
    graph = {name: set(reached) for name, reached in graph.items()}
    members = {name: [name] for name in graph}
    while True:
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            first, *others = dict.fromkeys(error.args[1])
            for name in others:
                members[first] += members.pop(name)
                graph[first] |= graph.pop(name)
            graph = {
                name: {first if to in others else to for to in reached} - {name} for name, reached in graph.items()
            }
        else:
            return [sorted(names) for names in members.values() if len(names) > 1]


def upwards(root: Path) -> int:
    """How many imports of the package point to a higher layer, as its test of architecture orders them."""
    test = (root / "tests" / "test_architecture.py").read_text(encoding="utf-8")
    layers = re.findall(r'"(\w+)"', test.partition("LAYERS = (")[2].partition(")")[0])
    heights = {f"{PACKAGE}.{layer}": height for height, layer in enumerate(layers)}

    def height(module: str) -> int | None:
        return heights.get(".".join(module.split(".")[:2]))

    pairs = (
        (height(module), height(name))
        for module, reached in import_graph(root, with_types=True).items()
        for name in reached
    )
    return sum(upper < lower for upper, lower in pairs if upper is not None and lower is not None)


def classes(root: Path, folder: str, *, without: tuple[str, ...] = ()) -> int:
    """How many classes the modules of a folder define, some of its folders left out."""
    paths = (path for path in files(root, folder) if not {*without} & {*path.relative_to(root / folder).parts})
    return sum(isinstance(node, ast.ClassDef) for path in paths for node in ast.walk(parsed(path)))


def reading_list(root: Path) -> list[Path]:
    """The files to read for "what can happen to my prompt": docs/architecture.md lists them, or `PROMPT_ROOMS`."""
    _, _, section = (root / "docs" / "architecture.md").read_text(encoding="utf-8").partition(READING_LIST)
    listed = re.findall(r"`([\w/]+(?:\.py|/))`", section.partition("\n## ")[0])
    found = [root / PACKAGE / name.removeprefix(f"{PACKAGE}/") for name in listed]
    found = found or [*(root / PACKAGE / room for room in PROMPT_ROOMS), *(root / PACKAGE).glob("*.py")]
    listed_files = ([path] if path.is_file() else files(root, str(path.relative_to(root))) for path in found)
    return sorted({file for each in listed_files for file in each})


def loaded(root: Path, session: str) -> int | str:
    """The code lines of the modules that a session loads; a dash where what it needs is not installed."""
    path = os.pathsep.join([str(root), str(root / "adapters")])
    command = [sys.executable, "-P", "-c", session + LOADED]
    ran = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True)
    return total(map(Path, ran.stdout.splitlines())) if ran.returncode == 0 else "-"


def sizes(root: Path) -> dict[str, int | str]:
    """The rows of the table."""
    package = root / PACKAGE
    ours = {path: code_lines(path) for path in files(root, PACKAGE, "adapters")}
    modules = [path for path in package.glob("*.py") if path.name not in ("__init__.py", "__main__.py")]
    rooms = {path.relative_to(package).parts[0] for path in ours if package in path.parents[1:]}
    rooms -= {room for room in rooms if not files(root, f"{PACKAGE}/{room}")[1:]}  # a folder of data
    web = files(root, PACKAGE, "adapters", endings=(".js", ".css", ".j2", ".html"))
    return {
        "code lines, package and adapters": sum(ours.values()),
        "of these adapters": sum(lines for path, lines in ours.items() if root / "adapters" in path.parents),
        f"of these adapters without {GATEWAY}": sum(
            lines for path, lines in ours.items() if root / "adapters" in path.parents and GATEWAY not in path.parts
        ),
        "classes in context": classes(root, f"{PACKAGE}/context"),
        "the same without strategies and tokens": classes(root, f"{PACKAGE}/context", without=("strategies", "tokens")),
        f"modules at the root of {PACKAGE}": len(modules),
        f"rooms at the root of {PACKAGE}": len(modules) + len(rooms),
        "code lines of tests": total(files(root, "tests")),
        "code lines of experiments and benchmarks": total(files(root, "experiments", "benchmarks")),
        "lines of JavaScript, CSS and templates": sum(len(path.read_bytes().splitlines()) for path in web),
        "pages in docs": len(files(root, "docs", endings=(".md",))),
        "words in docs": sum(len(path.read_text("utf-8").split()) for path in files(root, "docs", endings=(".md",))),
        "fragments in changelog.d": len(files(root, "changelog.d", endings=(".md",))),
        "circles between modules": len(circles(import_graph(root))),
        "the same with imports for type checkers": len(circles(import_graph(root, with_types=True))),
        "imports upwards, those for type checkers too": upwards(root),
        "code lines to read about a prompt": total(reading_list(root)),
        "code lines that a LangChain session loads": loaded(root, LANGCHAIN),
        "code lines that openai:MODEL loads": loaded(root, OPENAI),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Print how large the project is.")
    parser.add_argument("--against", metavar="REF", help="A commit whose sizes are printed before those of today.")
    parser.add_argument("--circles", action="store_true", help="Print the modules of each circle, too.")
    options = parser.parse_args()
    columns = [sizes(ROOT)]
    if options.against:
        archive = subprocess.run(["git", "archive", options.against], cwd=ROOT, check=True, capture_output=True).stdout
        with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=io.BytesIO(archive)) as files_of_ref:
            files_of_ref.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.4 and later
            files_of_ref.extractall(folder)
            columns.insert(0, sizes(Path(folder).resolve()))
    for row in columns[0]:
        print(
            f"{row:48}", *(f"{column[row]:>8,}" if isinstance(column[row], int) else "       -" for column in columns)
        )
    if options.circles:
        print(*(" <-> ".join(circle) for circle in circles(import_graph(ROOT, with_types=True))), sep="\n")


if __name__ == "__main__":
    main()
