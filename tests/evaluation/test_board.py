"""`smartplay-tools board`: a leaderboard whose scores come from replayed records, and whose texts stay text."""

from __future__ import annotations

import json
import shutil

import pytest
from typer.testing import CliRunner

from smartplay_tools.cli import app
from smartplay_tools.evaluation.board.site import build_board
from smartplay_tools.evaluation.board.submissions.prepare import prepare_submission
from tests.evaluation import bundles
from tests.evaluation.bundles import FACTS, HANOI, Files, changed, records

pytestmark = pytest.mark.slow

SCRIPT = "<script>alert(1)</script><img src=x onerror=alert(2)>"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board")
    for player in ("rule", "random"):
        made = bundles.play_bundle(folder / player, player=player, model_name=f"The {player} player")
        shutil.copyfile(made, folder / f"{player}.zip")
    prepare_submission(folder / "rule" / "run", folder / "script.zip", {**FACTS, "model_name": SCRIPT})

    def cheat(files: Files) -> None:
        name = records(files, HANOI)[0]
        files[name] = files[name].replace(b'"is_error": false', b'"is_error": true', 1)

    changed(folder / "random.zip", folder / "cheat.zip", cheat)
    return folder


def test_submissions_are_ranked_by_what_replays(folder, tmp_path):
    board = build_board(folder, tmp_path, workers=0, replays=0)
    (group,) = board.classes
    names = [entry.submission.model_name for entry in group.entries]
    assert sorted(names[:2]) == sorted([SCRIPT, "The rule player"])
    assert names[2:] == ["The random player"]
    assert group.ranked_games == (HANOI, "BanditTwoArmedHighLowFixed-v0")
    first, last = group.entries[0], group.entries[-1]
    assert first.mean.mean > last.mean.mean
    assert first.games[HANOI].score.mean == 3
    assert (first.cost, first.modelled) == (0, None)
    assert board.rules == ("none", "openai-5-6", "anthropic-512", "vllm")
    for entry in group.entries:
        nothing, *_, server = entry.costs
        assert nothing > entry.tokens > server > 0  # a reply's token costs more than one of a prompt
    assert [one.bundle for _, one in board.refused] == ["cheat.zip"]


def test_the_page_shows_texts_as_text_and_allows_no_script(folder, tmp_path):
    build_board(folder, tmp_path, workers=0, replays=0)
    page = (tmp_path / "index.html").read_text()
    assert "<script" not in page
    assert "<img" not in page
    assert page.count('<g class="point') == 3, "score against tokens"
    assert page.count('y="277"') >= 2, "ticks of the tokens, though the submissions took nearly as many"
    head = page.partition("<thead")[2].partition("</thead>")[0]
    assert "Bandit HighLow" in head
    assert head.index("proof") < head.index("mean"), "in sight on narrow screens"
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "default-src &#39;none&#39;" in page or "default-src 'none'" in page
    assert "Not verified" in page
    costs = page.partition("<h3>Costs</h3>")[2]
    assert ">anthropic-512</th>" in costs.partition("</thead>")[0], "in a table of their own, so that neither scrolls"
    assert page.count('data-head="anthropic-512"') == 3, "the head of each figure where a row is a card"
    for place in tmp_path.glob("*/report.json"):
        assert json.loads(place.read_text())["format"] == 1


def test_the_command_writes_pages_to_watch(folder, tmp_path):
    shutil.copyfile(folder / "rule.zip", tmp_path / "rule.zip")
    done = CliRunner().invoke(app, ["board", str(tmp_path), "--out", str(tmp_path / "site"), "--workers", "1"])
    assert done.exit_code == 0, done.output
    assert "1 of 1 submissions" in done.output
    (page,) = (tmp_path / "site").glob("*/replays.html")
    assert 'id="pack-0"' in page.read_text()
    assert "What an episode costs" in page.read_text()
    empty = CliRunner().invoke(app, ["board", str(tmp_path / "site"), "--out", str(tmp_path / "no")])
    assert (empty.exit_code, "holds no bundle" in empty.output) == (2, True)
