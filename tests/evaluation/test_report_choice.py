"""Pages of very large runs: which episodes they hold, and that their tables are of all of them."""

from __future__ import annotations

import re
import shutil

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import SmartPlayWarning
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.records.damage import DamageWarning
from tests.evaluation.command import shown_by
from tests.evaluation.test_view import unpacked

pytest.importorskip("jinja2")
report = pytest.importorskip("smartplay_tools.evaluation.pages.report.page")
sources = pytest.importorskip("smartplay_tools.evaluation.pages.report.sources")

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "run"
    sp.evaluate([HANOI, BANDIT], ["random"], out=out, trials=3, budgets=sp.Budget(tool_calls=2), executor="inline")
    return out


@pytest.fixture(autouse=True)
def _small_limit(monkeypatch):
    monkeypatch.setattr(sources, "MOST_EPISODES", 5)


def held(*runs) -> list[str]:
    """The keys of the episodes that a page would hold."""
    chosen = sources.that_open_well(sources.find_runs(runs))
    return [source.key for shown in chosen for source in shown.sources.episodes]


def test_a_page_of_too_many_episodes_holds_the_first_trials_and_says_so(run, tmp_path):
    shown = shown_by("report", run, "--out", tmp_path / "page.html")
    assert "holds 5 of 6 episodes, the first trials" in shown
    assert "This page holds 5 of 6 episodes" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_records_that_are_too_large_are_too_many(run, monkeypatch):
    monkeypatch.setattr(sources, "MOST_EPISODES", 6)
    assert len(held(run)) == 6
    monkeypatch.setattr(sources, "MOST_BYTES", 1)
    with pytest.warns(SmartPlayWarning, match="holds 1 of 6"):
        assert len(held(run)) == 1


def test_the_first_trials_of_every_game_are_held(run, monkeypatch):
    monkeypatch.setattr(sources, "MOST_EPISODES", 2)
    rows = {row["key"]: row for row in RunFolder(run).rows()}
    with pytest.warns(SmartPlayWarning, match="holds 2 of 6"):
        assert {(rows[key]["game"], rows[key]["trial"]) for key in held(run)} == {(HANOI, 0), (BANDIT, 0)}


def test_episodes_of_several_runs_are_pairs(run, tmp_path):
    budget = sp.Budget(tool_calls=3)
    sp.evaluate([HANOI, BANDIT], ["random"], out=tmp_path / "b", trials=3, budgets=budget, executor="inline")
    with pytest.warns(SmartPlayWarning, match="holds 4 of 12"):
        chosen = sources.that_open_well(sources.find_runs([run, tmp_path / "b"]))
    trials = [[source.facts["trial"] for source in shown.sources.episodes] for shown in chosen]
    assert trials == [[0, 0], [0, 0]]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The page holds")
def test_the_tables_are_of_all_episodes(run, monkeypatch):
    # Figures take long to draw, and no test here is about them.
    monkeypatch.setattr("smartplay_tools.evaluation.pages.report.page.figures", lambda runs: [])
    monkeypatch.setattr(sources, "MOST_EPISODES", 2)
    page = report.render_report(run)
    shown = [episode.key for episode in RunFolder(run).manifest().episodes if episode.key in page]
    assert sorted(shown) == sorted(held(run)) == sorted(unpacked(page, "pack-0"))
    assert "This page holds 2 of 6 episodes" in page
    assert re.findall(r'<td class="rules">\s*random[^<]*</td><td class="number">(\d)</td>', page)[:1] == ["3"]
    monkeypatch.setattr(sources, "MOST_EPISODES", 6)
    assert "This page holds" not in report.render_report(run)


def test_a_record_that_cannot_be_shown_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "MOST_EPISODES", 6)
    copied = shutil.copytree(run, tmp_path / "run")
    records = sorted((copied / "episodes").glob("*.jsonl"))
    records[2].write_text(records[2].read_text().replace('"position": ', '"place": '))
    with pytest.warns(DamageWarning, match=records[2].name):
        report.render_report(copied)
