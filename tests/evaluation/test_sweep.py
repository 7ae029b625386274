"""A grid of windows is played on the same seeds, resumed, and made into tables and figures."""

from __future__ import annotations

import csv
from itertools import product

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.sweeps import grid, sweep
from tests.evaluation.command import refused, shown_by

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"


def windows(cells):
    return [(cell.budget.history, cell.budget.prompt_tokens, cell.budget.slack) for cell in cells]


# The grid.


def test_a_grid_is_every_combination_in_the_order_of_the_lists():
    cells = grid(
        [HANOI, BANDIT],
        ["rule", "random"],
        vary={"history": [1, None], "slack": [0, 0.5], "manual": ["tool", "pinned"]},
    ).cells
    assert len(cells) == 2 * 2 * 2 * 2 * 2
    outer = list(product((HANOI, BANDIT), ("rule", "random"), ("tool", "pinned")))
    assert [(c.game, c.player, c.manual) for c in cells[::4]] == outer
    assert windows(cells[:4]) == [(1, None, 0), (1, None, 0.5), (None, None, 0), (None, None, 0.5)]


def test_a_window_that_is_named_twice_is_played_once():
    """50 is the paper's history of the bandit, and not of Hanoi, where it is a window of its own."""
    cells = grid([BANDIT, HANOI], ["rule"], vary={"history": ["game", 50, 1, 1], "prompt_tokens": [None, None]}).cells
    assert [(c.game, c.budget.history) for c in cells] == [
        (BANDIT, "game"), (BANDIT, 1), (HANOI, "game"), (HANOI, 50), (HANOI, 1),
    ]  # fmt: skip


def test_what_does_not_vary_is_in_the_budget():
    cells = grid([BANDIT], ["rule"], budget=sp.Budget(history=3, prompt_tokens=900), manual="pinned").cells
    assert [(cell.budget.history, cell.budget.prompt_tokens, cell.manual) for cell in cells] == [(3, 900, "pinned")]
    cells = grid([BANDIT], ["rule"], vary={"tool_calls": [5, 9]}, budget=sp.Budget(history=3)).cells
    assert [(cell.budget.history, cell.budget.tool_calls) for cell in cells] == [(3, 5), (3, 9)]


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"history": [1, 5]}, "no argument history"),
        ({"vary": {"steps": [1]}}, "cannot vary steps; its axes are history, prompt_tokens"),
        *(({"vary": {"history": values}}, "history must be a list") for values in ([], 5, "game")),
    ],
)
def test_axes_vary_by_lists_and_nothing_else_does(asked, sentence):
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        grid([BANDIT], ["rule"], **asked)


# Playing it.


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    out = tmp_path_factory.mktemp("sweep")
    return sweep(
        [BANDIT], ["rule", "random"], vary={"history": [1, 50], "slack": [0, 0.5]}, trials=4, out=out, executor="inline"
    )


def test_whoever_remembers_less_earns_less_and_whoever_looks_at_nothing_does_not_care(played):
    rows = {(row["player"], row["history"], row["slack"]): row for row in played.summary}
    full, forgetful = rows["rule", 50, 0], rows["rule", 1, 0]
    assert full["full_context"]
    assert forgetful["score_difference_high"] < 0
    assert forgetful["tokens_difference"] < 0
    assert forgetful["pairs"] == 4
    for window in ((1, 0), (1, 0.5), (50, 0.5)):
        control = rows["random", *window]
        assert control["score_difference"] == 0


def test_the_same_call_resumes_it(played):
    before = {path: path.stat().st_mtime_ns for path in (played.folder.path / "episodes").iterdir()}
    again = sweep(
        [BANDIT], ["rule", "random"], out=played.folder.path, trials=4, executor="inline",
        vary={"history": [1, 50], "slack": [0, 0.5]},
    )  # fmt: skip
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert again.summary == played.summary


@pytest.mark.slow
def test_it_writes_tables_and_figures(played):
    written = {path.relative_to(played.folder.path).as_posix() for path in played.write()}
    stems = ("score-against-history", "frontier")
    assert written == {"table.csv", "summary.csv"} | {
        f"figures/{stem}.{suffix}" for stem in stems for suffix in ("pdf", "png", "svg")
    }
    folder = played.folder.path
    assert len((folder / "table.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(played.rows) == 33
    with (folder / "summary.csv").open(encoding="utf-8", newline="") as file:
        summary = list(csv.DictReader(file))
    assert [float(row["score"]) for row in summary] == [row["score"] for row in played.summary]
    assert summary[0]["cost_difference"] == "0.0"


def test_a_sweep_that_could_afford_nothing_says_nothing(tmp_path):
    """The run's own cap has room for no episode, so there is nothing to compare, and nothing breaks."""
    poor = sweep(
        [BANDIT], ["rule"], vary={"history": [1, 50]}, trials=2, run_tokens=900, out=tmp_path, executor="inline"
    )
    assert poor.cap_reached
    assert poor.rows == []
    assert poor.summary == []
    assert {path.name for path in poor.write()} == {"table.csv", "summary.csv"}
    with pytest.raises(sp.InvalidArgumentError, match="at least one game and one player"):
        sweep([], ["rule"], out=tmp_path)


# The command.


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--history", "1,many"], "--history many"),
        (["--history", ","], "--history is empty"),
        (["--prompt-tokens", "0"], "--prompt-tokens 0"),
        (["--slack", "0,2"], "--slack 2"),
        (["--slack", "much"], "--slack much: Input should be a valid number"),
        (["--manual", "lost"], "'lost'"),
    ],
)
def test_a_mistake_is_told_in_a_sentence(options, sentence, tmp_path):
    assert sentence in refused("sweep", "--games", BANDIT, "--out", tmp_path / "run", *options)
    assert not (tmp_path / "run").exists()


def test_a_dry_run_plays_nothing(tmp_path):
    command = ["sweep", "--games", BANDIT, "--history", "1,5", "--dry-run", "--out", tmp_path / "run"]
    table = shown_by(*command).splitlines()
    assert table[0].split()[:4] == ["game", "and", "player", "episodes"]
    assert [line[:17].strip() for line in table[2:5]] == ["rule, history 1", "rule, history 5", "all"]
    assert not (tmp_path / "run").exists()


def test_strategies_are_axes_and_what_cannot_be_enforced_is_left_out_and_named():
    planned = grid(
        [BANDIT],
        ["rule-notes"],
        vary={
            "history": [10],
            "prompt_tokens": [600, 330],
            "slack": [0, 0.5],
            "beyond_history": ["drop", "mask"],
            "summary_tokens": [None, 100],
        },
    )
    asked = [(cell.budget.prompt_tokens, cell.budget.slack, *cell.budget.strategies) for cell in planned.cells]
    assert len(asked) == len(set(asked)) == 2 * 2 * 2 + 2
    assert not any("summary_tokens" in cell and (cell[1] == 0 or cell[0] == 330) for cell in asked)
    assert any("slack 0" in reason for reason in planned.left_out)
    assert any("more that summary_tokens=100 needs" in reason for reason in planned.left_out)


def test_cells_that_differ_in_strategy_are_paired_with_plain_dropping(tmp_path):
    vary = {"history": [10], "prompt_tokens": [600], "notes_tokens": [None, 200]}
    swept = sp.sweep([BANDIT], ["rule-notes"], vary=vary, trials=2, out=tmp_path / "run", executor="inline")
    plain, noted = swept.comparisons
    assert plain.is_reference
    assert noted.reference == plain.cell
    assert noted.differences["score"].episodes == 2
    assert noted.cell.budget["notes_tokens"] == 200
    assert [row["notes_tokens"] for row in swept.summary] == [None, 200]
