"""Pages of very large runs: which episodes they hold, and that their tables are of all of them."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import subprocess
import sys

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import DamageWarning, SmartPlayWarning
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from tests.evaluation.command import shown_by
from tests.evaluation.report_runs import known_for_now, record
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


def held(runs, asked: str | None) -> list[str]:
    """The keys of the episodes that a page would hold."""
    chosen = sources.choose(sources.find_runs(runs), asked)
    return [source.key for shown in chosen for source in shown.sources.episodes]


def test_a_page_of_too_many_episodes_holds_the_first_trials_and_says_so(run, tmp_path):
    shown = shown_by("report", run, "--out", tmp_path / "page.html")
    assert "holds 5 of 6 episodes, the first trials" in shown
    assert "This page holds 5 of 6 episodes" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert len(held([run], "all")) == 6


def test_a_page_says_nothing_of_each_episode_that_it_does_not_show(run):
    page = report.render_report(run, episodes="1")
    (shown,) = held([run], "1")
    assert [episode.key for episode in RunFolder(run).manifest().episodes if episode.key in page] == [shown]


def test_records_that_are_too_large_are_too_many(run, monkeypatch):
    monkeypatch.setattr(sources, "MOST_EPISODES", 6)
    monkeypatch.setattr(sources, "MOST_BYTES", 1)
    with pytest.warns(SmartPlayWarning, match="holds 1 of 6"):
        assert len(held([run], None)) == 1


def test_a_number_takes_the_first_trials_of_every_game(run):
    rows = {row["key"]: row for row in RunFolder(run).rows()}
    assert {(rows[key]["game"], rows[key]["trial"]) for key in held([run], "2")} == {(HANOI, 0), (BANDIT, 0)}


def test_what_chooses_nothing_is_an_error(run):
    for asked in ("failed", "0", "last"):
        with pytest.raises(sp.InvalidArgumentError, match=f"--episodes {asked} chooses no episode"):
            held([run], asked)


def test_episodes_of_several_runs_are_pairs(run, tmp_path):
    budget = sp.Budget(tool_calls=3)
    sp.evaluate([HANOI, BANDIT], ["random"], out=tmp_path / "b", trials=3, budgets=budget, executor="inline")
    chosen = sources.choose(sources.find_runs([run, tmp_path / "b"]), "4")
    trials = [[source.facts["trial"] for source in shown.sources.episodes] for shown in chosen]
    assert trials == [[0, 0], [0, 0]]
    with pytest.warns(SmartPlayWarning, match="holds 4 of 12"):
        assert held([run, tmp_path / "b"], None) == held([run, tmp_path / "b"], "4")


@pytest.mark.slow
def test_the_tables_are_of_all_episodes(run, monkeypatch):
    # Figures take long to draw, and no test here is about them.
    monkeypatch.setattr("smartplay_tools.evaluation.pages.report.page.figures", lambda runs: [])
    page = report.render_report(run, episodes="2")
    assert len(unpacked(page, "pack-0")) == 2
    assert "This page holds 2 of 6 episodes" in page
    assert re.findall(r"In all: (\d) finished episodes", page) == ["6"]
    assert "This page holds" not in report.render_report(run, episodes="all")


@pytest.mark.slow
def test_several_processes_write_the_page_that_one_writes(run, tmp_path, monkeypatch):
    reading = pytest.importorskip("smartplay_tools.evaluation.pages.report.episode_reading")
    monkeypatch.setattr(reading, "WORTH_A_PROCESS", 1)
    pages = []
    for workers in (1, 3):
        out = report.write_report(run, tmp_path / f"{workers}.html", title="A run", episodes="all", workers=workers)
        pages.append(out.read_bytes())
    assert pages[0] == pages[1]


def test_a_game_that_only_this_process_knows_is_drawn_in_every_episode(tmp_path, monkeypatch):
    reading = pytest.importorskip("smartplay_tools.evaluation.pages.report.episode_reading")
    monkeypatch.setattr(reading, "WORTH_A_PROCESS", 1)
    known_for_now(monkeypatch, dataclasses.replace(sp.GAMES[HANOI], id="MyHanoi-v0"))
    for seed in range(4):
        record(tmp_path / "records" / f"{seed}.jsonl", "MyHanoi-v0", seed=seed)
    shown = sources.find_sources(tmp_path / "records").episodes
    drawn = [json.loads(episode.text)["drawing"] for episode in reading.read_episodes(shown, "", workers=3)[0]]
    assert [drawing["kind"] for drawing in drawn] == ["hanoi"] * 4


@pytest.mark.slow
def test_a_record_that_cannot_be_shown_is_named_whichever_process_reads_it(run, tmp_path, monkeypatch):
    reading = pytest.importorskip("smartplay_tools.evaluation.pages.report.episode_reading")
    monkeypatch.setattr(reading, "WORTH_A_PROCESS", 1)
    copied = shutil.copytree(run, tmp_path / "run")
    records = sorted((copied / "episodes").glob("*.jsonl"))
    records[2].write_text(records[2].read_text().replace('"position": ', '"place": '))
    for workers in (1, 2):
        with pytest.warns(DamageWarning, match=records[2].name):
            report.render_report(copied, episodes="all", workers=workers)


@pytest.mark.slow
def test_a_script_whose_processes_cannot_begin_writes_the_page_all_the_same(run, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from smartplay_tools.evaluation.pages.report import episode_reading as reading\n"
        "from smartplay_tools.evaluation.pages.report.page import write_report\n"
        "reading.WORTH_A_PROCESS = 1\n"
        f"write_report({str(run)!r}, {str(tmp_path / 'page.html')!r}, title='A run', episodes='all', workers=2)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert "if __name__ == '__main__':" in done.stderr
    alone = report.write_report(run, tmp_path / "alone.html", title="A run", episodes="all")
    assert (tmp_path / "page.html").read_bytes() == alone.read_bytes()
