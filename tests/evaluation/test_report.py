"""The replay page as a file: its contents, its safety, its size, and how it shows runs with failures."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation import pages
from smartplay_tools.evaluation.pages.report.drawings import draw, pictures
from smartplay_tools.evaluation.pages.report.episode_reading import columns
from smartplay_tools.evaluation.pages.report.episodes import check
from smartplay_tools.evaluation.pages.report.page import render_runs, write_report
from smartplay_tools.evaluation.pages.report.sources import find_runs
from smartplay_tools.games import get_spec
from smartplay_tools.games.hanoi import Hanoi
from smartplay_tools.records import Record, recorded_pictures
from tests.evaluation.command import shown_by
from tests.evaluation.players import Broken, FirstMoves
from tests.evaluation.report_runs import (
    BANDIT,
    HANOI,
    HOSTILE,
    RPS,
    hostile,
    known_for_now,
    record,
)
from tests.processes import printed_by

NODE = shutil.which("node")
PAGES = Path(pages.__file__).parent


class Page(HTMLParser):
    """The contents of a page: its elements, its scripts, its packed data, its text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.styles: list[str] = []
        self.packed: dict[str, str] = {}
        self.words = ""
        self._inside: tuple[str, dict[str, str | None]] = ("", {})
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag, dict(attrs)
        self.elements.append(self._inside)

    def handle_endtag(self, tag: str) -> None:
        self._inside = "", {}

    def handle_data(self, data: str) -> None:
        tag, attributes = self._inside
        if tag == "script" and "id" in attributes:
            self.packed[attributes["id"] or ""] = data
        elif tag == "script":
            self.scripts.append(data)
        elif tag == "style":
            self.styles.append(data)
        else:
            self.words += data

    def unpack(self, name: str) -> Any:
        return json.loads(gzip.decompress(base64.b64decode(self.packed[name])))

    def episode(self, key: str) -> Any:
        packs = [self.unpack(name) for name in self.packed if name.startswith("pack-")]
        episode = next(pack[key] for pack in packs if key in pack)
        return {**episode, "turns": rows_of(episode["turns"])}


def rows_of(packed: Any) -> list[Any]:
    """Rows that a page has as columns."""
    if isinstance(packed, list):
        return packed
    rows: list[dict[str, Any]] = [{} for _ in range(packed["rows"])]
    for name, (numbers, values) in packed["columns"].items():
        for number, value in zip(numbers or range(len(rows)), rows_of(values), strict=True):
            rows[number][name] = value
    return rows


def page_of(run: Path, **options: Any) -> Page:
    """The page of a run without figures to be drawn: where there are some, no others are."""
    if run.is_dir() and not (run / "figures").exists():
        without_figures(run)
    return Page(write_report(run, run.parent / "page.html", **options))


def without_figures(run: Path) -> None:
    """Have nothing drawn for a run: its figures are an empty one."""
    (run / "figures").mkdir()
    (run / "figures" / "none.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')


def test_a_page_of_one_transcript_is_one_file_that_loads_nothing(tmp_path):
    page = page_of(record(tmp_path / "hanoi.jsonl", HANOI, prompt_tokens=700))
    assert list(page.packed) == ["index", "pack-0"]
    for tag, attributes in page.elements:
        assert not [name for name in attributes if name.startswith("on")], "no inline handlers"
        assert tag not in {"iframe", "object", "embed", "base", "audio", "video"}
        for name in ("src", "href", "action", "data", "srcset"):
            assert (attributes.get(name) or "#").startswith(("#", "data:")), (tag, attributes)


def test_the_policy_allows_the_page_s_own_scripts_and_style_by_their_hashes_and_nothing_else(tmp_path):
    page = page_of(record(tmp_path / "hanoi.jsonl", HANOI))
    policy = next(a["content"] for tag, a in page.elements if a.get("http-equiv") == "Content-Security-Policy")
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))

    def hashes(texts: list[str]) -> str:
        digests = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts)
        return " ".join(f"'sha256-{digest}'" for digest in digests)

    none = dict.fromkeys(("default-src", "base-uri", "form-action"), "'none'")
    own = {"script-src": hashes(page.scripts), "style-src": hashes(page.styles), "img-src": "data:"}
    assert rules == {**none, **own}


@pytest.mark.skipif(NODE is None, reason="Node.js, which reads scripts without a browser, is not installed")
def test_every_script_is_one_that_a_browser_can_read():
    assert NODE is not None
    program = "for (const name of process.argv.slice(1)) new vm.Script(fs.readFileSync(name, 'utf8'), {filename: name})"
    printed_by(NODE, "-e", program, *sorted(PAGES.rglob("*.js")))


def test_what_a_model_or_a_user_writes_never_becomes_markup(tmp_path):
    """In an episode, in the name of its file, and in a thread of a context manager."""
    name = "a\"><img src=x onerror='x'>&b"
    manager = sp.ContextManager(None, record=tmp_path / "threads")
    manager.fit([{"role": "user", "content": HOSTILE}], system=HOSTILE, thread="hostile")
    thread = page_of(tmp_path / "threads", title=HOSTILE)
    page = page_of(hostile(tmp_path / f"{name}.jsonl"), title=HOSTILE)
    for one in (thread, page):
        assert [tag for tag, _ in one.elements if tag == "img"] == []
        assert len(one.scripts) == len([tag for tag, _ in one.elements if tag == "script"]) - len(one.packed)
        assert not any("document.title='taken'" in script for script in one.scripts)
    assert page.words.count(HOSTILE) >= 3  # the title and the player, as words
    turns = page.episode(name)["turns"]
    assert turns[0]["message"]["content"] == turns[0]["message"]["reasoning_content"] == HOSTILE
    assert turns[1]["message"]["tool_calls"][0]["function"]["name"] == HOSTILE
    assert "\ud800" in turns[2]["message"]["content"]


def test_the_same_run_gives_the_same_bytes(tmp_path):
    record(tmp_path / "run" / "hanoi.jsonl", HANOI)
    first, second = (write_report(tmp_path / "run", tmp_path / f"{name}.html").read_bytes() for name in "ab")
    assert first == second


def test_prompts_are_not_stored_but_what_they_showed_is(tmp_path):
    path = record(tmp_path / "rps.jsonl", RPS, prompt_tokens=900)
    page = page_of(path)
    turns = page.episode("rps")["turns"]
    views = [event for event in sp.read_transcript(path) if event["event"] == "view"]
    for view in views:
        assert turns[view["turn"]]["view"]["turns"] == view["turns"]
        assert turns[view["turn"]]["view"]["masked"] == view["masked"]
    assert json.dumps(turns).count("New round begins.") <= len(views) + 1


# Runs.


def test_failed_unfinished_and_lost_attempts_are_shown_as_such(tmp_path):
    players = {"broken": Broken, "first": FirstMoves}
    run = sp.evaluate([BANDIT], players, out=tmp_path / "run", trials=1, executor="inline")
    first = run.rows[0]["key"]
    [broken] = {row["key"] for row in run.failures}
    finished = (tmp_path / "run" / "episodes" / f"{first}.jsonl").read_text()
    torn = "".join(finished.splitlines(keepends=True)[:20]) + '{"event": "mess'
    (tmp_path / "run" / "running" / f"{broken}.9.jsonl").write_text(torn)
    lost = '{"event": "exception", "error": "NoWayError: <b>no way</b>", "traceback": null}\n'
    (tmp_path / "run" / "attempts" / f"{broken}.8.jsonl").write_text(lost)

    page = page_of(tmp_path / "run")
    status = {episode["key"]: episode["status"] for episode in page.unpack("index")["episodes"]}
    assert status[first] == "finished"
    assert status[f"{broken}.1"] == "failed"
    assert status[f"{broken}.9"] == "unfinished"
    assert f"{broken}.8" not in status
    assert "NoWayError: <b>no way</b>" in page.words
    failed = page.episode(f"{broken}.1")
    assert failed["error"] == "RuntimeError: no more ideas"
    assert "no more ideas" in failed["traceback"]
    assert failed["turns"][0]["view"]
    assert "message" not in failed["turns"][0]


def test_an_episode_that_ends_while_its_page_is_made_is_on_the_page(tmp_path):
    run = sp.evaluate([HANOI], ["rule"], out=tmp_path / "run", trials=1, executor="inline")
    key = run.rows[0]["key"]
    place, before = run.folder.transcript(key), tmp_path / "run" / "running" / f"{key}.1.jsonl"
    place.rename(before)
    without_figures(tmp_path / "run")
    found = find_runs([tmp_path / "run"])
    before.rename(place)
    assert f"{key}.1" in render_runs(found, None, plugins=False, opened="run")


def test_many_episodes_are_in_packs_and_their_turns_in_columns(tmp_path, monkeypatch):
    monkeypatch.setattr("smartplay_tools.evaluation.pages.report.episode_reading.PACK", 30_000)
    for name in "abcd":
        record(tmp_path / "run" / f"{name}.jsonl", BANDIT)
    (tmp_path / "run" / "notes.jsonl").write_text('{"event": "other"}\n')  # which is no transcript
    page = page_of(tmp_path / "run")
    assert [episode["key"] for episode in page.unpack("index")["episodes"]] == [*"abcd"]
    assert list(page.packed) == ["index", "pack-0", "pack-1"]
    assert page.episode("d")["turns"][3]["items"][0]["call"]["step"] == 4
    for rows in ([], [{}], [{"a": None}, {}, {"a": 1}], [{"a": {"b": 1}}, {"a": {}}], [{"a": [{}]}, 2], [[1], {}]):
        assert rows_of(columns(rows)) == rows


def test_attempts_that_were_played_again_leave_nothing_unfinished(tmp_path):
    """As after Ctrl-C, a worker that died, and the same command again: the run is complete, and so its page says."""
    run = sp.evaluate([BANDIT], ["rule"], out=tmp_path / "run", trials=2, executor="inline")
    key = run.rows[0]["key"]
    finished = (tmp_path / "run" / "episodes" / f"{key}.jsonl").read_text()
    stopped = "".join(finished.splitlines(keepends=True)[:20])
    (tmp_path / "run" / "attempts" / f"{key}.1.jsonl").write_text(stopped)
    died = stopped + '{"event": "exception", "error": "E", "traceback": ""}\n'
    (tmp_path / "run" / "attempts" / f"{key}.2.jsonl").write_text(died)
    page = page_of(tmp_path / "run")
    assert "2 episodes, 1 failed attempt, 1 interrupted attempt (finished later)." in page.words
    assert "unfinished" not in page.words.partition("Episodes")[0]
    status = {episode["key"]: episode["status"] for episode in page.unpack("index")["episodes"]}
    finished = {row["key"]: "finished" for row in run.rows}
    assert status == finished | {f"{key}.1": "interrupted", f"{key}.2": "failed"}
    assert (page.episode(key)["cost"], page.episode(f"{key}.2")["cost"]) == (0, None), "not what the finished one did"


def test_a_page_says_caps_differences_and_deviations(tmp_path):
    vary, budget = {"history": [1, 5]}, sp.Budget(tool_calls=30)
    sp.sweep([BANDIT], ["rule"], vary=vary, trials=2, out=tmp_path / "run", executor="inline", budget=budget)
    page = page_of(tmp_path / "run")
    for words in (
        "calls ≤ 30",
        "What a smaller window costs",
        "reference",
        "Different from the paper",
        "one action a prompt",
    ):
        assert words in page.words, words


def test_a_host_s_episode_has_calls_and_no_prompts(tmp_path):
    with sp.Episode(HANOI, seed=7, context="host", transcript=tmp_path / "host.jsonl") as episode:
        episode.call("act", {"action": "1"})
        episode.call("act", {"action": "fly"})
    data = page_of(tmp_path / "host.jsonl").episode("host")
    assert [("view" in turn, "message" in turn) for turn in data["turns"]] == [(False, False)] * 2
    assert data["turns"][1]["items"][0]["call"]["is_error"]
    assert len(data["drawing"]["changes"]) == 2


# What is checked when a page is made.


def test_every_prompt_is_rebuilt_and_compared_with_its_sha256(tmp_path):
    path = record(tmp_path / "bandit.jsonl", BANDIT, prompt_tokens=700)
    events = sp.read_transcript(path)
    assert check(Record(events)) == {"prompts": len(Record(events).views), "differ": []}
    call = next(event for event in events if event["event"] == "call")
    call["text"] = call["text"].replace("1", "7")
    assert check(Record(events))["differ"][0] == 1


def test_a_drawing_is_left_out_where_the_game_goes_another_way(tmp_path):
    events = sp.read_transcript(record(tmp_path / "bandit.jsonl", BANDIT))
    events[0]["config"]["seed"] = 8
    drawing = draw(Record(events))
    assert drawing["kind"] is None
    assert "played differently" in drawing["source"]


@pytest.mark.parametrize(
    ("game", "kind"),
    [pytest.param("Crafter-v0", "crafter", marks=pytest.mark.slow), ("MinedojoCreative0-v0", None)],
)
def test_a_page_has_the_pictures_that_the_model_saw(tmp_path, game, kind):
    path = record(tmp_path / "seen.jsonl", game, "random", observation="picture", tool_calls=4)
    data = page_of(path).episode("seen")
    expected = {sha256: picture.base64 for sha256, picture in recorded_pictures(path).items()}
    assert data["pictures"] == {"files": expected, "missing": None}
    assert data["drawing"]["kind"] == kind
    assert page_of(record(tmp_path / "words.jsonl", HANOI)).episode("words")["pictures"] is None


@pytest.mark.slow
def test_pictures_are_left_out_where_the_game_makes_others(tmp_path):
    events = sp.read_transcript(record(tmp_path / "s.jsonl", "Crafter-v0", "random", observation="both", tool_calls=3))
    [*_, last] = [event for event in events if event["event"] == "call"]
    last["data"]["picture"]["sha256"] = "0" * 64
    made = pictures(Record(events))
    assert made["files"] == {}
    assert "It made other pictures" in made["missing"]


def test_a_game_that_is_not_registered_here_is_shown_without_a_drawing(tmp_path):
    path = record(tmp_path / "hanoi.jsonl", HANOI)
    path.write_text(path.read_text().replace(HANOI, "Hanoi9Disk-v0"))
    data = page_of(path).episode("hanoi")
    assert data["drawing"]["kind"] is None
    assert "Hanoi9Disk-v0" in data["drawing"]["source"]
    assert len(data["turns"]) == 8


class Written(Hanoi):
    """A game that is not part of the benchmark, and draws itself in characters."""

    def drawing(self) -> dict[str, Any]:
        return {"text": "|-|\n" * self.score + "<o>"}


def test_a_game_of_somebody_else_s_is_drawn_in_characters(tmp_path, monkeypatch):
    known_for_now(monkeypatch, replace(get_spec(HANOI), id="Written-v0", entry_point=f"{__name__}:Written"))
    drawing = page_of(record(tmp_path / "written.jsonl", "Written-v0")).episode("written")["drawing"]
    assert drawing["kind"] == "text"
    assert drawing["changes"][-1]["text"] == "|-|\n|-|\n|-|\n<o>"


class Undrawn(Hanoi):
    """A game with nothing to draw."""

    def drawing(self) -> dict[str, Any]:
        return {}


@pytest.mark.parametrize("game", ["MinedojoCreative0-v0", "Undrawn-v0"])
def test_a_game_without_a_drawing_is_shown_as_the_player_read_it(tmp_path, monkeypatch, game):
    known_for_now(monkeypatch, replace(get_spec(HANOI), id="Undrawn-v0", entry_point=f"{__name__}:Undrawn"))
    drawing = page_of(record(tmp_path / "undrawn.jsonl", game, "random", tool_calls=3)).episode("undrawn")["drawing"]
    assert drawing["kind"] is None
    assert drawing["source"].startswith("This game is not drawn")


# The command.


def test_the_command_writes_the_page_and_says_where(tmp_path):
    record(tmp_path / "hanoi.jsonl", HANOI)
    shown = shown_by("report", tmp_path / "hanoi.jsonl", "--out", tmp_path / "new" / "p.html")
    assert re.search(r"p\.html \(0\.\d MB\)", shown.replace("\n", ""))
    assert (tmp_path / "new" / "p.html").exists()


@pytest.mark.parametrize(
    ("name", "out", "remedy"),
    [
        ("nowhere", "p.html", "name a run folder or a transcript"),
        ("empty", "p.html", "contains neither a run nor transcripts"),
        ("hanoi.jsonl", "p.pdf", r"has to end in \.html"),
        ("torn.jsonl", "p.html", "is not a transcript"),
        ("foreign.jsonl", "p.html", "has format None"),
    ],
)
def test_what_cannot_be_shown_is_said_in_a_sentence(tmp_path, name, out, remedy):
    record(tmp_path / "hanoi.jsonl", HANOI)
    (tmp_path / "empty").mkdir()
    (tmp_path / "torn.jsonl").write_text("{}\n")
    (tmp_path / "foreign.jsonl").write_text('{"event": "start", "game": "Chess-v0"}\n')
    with pytest.raises(sp.SmartPlayError, match=remedy):
        write_report(tmp_path / name, tmp_path / out)
