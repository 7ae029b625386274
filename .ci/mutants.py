"""Plant faults in the code, one at a time, and say how many of them the fast tests notice (mutation testing).

    python -m pip install cosmic-ray
    python -m pytest -m "not slow" --cov --cov-context=test
    python .ci/mutants.py FILE.jsonl [SAMPLE] [SEED]

Cosmic Ray finds the places and makes the mutants. A sample of places is drawn, and one mutant of each. A mutant meets
the tests that run its line, those that run the fewest lines first, the files of tests that name its module, and the
tests of its package. Decorators are left out, and so is `|`, which is nearly always of an annotation: mutants there
change nothing.

A line of FILE is a mutant with its outcome, and the same command goes on where it was stopped. Files are changed where
they are, so it needs a clone that nobody else uses. It needs Unix.
"""

from __future__ import annotations

import importlib
import json
import os
import random
import resource
import signal
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import coverage
import pytest
from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import use_mutation

ROOMS = {
    "games": ["tests/test_specs.py", "tests/test_paper_protocol.py"],
    "context": ["tests", "--ignore-glob=tests/*/*"],
    "evaluation/analysis": ["tests/evaluation"],
    "records": ["tests", "--ignore-glob=tests/*/*", "tests/evaluation"],
}
"""The mutated packages, each with the tests that its mutants meet; those of a game also meet the tests of the game."""
OPTIONS = ("-xq", "--tb=no", "-pno:cacheprovider", "-mnot slow", "-Wignore::pytest.PytestAssertRewriteWarning")
IMPORTED = ("crafter", "gymnasium", "hypothesis", "jinja2", "matplotlib", "mcp.types", "openai", "pydantic", "typer")
"""Libraries that take long to import, which one process does for all mutants."""

Place = tuple[str, int, int]
"""File, line and column."""


def mutants(path: Path) -> Iterator[tuple[Place, str, int]]:
    """Every mutant of a file: its place, its operator, and its number among those of this operator."""
    nodes, lines = list(ast_nodes(get_ast_from_path(path))), path.read_text(encoding="utf-8").splitlines()
    for name in plugins.operator_names():
        operator = plugins.get_operator(name)
        if not operator.arguments() and "BitOr" not in name:
            places = (begin for node in nodes for begin, _ in operator().mutation_positions(node))
            for number, (line, column) in enumerate(places):
                if not lines[line - 1].lstrip().startswith("@"):
                    yield (str(path), line, column), name, number


def outcome(tests: list[str], seconds: int) -> str:
    """Run tests in a child of this process, which has imported nothing of this project.

    What needs more processor time than `seconds` is a loop without an end, most often.
    """
    child = os.fork()
    if not child:
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        signal.alarm(10 * seconds)
        for stream in range(3):
            os.dup2(os.open(os.devnull, os.O_RDWR), stream)
        os._exit(pytest.main([*OPTIONS, *tests]))
    status = os.waitpid(child, 0)[1]
    return "timeout" if os.WIFSIGNALED(status) else "survived" if os.WEXITSTATUS(status) in (0, 5) else "killed"


def tests_of(place: Place, run: dict[str, dict[int, list[str]]], width: Counter[str]) -> list[str]:
    """Return the tests that run a line, or its module if only imports run the line."""
    lines = run.get(str(Path(place[0]).absolute()), {})
    tests = {*lines.get(place[1], ())} - {""} or {test for tests in lines.values() for test in tests} - {""}
    return list(dict.fromkeys(test.partition("|")[0] for test in sorted(tests, key=lambda test: (width[test], test))))


def tests_of_package(path: str, room: str) -> list[str]:
    """Return the tests of a package, and of a game all that have its name."""
    game = Path(path).relative_to("smartplay_tools").parts[1]
    own = sorted(map(str, Path("tests").rglob(f"test_{game}*.py"))) or ["tests/games"]
    return [*ROOMS[room], *(own if room == "games" else ())]


def main(file: str, sample: str = "600", seed: str = "1") -> None:
    """Draw the sample, and plant what of it has no line in the file yet."""
    sys.dont_write_bytecode = True
    for name in IMPORTED:
        importlib.import_module(name)
    assert outcome(["tests/test_specs.py"], 60) == "survived", "the tests fail without a mutant, too"
    data, results, chance = coverage.CoverageData(), Path(file), random.Random(int(seed))
    data.read()
    run = {path: data.contexts_by_lineno(path) for path in data.measured_files()}
    width = Counter(test for lines in run.values() for tests in lines.values() for test in tests)
    files = sorted(Path("tests").rglob("test_*.py"), key=lambda path: path.stat().st_size)
    named = {str(path): path.read_text(encoding="utf-8") for path in files}
    by_place: dict[Place, list[tuple[str, int]]] = defaultdict(list)
    rooms = {str(path): room for room in ROOMS for path in Path("smartplay_tools", room).rglob("*.py")}
    for path in sorted(rooms):
        for place, *mutant in mutants(Path(path)):
            by_place[place].append(mutant)
    results.touch()
    done = {tuple(json.loads(line)["place"]) for line in results.read_text(encoding="utf-8").splitlines()}
    for place in chance.sample(sorted(by_place), int(sample)):
        operator, number = chance.choice(by_place[place])
        if place in done:
            continue
        path, running = Path(place[0]), tests_of(place, run, width)
        module = ".".join(path.with_suffix("").parts)
        naming = [file for file, text in named.items() if module in text]
        with use_mutation(path, plugins.get_operator(operator)(), number) as (_, code):
            said = "survived"
            batches = (
                (running[:25], 60),
                (naming[:5], 300),
                (tests_of_package(place[0], rooms[place[0]]), 600),
                (running[25:400], 300),
            )
            for batch, seconds in batches:
                said = outcome(batch, seconds) if batch and said == "survived" else said
        line = {"place": place, "mutant": operator, "outcome": said, "becomes": code.splitlines()[place[1] - 1]}
        with results.open("a", encoding="utf-8") as out:
            print(json.dumps(line), file=out)
    print(Counter(json.loads(line)["outcome"] for line in results.read_text(encoding="utf-8").splitlines()))


if __name__ == "__main__":
    main(*sys.argv[1:])
