"""Every claim of the documentation's first sentences is in one list, and is what its rows say."""

from __future__ import annotations

import importlib
import re
import tomllib
from pathlib import Path

import pytest

from smartplay_tools.evaluation.analysis.pairs import paired_difference

ROOT = Path(__file__).parents[1]
LIST = ROOT / "experiments" / "claims.toml"

pytestmark = [
    pytest.mark.skipif(not LIST.exists(), reason="not in a checkout"),
    pytest.mark.usefixtures("beside_the_scripts"),
]

CLAIMS = tomllib.loads(LIST.read_text(encoding="utf-8"))["claim"] if LIST.exists() else []
SET_UP = {
    "cap-audit.md", "command-line.md", "context-cost.md", "index.md", "mcp.md", "minecraft.md", "stability.md",
    "verifiers.md",
}  # fmt: skip
"""Pages whose first paragraph has numbers of what the page is about, and of no finding."""
INTERVAL = re.compile(r"\[(\S+), (\S+)\]")


@pytest.fixture(scope="module")
def rows():
    """The published rows of an experiment, read once."""
    known, read = importlib.import_module("tables").experiments(), {}
    return lambda name: read.setdefault(name, known[name].rows())


@pytest.fixture(scope="module")
def tables(rows):
    """The tables of an experiment, made from its rows."""
    known, made = importlib.import_module("tables").experiments(), {}
    return lambda name: made.setdefault(name, known[name].tables(rows(name)))


def plain(text):
    """The words of a page, without links, emphasis and line breaks."""
    return " ".join(re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text).replace("*", "").replace("`", "").split())


def cell(table, keys, column):
    """The one cell of a table whose line has all the keys as cells."""
    headings, _, *lines = ([each.strip(" *`") for each in line.strip("| ").split(" | ")] for line in table.splitlines())
    [found] = [line for line in lines if set(keys) <= set(line)]
    return found[headings.index(column)]


def verdict(shown):
    """Whether an interval in a cell says more or less than 0."""
    if shown.startswith(("equal", "identical")):
        return "equal"
    low, high = (float(end.replace(",", "")) for end in INTERVAL.search(shown).groups())
    return "undecided" if low <= 0 <= high else "more" if low > 0 else "less"


def has(row, wanted):
    """Whether a row, or its budget, has these fields."""
    return all(row.get(name, row.get("budget", {}).get(name)) == value for name, value in wanted.items())


@pytest.mark.slow
@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim["name"])
def test_a_claim_is_what_its_rows_say(claim, rows, tables):
    for page, says in claim["says"].items():
        assert says in plain((ROOT / page).read_text(encoding="utf-8")), f"{page} does not say so"
    for name, keys, column, expected in claim.get("cells", ()):
        [table] = [table for each, table in tables(claim["rows"]).items() if each == name]
        shown = cell(table, keys, column)
        is_verdict = expected in ("more", "less", "undecided", "equal")
        assert verdict(shown) == expected if is_verdict else shown.startswith(expected), (keys, column, shown)
    for counted in claim.get("counts", ()):
        assert sum(has(row, counted["of"]) for row in rows(claim["rows"])) == counted["is"]
    for pair in claim.get("pairs", ()):
        own, other = ([row for row in rows(claim["rows"]) if has(row, pair[side])] for side in ("this", "less"))
        estimate = paired_difference(own, other, measure(pair["measure"]))
        assert importlib.import_module("page_tables").interval(estimate, "+") == pair["is"]
    for proof in claim.get("tests", ()):
        path, _, test = proof.partition("::")
        assert f"def {test}(" in (ROOT / path).read_text(encoding="utf-8"), proof


def measure(name):
    """A field of a row; `costs.1` is one of its costs."""
    field, _, at = name.partition(".")
    return lambda row: row[field][int(at)] if at else row[field]


def test_every_claim_says_how_it_was_held_against_chance():
    for claim in CLAIMS:
        assert set(claim) - {"cells", "counts", "pairs", "tests", "rows"} == {
            "name", "says", "controls", "otherwise", "other_caps",
        }, claim["name"]  # fmt: skip
        assert any(claim.get(kind) for kind in ("cells", "counts", "pairs", "tests")), claim["name"]


def first_words():
    """The section of findings of README and of the front page, and the first paragraph of every page."""
    for page in ("README.md", "docs/index.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        yield page, text.partition("## What was found\n")[2].partition("\n## ")[0]
    for path in sorted((ROOT / "docs").glob("*.md")):
        text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        paragraph = re.search(r"^(?!#|\s|:|\(|<).*?(?=\n\n)", text, re.MULTILINE | re.DOTALL)
        if path.name not in SET_UP and paragraph:
            yield f"docs/{path.name}", paragraph[0]


def test_no_number_of_the_first_sentences_is_without_a_claim():
    for page, text in first_words():
        left = plain(re.sub(r"^!\[.*$", "", text, flags=re.MULTILINE))
        for claim in CLAIMS:
            left = left.replace(claim["says"].get(page, "\0"), "")
        assert not re.search(r"(?<![=\w.-])\d", left), f"{page}: {left}"
