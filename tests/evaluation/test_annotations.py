"""Notes about turns: beside the record, written by a page of the site alone, shown in list, page, report and export."""

from __future__ import annotations

import html
import json

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.exports.atif import trajectory
from smartplay_tools.evaluation.run_folder.folder import LONGEST, notes_file, read_notes, write_note
from smartplay_tools.records import Record
from tests.evaluation.test_view import get, unpacked
from tests.loopback import ask

pytest.importorskip("uvicorn")
view = pytest.importorskip("smartplay_tools.web.site")
site_runs = pytest.importorskip("smartplay_tools.web.site.site_runs")

HANOI = "Hanoi3Disk-v0"


@pytest.fixture
def run(tmp_path):
    return sp.evaluate([HANOI], ["rule"], out=tmp_path / "run", trials=2, executor="inline")


def post(url: str, body: object, **headers: str) -> tuple[int, str]:
    headers["Content-Type"] = "application/json"
    status, _, text = ask(url, json.dumps(body), method="POST", headers=headers)
    return status, text


def test_notes_lie_beside_the_record_which_stays_as_it_is(run):
    record = run.transcript(run.rows[0]["key"])
    before = record.read_bytes()
    assert write_note(record, 3, " It forgets the rod. ") == {3: "It forgets the rod."}
    assert write_note(record, 1, "first") == {1: "first", 3: "It forgets the rod."}
    assert read_notes(record) == {1: "first", 3: "It forgets the rod."}
    assert record.read_bytes() == before
    assert sp.replay(record).identical
    assert trajectory(Record.read(record))["extra"]["smartplay"]["notes"][0] == {"turn": 1, "note": "first"}
    write_note(record, 1, "")
    write_note(record, 3, "  ")
    assert not notes_file(record).exists()
    assert "notes" not in trajectory(Record.read(record))["extra"]["smartplay"]


def test_what_is_no_note_is_refused(run):
    record = run.transcript(run.rows[0]["key"])
    for turn, note in ((-1, "x"), (0, "x" * (LONGEST + 1))):
        with pytest.raises(sp.InvalidArgumentError, match="A note is about a turn"):
            write_note(record, turn, note)
    notes_file(record).write_text("{}[")
    with pytest.raises(sp.InvalidArgumentError, match="is damaged"):
        read_notes(record)


def test_a_page_of_the_site_writes_notes_and_nobody_else(run):
    key = run.rows[0]["key"]
    with view.ViewServer(view.RunList([run.folder.path]), annotate=True) as server:
        page = get(f"{server.url}episode/run/episodes/{key}")[2]
        facts = json.loads(html.unescape(page.partition('data-site="')[2].partition('"')[0]))
        address = server.url.rstrip("/") + facts["notes"]
        note = {"turn": 2, "note": "<b>here</b>"}
        assert post(address, note)[0] == 403
        own = {"X-SmartPlay-Key": facts["key"], "Origin": server.url.rstrip("/")}
        assert post(address, note, **{**own, "Origin": "https://evil.example"})[0] == 403
        status, text = post(address, note, **own)
        assert (status, json.loads(text)) == (200, [note])
        assert post(address, {"turn": "2", "note": "x"}, **own)[0] == 400
        assert post(address.replace(key, "0" * 16), note, **own)[0] == 400
        listed = json.loads(get(f"{server.url}api/runs/run/episodes")[2])
        at = listed["columns"].index("notes")
        assert [row[at] for row in listed["episodes"]] == [1, None]
        data = json.loads(get(f"{server.url}api/episode/run/episodes/{key}")[2])["data"]
        assert [episode["notes"] for episode in unpacked(data).values()] == [[note]]
    assert read_notes(run.transcript(key)) == {2: "<b>here</b>"}


def test_a_site_that_was_not_started_for_it_takes_no_notes(run):
    key = run.rows[0]["key"]
    with view.ViewServer(view.RunList([run.folder.path])) as server:
        assert post(f"{server.url}api/notes/run/episodes/{key}", {"turn": 0, "note": "x"})[0] in (404, 405)
        assert '"notes":' not in html.unescape(get(f"{server.url}episode/run/episodes/{key}")[2].partition("<main>")[0])
    assert read_notes(run.transcript(key)) == {}
