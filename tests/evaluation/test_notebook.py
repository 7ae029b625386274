"""Runs in notebooks: inside of a running event loop, as tables, as data frames, as replays."""

from __future__ import annotations

import html
import re

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.pages.report.page import render_report

pytestmark = pytest.mark.slow

HANOI, BANDIT = "Hanoi3Disk-v0", "BanditTwoArmedHighLowFixed-v0"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return sp.evaluate([HANOI, BANDIT], ["rule"], out=tmp_path_factory.mktemp("run"), trials=2, executor="inline")


async def test_what_goes_wrong_there_is_raised_where_it_was_called(tmp_path):
    def interrupted(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sp.evaluate([HANOI], ["rule"], out=tmp_path, trials=1, executor="inline", on_progress=interrupted)


def test_a_sweep_shows_its_windows(tmp_path):
    swept = sp.sweep([BANDIT], ["rule"], vary={"history": [1, 5]}, trials=2, out=tmp_path, executor="inline")
    assert "history 5" in swept._repr_html_()
    assert "reference" in swept._repr_html_()
    assert swept.show(1).transcript == swept.folder.transcript(swept.rows[1]["key"])


def test_rows_become_a_data_frame(run):
    pytest.importorskip("pandas")
    frame = run.to_pandas()
    assert list(frame["game"]) == [HANOI, HANOI, BANDIT, BANDIT]
    assert frame.groupby("game")["score"].mean()[HANOI] == 3
    assert str(frame["completed"].dtype) == "boolean"
    assert frame["provider_requests"].isna().all()


def test_an_episode_is_replayed_below_the_cell(run):
    row = run.rows[2]
    for episode in (2, -2, row["key"], row):
        shown = run.show(episode, height=500)._repr_html_()
        assert 'sandbox="allow-scripts"' in shown
        assert 'height="500"' in shown
        page = html.unescape(re.search('srcdoc="([^"]*)"', shown)[1])
        assert page == render_report(run.transcript(row["key"]), open_first=True)
        assert f'data-open="{row["key"]}"' in page


@pytest.mark.parametrize(("episode", "sentence"), [(4, "4 is out of range"), ("x", "no finished episode 'x'")])
def test_an_episode_that_is_not_there_is_one_sentence(run, episode, sentence):
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        run.show(episode)
