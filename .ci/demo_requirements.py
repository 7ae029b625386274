"""Print what the environment of `make demo` holds, one requirement a line.

    python .ci/demo_requirements.py [EXTRA | EXTRA:PACKAGE]...     with further extras, or one package of an extra

That is what builds the package, what it needs itself, the extras `openai` and `serve`, for the commands that the demo
names at its end, and the templates of its pages; all as `pyproject.toml` has it. What only games outside the demo,
figures and tables need is left out: it is most of the size.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

EXTRAS = ("openai", "serve", "evaluation")

NOT_IN_THE_DEMO = {
    "crafter": "pictures of Crafter",
    "genai-prices": "prices of models",
    "matplotlib": "figures",
}
"""What is left out, and what needs it."""


def demo_requirements(pyproject: Path, *extras: str) -> list[str]:
    """Return the requirements, with those of further extras; `EXTRA:PACKAGE` is one package of an extra."""
    described = tomllib.loads(pyproject.read_text(encoding="utf-8"))
    project = described["project"]
    wanted = [
        *described["build-system"]["requires"],
        *project["dependencies"],
        *(line for extra in (*EXTRAS, *extras) for line in _of_extra(project, *extra.split(":"))),
    ]
    left_out = {*NOT_IN_THE_DEMO, project["name"]}
    return [requirement for requirement in wanted if _name(requirement) not in left_out]


def _of_extra(project: dict[str, Any], extra: str, package: str | None = None) -> list[str]:
    lines: list[str] = project["optional-dependencies"][extra]
    return [line for line in lines if package in (None, _name(line))]


def _name(requirement: str) -> str:
    match = re.match(r"[\w.-]+", requirement)
    assert match is not None, requirement
    return match[0]


if __name__ == "__main__":
    print("\n".join(demo_requirements(Path(__file__).parents[1] / "pyproject.toml", *sys.argv[1:])))
