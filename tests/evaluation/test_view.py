"""The site over run folders: what it answers, whom it answers, and that thousands of episodes are quick."""

from __future__ import annotations

import base64
import gzip
import html
import json
import os
import shutil
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from tests.evaluation.command import refused
from tests.evaluation.runs import under_way
from tests.loopback import ask

pytest.importorskip("uvicorn")
view = pytest.importorskip("smartplay_tools.web.site")
COLUMNS = pytest.importorskip("smartplay_tools.web.site.listed").COLUMNS
site_runs = pytest.importorskip("smartplay_tools.web.site.site_runs")

HANOI, BANDIT = "Hanoi3Disk-v0", "BanditTwoArmedHighLowFixed-v0"


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    sp.evaluate([HANOI, BANDIT], ["rule"], out=folder / "one", trials=2, executor="inline")
    sp.evaluate([HANOI], ["random"], out=folder / "deep" / "two", trials=1, executor="inline")
    return folder


@pytest.fixture(scope="module")
def site(runs):
    with view.ViewServer(view.RunList([runs])) as server:
        yield server.url.rstrip("/")


def get(url: str, **headers: str) -> tuple[int, Any, str]:
    return ask(url, headers=headers)


def test_runs_and_episodes(site):
    runs = json.loads(get(f"{site}/api/runs")[2])
    shown = [(run["name"], run["finished"], run["planned"]) for run in runs]
    assert shown == [("deep/two", 1, 1), ("one", 4, 4)], "the newest first"
    listed = json.loads(get(f"{site}/api/runs/one/episodes")[2])
    first = dict(zip(listed["columns"], listed["episodes"][0], strict=True))
    assert (first["game"], first["status"], first["score"], first["mistakes"]) == (HANOI, "finished", 3.0, 0)
    times = [dict(zip(listed["columns"], episode, strict=True))["time"] for episode in listed["episodes"]]
    assert runs[1]["seconds"] == pytest.approx(sum(times))
    status, headers, page = get(f"{site}/episode/one/{first['record']}")
    assert (status, headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert "Content-Security-Policy" in page


def test_every_page_allows_its_own_scripts_only(site):
    for path in ("/", "/static/view.js"):
        status, headers, text = get(site + path)
        assert status == 200
        assert headers["content-security-policy"].startswith("default-src 'none'; script-src 'self';")
        assert headers["x-content-type-options"] == "nosniff"
        assert "onclick=" not in text


def test_what_is_not_there(site):
    for path in (
        "/api/runs/nowhere/episodes",
        "/episode/one/episodes/..%2f..%2fmanifest",
        "/episode/one/../../etc/passwd",
        "/episode/..%2fone/episodes/0123456789abcdef",
        "/episode/one/episodes/0123456789abcdef",
        "/api/episode/one/running/0123456789abcdef.1",
        "/static/app.py",
        "/static/..%2fapp.py",
    ):
        assert get(site + path)[0] == 404, path
    request = urllib.request.Request(f"{site}/api/runs", method="POST")
    with pytest.raises(urllib.error.HTTPError, match="405") as refused:
        urllib.request.urlopen(request)
    refused.value.close()


def test_a_damaged_run_does_not_hide_the_others(runs, tmp_path):
    for name in ("a", "b", "c"):
        shutil.copytree(runs / "one", tmp_path / name)
    (tmp_path / "a" / "running" / f"{'0' * 16}.1.jsonl").write_text('{"event": "start"\n')
    (tmp_path / "b" / "manifest.json").write_text('{"format": 1}')
    with view.ViewServer(view.RunList([tmp_path])) as server:
        with urllib.request.urlopen(f"{server.url}api/live", timeout=60) as stream:
            shown = {run["name"]: run for run in json.loads(stream.readline().removeprefix(b"data: "))}
        status, _, text = get(f"{server.url}api/runs/b/episodes")
    assert "is not a transcript" in shown["a"]["error"]
    assert "is damaged" in shown["b"]["error"]
    assert (status, "is damaged" in text) == (404, True)
    assert shown["c"]["finished"] == 4


def test_a_token_in_the_address_becomes_a_cookie(runs):
    shown = view.RunList([runs])
    with view.ViewServer(shown, token="secret") as server:
        site = server.url.rstrip("/")
        assert get(f"{site}/?token=wrong")[0] == 401
        status, headers, _ = get(server.entry)
        assert (status, headers["location"]) == (303, "/")
        cookie = headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert get(site + "/", Cookie=cookie.partition(";")[0])[0] == 200


def test_what_goes_on_is_streamed(runs, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(runs / "one", folder)
    with view.ViewServer(view.RunList([folder])) as server:
        with urllib.request.urlopen(f"{server.url}api/live", timeout=60) as stream:
            assert stream.headers["content-type"].startswith("text/event-stream")
            first = json.loads(stream.readline().removeprefix(b"data: "))
            assert (first[0]["finished"], first[0]["playing"]) == (4, [])
            key = RunFolder(folder).manifest().episodes[0].key
            under_way(folder, key, 12)
            lines = (line for line in stream if line.startswith(b"data: "))
            now = next(event for line in lines if (event := json.loads(line[6:]))[0]["playing"])
        (one,) = now[0]["playing"]
        assert (one["game"], one["record"], now[0]["running"]) == (HANOI, f"running/{key}.1", 1)
        assert one["calls"] > 0
        status, _, page = get(f"{server.url}episode/run/running/{key}.1")
        assert (status, list(unpacked(page, "pack-0"))) == (200, [f"{key}.1"])


def large(folder: Path, one: Path, count: int) -> Path:
    """Make a run of `count` episodes from the rows of a small one."""
    manifest = json.loads((one / "manifest.json").read_text())
    row = json.loads((one / "results.jsonl").read_text().splitlines()[0])
    keys = [f"{number:016x}" for number in range(count)]
    manifest["episodes"] = [{"key": key, "cell": 0, "trial": at, "seed": at} for at, key in enumerate(keys)]
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps(manifest))
    rows = (json.dumps({**row, "key": key, "trial": at}) + "\n" for at, key in enumerate(keys))
    (folder / "results.jsonl").write_text("".join(rows))
    return folder


def test_thousands_of_episodes_are_listed_again_without_reading(runs, tmp_path):
    run = site_runs.SiteRun(large(tmp_path / "large", runs / "one", 2_000), "large")
    assert len(run.episodes()) == 2_000
    listed = run.episodes()
    assert run.episodes() is listed, "nothing is read again"
    assert len(json.dumps(listed)) < 400_000


def test_the_command_says_what_is_wrong(tmp_path):
    assert "There is no folder" in refused("view", tmp_path / "nowhere")


def test_runs_appear_and_vanish_while_the_site_is_served(runs, tmp_path):
    listed = view.RunList([tmp_path])
    assert listed.current() == []
    shutil.copytree(runs / "one", tmp_path / "a" / "one")
    listed._looked = float("-inf")  # as after a second
    (run,) = listed.current()
    assert run.name == "a/one"
    shutil.copytree(runs / "deep" / "two", tmp_path / "two")
    os.utime(tmp_path / "two" / "manifest.json", (2e9, 2e9))
    listed._looked = float("-inf")
    assert [each.name for each in listed.current()] == ["two", "a/one"]
    assert listed.named("a/one") is run, "what was read of it is kept"
    shutil.rmtree(tmp_path / "two")
    listed._looked = float("-inf")
    assert [each.name for each in listed.current()] == ["a/one"]


def test_two_folders_with_runs_of_the_same_name_have_two_names(runs, tmp_path):
    for name in ("a", "b"):
        shutil.copytree(runs / "one", tmp_path / name / "one")
    names = {run.name for run in view.RunList([tmp_path / "a", tmp_path / "b"]).current()}
    assert len(names) == 2
    assert "one" in names


def test_an_episode_s_page_knows_its_list_and_its_neighbours(site):
    records = [row[0] for row in json.loads(get(f"{site}/api/runs/one/episodes")[2])["episodes"]]
    page = get(f"{site}/episode/one/{records[1]}")[2]
    facts = json.loads(html.unescape(page.partition('data-site="')[2].partition('"')[0]))
    assert facts["home"] == "/#run=one"
    assert (facts["previous"], facts["next"]) == (f"/episode/one/{records[0]}", f"/episode/one/{records[2]}")
    assert "updates" not in facts, "it is over"
    assert "connect-src" in page


def test_new_turns_are_answered_when_the_record_has_grown(runs, tmp_path):
    shutil.copytree(runs / "one", folder := tmp_path / "run")
    key = RunFolder(folder).manifest().episodes[0].key
    whole, record = under_way(folder, key, 12)
    with view.ViewServer(view.RunList([folder])) as server:
        address = f"{server.url}api/episode/run/running/{key}.1"
        first = json.loads(get(address)[2])
        assert (first["playing"], "being played" in first["figures"]) == (True, True)
        record.write_text("".join(whole[:30]))
        second = json.loads(get(f"{address}?after={first['version']}")[2])
        assert second["version"] != first["version"]
        (now,), (before,) = (unpacked(news["data"]).values() for news in (second, first))
        assert now["turns"]["rows"] > before["turns"]["rows"]
        record.rename(folder / "episodes" / f"{key}.jsonl")
        (folder / "episodes" / f"{key}.jsonl").write_text("".join(whole))
        last = json.loads(get(f"{address}?after={second['version']}")[2])
        (end,) = unpacked(last["data"]).values()
        assert (last["playing"], end["status"]) == (False, "finished")


def unpacked(packed: str, name: str | None = None) -> dict[str, Any]:
    """What is packed, or the part of this name in a page."""
    data = packed if name is None else packed.partition(f'id="{name}">')[2].partition("</script>")[0]
    content: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(data)))
    return content
