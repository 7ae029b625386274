"""A run as flat tables and as text: what notebooks read and what a terminal shows."""

from __future__ import annotations

import csv
import json

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.details import details
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, to_html, to_markdown
from smartplay_tools.evaluation.analysis.headline import headline
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.tables import COLUMNS, LATER, flat, summary_json, write_csv
from smartplay_tools.providers.prices import Price
from tests.evaluation.runs import failed_row, play_row, play_rows

RPS, HANOI, HANOI4 = "RockPaperScissorBasic-v0", "Hanoi3Disk-v0", "Hanoi4Disk-v0"


def rock(times: int, usage: sp.Usage | None = None) -> sp.ScriptedPlayer:
    return sp.ScriptedPlayer([sp.call("act", action="Rock")] * times, usage)


@pytest.fixture(scope="module")
def rows():
    budget = sp.Budget(prompt_tokens=2_000)
    with_usage = play_row(RPS, rock(50, sp.Usage(prompt=100, reply=7, cached=60)), price=Price.per_million(200, 0))
    return [*play_rows(HANOI4, "random", 3, budget=budget), *play_rows(HANOI, trials=2), with_usage]


# Files.


def test_nothing_of_a_row_is_lost(rows):
    """Whatever a row says has a column: by its own name, or by the path of its parts. This row has no strategy."""

    def leaves(value, path=""):
        if isinstance(value, dict) and path not in ("asked", "options", "player_options", "deviations", "versions"):
            return [leaf for key, each in value.items() for leaf in leaves(each, f"{path}.{key}".lstrip("."))]
        return [path]

    row = rows[-1]
    written = leaves(row)
    usual = [path for path, _ in COLUMNS.values() if path.rpartition(".")[2] not in LATER or path in written]
    assert sorted([*written, "run"]) == sorted(usual)
    assert flat(row)["budget_beyond_history"] == "drop"
    assert flat(row)["summaries"] == flat(row)["summary_prompt_tokens"] == 0
    assert flat(row)["budget_notes_tokens"] is None


def test_every_cap_of_a_budget_has_a_column():
    assert {f"budget_{name}" for name in sp.Budget.model_fields} < COLUMNS.keys()


def test_no_cell_is_computed_by_a_spreadsheet_or_lost_with_half_a_character(rows, tmp_path):
    texts = ["=1+1", "+cmd", "-cmd", "@cmd", "\t=1", "\r=1", "\udcff", "-1.5e3", "plain"]
    write_csv([{**rows[0], "player": text, "reward": -1.5} for text in texts], tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    assert [row["player"] for row in read] == [*(f"'{text}" for text in texts[:5]), r"'\r=1", "\ufffd", *texts[7:]]
    assert {row["reward"] for row in read} == {"-1.5"}


def test_csv_has_a_line_for_every_episode(rows, tmp_path):
    path = tmp_path / "run.csv"
    write_csv(rows, path)
    with path.open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    assert list(read[0]) == list(COLUMNS)
    assert [float(line["score"]) for line in read] == [row["score"] for row in rows]
    assert [int(line["prompt_tokens"]) for line in read] == [row["tokens"]["prompt"] for row in rows]
    assert read[0]["budget_prompt_tokens"] == "2000"
    assert read[0]["normalized_score"] == read[0]["provider_requests"] == ""
    assert read[-1]["provider_cached_tokens"] == "3000"
    assert float(read[-1]["cost"]) == rows[-1]["cost"] == pytest.approx(1)
    assert json.loads(read[-1]["versions"]) == rows[-1]["versions"]


def test_the_summary_is_json(rows):
    summary = json.loads(json.dumps(summary_json(summarize(rows))))
    hanoi4, hanoi, rps = summary["cells"]
    assert hanoi["score"] == {
        "mean": 3,
        "low": pytest.approx(3 * 0.05**0.5),
        "high": 3,
        "episodes": 2,
        "note": None,
        "all_equal": True,
        "sd": 0,
    }
    assert hanoi4["normalized_score"] is None
    assert rps["tokens"]["prompt_drift"]["provider"] == 5_000
    assert rps["tokens"]["prompt_drift"]["difference"] == 5_000 - rps["tokens"]["prompt"]
    assert 0 < rps["tokens"]["prefix_share"] < 1
    assert summary["profiles"][0]["condition"]["label"] == "prompts <= 2,000"
    assert summary["profiles"][0]["capabilities"]["left_out"] == [HANOI4]


# Tables of words.


def cells_of(tables) -> str:
    """Everything that stands in tables, a line for each row."""
    return "\n".join(" | ".join(row) for table in tables for row in ((table.title,), *table.rows, table.notes))


def test_the_headline_has_a_line_for_every_game_and_player(rows):
    table = headline(summarize(rows))
    headings = ["game and player", "n", "score", "points", "% human", "tokens", "USD"]
    assert [column.heading for column in table.columns] == headings
    assert [row[0] for row in table.rows] == [HANOI4, "  random, prompts <= 2,000", HANOI, "  rule", RPS, "  scripted"]
    assert table.rows[3] == ("  rule", "2", "3.00 [0.67, 3.00]", "+100.00", "100", "5.1k", "0")
    assert table.rows[5][-1] == "1.00"


def test_a_player_under_several_conditions_is_told_apart(rows):
    summary = summarize([*rows, *play_rows(HANOI, trials=2, budget=sp.Budget(history=1))])
    assert [row[0] for row in headline(summary).rows if "rule" in row[0]] == ["  rule", "  rule, history 1"]


def test_figures_of_a_game_have_the_same_decimals():
    budget = sp.Budget(tool_calls=30)
    crafter = [
        row | {"score": 1234.5 * trial} for trial, row in enumerate(play_rows("Crafter-v0", trials=2, budget=budget))
    ]
    (_, line) = headline(summarize(crafter)).rows
    assert line[3] == "617 [-7,226, 8,460]"


def test_every_figure_is_in_the_details(rows):
    text = cells_of(details(summarize(rows)))
    assert "terminated 2" in text
    assert f"{HANOI4}: no normalised score" in text
    assert "one action a prompt" in text
    assert all(name in text for name in sp.GAMES[HANOI].challenges)


def test_failures_are_shown_with_their_error(rows):
    failed = failed_row(play_row(RPS, rock(1)))
    assert "attempts without a result" not in cells_of(details(summarize(rows)))
    assert "StopIteration" in cells_of(details(summarize(rows, [failed])))


def test_a_privileged_player_is_marked(rows):
    summary = summarize([*rows, *play_rows(HANOI, "oracle", 2)])
    assert [cell.cell.player for cell in summary.cells if cell.privileged] == ["oracle"]
    assert [profile.condition.player for profile in summary.profiles if profile.privileged] == ["oracle"]
    text = cells_of([headline(summary)])
    assert "oracle*" in text
    assert "rule*" not in text
    assert "*: privileged" in text


def test_cut_results_are_warned_of():
    budget = sp.Budget(prompt_tokens=500, tool_calls=20)
    summary = summarize(play_rows("Crafter-v0", "random", 2, budget=budget))
    assert summary.cells[0].cut_share > 0.9
    text = cells_of([headline(summary)])
    assert "random\N{DOUBLE DAGGER}\N{DAGGER}" in text
    assert "tool results were cut to fit" in text
    assert "cut to fit" not in cells_of([headline(summarize(play_rows(HANOI, trials=1)))])


def test_an_empty_run_shows_nothing():
    assert headline(summarize([])).rows == ()
    assert list(details(summarize([]))) == []


# Formats.

TABLE = TextTable(
    "what & why",
    (Column("player", words=True), Column("score")),
    (("a_game",), ("  one|two", "<5%"), ("  three", "1 [0, 2]")),
    ("a note",),
)


def test_a_table_in_markdown():
    lines = to_markdown(TABLE).splitlines()
    assert lines[2:6] == [
        "| player | score |",
        "| --- | ---: |",
        "| a_game, one\\|two | <5% |",
        "| a_game, three | 1 [0, 2] |",
    ]


def test_a_table_in_html():
    text = to_html([TABLE])
    assert "&lt;5%" in text
    assert '<th colspan="2" style="text-align: left">a_game</th>' in text
