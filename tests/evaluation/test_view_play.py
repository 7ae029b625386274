"""A person plays in the browser: what the page gets and sends, whom the server takes an answer from, and the record."""

from __future__ import annotations

import json
import re
import time
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.audit import audit
from smartplay_tools.records import replay
from smartplay_tools.web.site import BrowserGames
from smartplay_tools.web.site.browser_play import BrowserPlay, human_cell
from tests.evaluation.command import refused
from tests.loopback import ask

pytest.importorskip("uvicorn")
view = pytest.importorskip("smartplay_tools.web.site")

BANDIT, HANOI, RPS = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0", "RockPaperScissorBasic-v0"


class Page:
    """What the script of the page does: it reads the key, asks what is to be shown, and sends answers."""

    def __init__(self, url: str, game: str) -> None:
        self.origin = url.rstrip("/")
        self.number = 0
        self.key = re.search(r'data-key="([^"]+)"', self.request("GET", f"/play/{game}")[1])[1]  # type: ignore[index]
        self.api = f"/api/play/{game}"

    def request(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, str]:
        data = body if isinstance(body, bytes) else None if body is None else json.dumps(body).encode()
        status, _, text = ask(self.origin + path, data, method=method, headers=headers)
        return status, text

    def post(self, path: str, body: Any, **headers: str) -> tuple[int, str]:
        return self.request("POST", path, body, **{"X-SmartPlay-Key": self.key, "Origin": self.origin, **headers})

    def state(self) -> dict[str, Any]:
        state: dict[str, Any] = json.loads(self.request("GET", f"{self.api}?after={self.number}")[1])
        self.number = state["number"]
        return state

    def answer(self, **given: Any) -> dict[str, Any]:
        status, text = self.post(f"{self.api}/reply", {"number": self.number, **given})
        assert status == 200, text
        return self.state()


@pytest.fixture
def playing(tmp_path):
    """Start a play, of a game that the test names, and return it with its page."""
    started = []

    def start(game: str = HANOI, **options: Any) -> tuple[Any, Page]:
        games = BrowserGames([game], tmp_path / "human", **options)
        server = view.ViewServer(view.RunList(own=[games.folder]), play=games)
        started.extend([games.__enter__(), server.__enter__()])
        return games.run_of(game), Page(server.url, game)

    yield start
    for one in reversed(started):
        one.__exit__(None, None, None)


def test_the_page_shows_the_prompt_of_a_model_and_the_record_is_that_of_a_player(playing):
    budget = sp.Budget(prompt_tokens=900, tool_calls=3)
    play, page = playing(BANDIT, budget=budget)
    first = page.state()["asked"]
    episode = play.folder.manifest().planned[0]
    with sp.Episode(BANDIT, seed=episode.seed, budget=budget) as same:
        prompt = sp.Conversation(same).prompt()
    assert first["messages"] == prompt.messages
    assert (first["steps"], first["rollout"]) == (0, 50)
    assert [tool["name"] for tool in first["tools"]] == [tool.name for tool in prompt.tools]
    assert first["budget_bars"][0]["share"] == pytest.approx(sum_of_prompt(first) / 900)
    page.answer(tool="read_manual")
    page.answer(tool="act", action="1", say="left first")
    over = page.answer(tool="act", action=2)
    assert (over["state"], over["over"]["end_reason"]) == ("over", "tool_calls")
    (row,) = RunFolder(play.folder.path).rows()
    assert (row["player"], row["steps"], row["seed"]) == ("human", 2, episode.seed)
    assert replay(play.folder.transcript(row["key"])).identical
    assert over["over"]["replay"] == f"/episode/{play.folder.path.name}/episodes/{row['key']}"
    (run,) = json.loads(page.request("GET", "/api/runs")[1])
    assert (run["finished"], run["planned"]) == (1, 1)
    beside = json.loads(page.request("GET", f"{page.api}/beside")[1])
    assert {"rule", "random, mean of 20", "GPT-4-0613"} <= beside["scores"].keys()
    with sp.Episode(BANDIT, seed=row["seed"], budget=budget) as same:
        rule = sp.play(same, sp.get_player("rule", seed=row["seed"]))
    assert beside["scores"]["rule"] == rule.normalized_score
    assert (beside["gone"], beside["turns"], beside["first"]) == (0, 2, None)


def sum_of_prompt(asked: dict[str, Any]) -> int:
    used = re.match(r"prompt ([\d,]+)/", asked["budget_bars"][0]["short"])
    assert used is not None
    return int(used[1].replace(",", ""))


def test_another_episode_is_another_trial_of_the_run(playing):
    play, page = playing(budget=sp.Budget(tool_calls=1))
    page.state()
    assert page.answer(tool="observe")["state"] == "over"
    assert page.post(f"{page.api}/next", {})[0] == 200
    assert page.state()["state"] == "asking"
    page.answer(tool="observe")
    rows = play.folder.rows()
    assert [row["trial"] for row in rows] == [0, 1]
    assert all(not finding.differences for finding in audit(play.folder, 1))


def test_an_episode_that_was_left_goes_on(playing, tmp_path):
    with BrowserPlay(human_cell(HANOI), tmp_path / "human") as first:
        wait_for(lambda: first.player.asked)
        first.player.answer({"number": first.player.number, "tool": "read_manual"})
        wait_for(lambda: first.player.asked)
    _, page = playing()
    asked = page.state()["asked"]
    assert [call["function"]["name"] for call in asked["messages"][2]["tool_calls"]] == ["read_manual"]


def wait_for(what) -> None:
    until = time.monotonic() + 30
    while not what():
        assert time.monotonic() < until
        time.sleep(0.005)


def test_what_is_no_answer_is_refused_and_not_played(playing):
    play, page = playing(budget=sp.Budget(notes_tokens=50, recall_tokens=50))
    page.state()
    number = page.number
    for body, sentence in [
        ({}, "answered already"),
        ({"number": number - 1, "tool": "observe"}, "answered already"),
        ({"number": number, "tool": "jump"}, "one of its tools"),
        ({"number": number, "tool": "act"}, "lacks action"),
        ({"number": number, "tool": "act", "action": "99"}, "not an action of this game"),
        ({"number": number, "tool": "act", "action": 99}, "not an action of this game"),
        ({"number": number, "tool": "act", "action": True}, "lacks action"),
        ({"number": number, "tool": "act", "action": 1.0}, "lacks action"),
        ({"number": number, "tool": "act", "action": "1", "say": 5}, "lacks say"),
        ({"number": number, "tool": "take_notes"}, "lacks text"),
        ({"number": number, "tool": "recall", "arguments": "1"}, "lacks arguments, an object, for recall"),
        ([], "a JSON object"),
        (b"{", "a JSON object"),
        (b"[" * 50_000, "a JSON object"),
    ]:
        status, text = page.post(f"{page.api}/reply", body)
        assert (status in (400, 409), sentence in text) == (True, True), (body, text)
    assert page.post(f"{page.api}/picture", {"number": number}) == (
        400,
        f'{HANOI} draws itself only with render_mode="rgb_array".',
    )
    assert page.answer(tool="take_notes", text="b is next")["state"] == "asking"
    assert page.post(f"{page.api}/reply", {"number": number, "tool": "observe"})[0] == 409
    record = play.folder.running()[0]
    assert [event["name"] for event in sp.read_transcript(record) if event["event"] == "call"] == ["take_notes"]


def test_only_the_page_of_the_play_may_answer(playing):
    _, page = playing()
    page.state()
    body = {"number": page.number, "tool": "observe"}
    other_port = f"http://127.0.0.1:{int(page.origin.rpartition(':')[2]) + 1}"
    for headers, status in [
        ({"X-SmartPlay-Key": ""}, 403),
        ({"X-SmartPlay-Key": "wrong"}, 403),
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": other_port}, 403),
        ({"Origin": "null"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Host": "evil.example"}, 421),
    ]:
        for path in (f"{page.api}/reply", f"{page.api}/picture", f"{page.api}/next"):
            assert page.post(path, body, **headers)[0] == status, (path, headers)
    assert page.request("GET", f"{page.api}/reply")[0] == 405
    assert page.post(f"{page.api}/reply", body, **{"Sec-Fetch-Site": "same-origin"})[0] == 200


def test_free_text_is_asked_for_as_such(playing):
    play, page = playing(BANDIT, protocol="paper", budget=sp.Budget(tool_calls=1))
    assert page.state()["asked"]["asks"] == "words"
    asked = page.answer(text="I do not know yet.")["asked"]
    assert (asked["asks"], asked["tools"]) == ("action", [])
    page.answer(action=asked["actions"][0])
    texts = [
        e["message"]["content"] for e in sp.read_transcript(next(play.folder.records())) if e["event"] == "message"
    ]
    assert texts == ["I do not know yet.", asked["actions"][0]]


@pytest.mark.slow
def test_pictures_are_on_the_record(playing):
    play, page = playing("Crafter-v0", pictures=True, budget=sp.Budget(tool_calls=2))
    assert page.state()["asked"]["pictures"]
    for action in ("Noop", "Sleep"):
        status, text = page.post(f"{page.api}/picture", {"number": page.number})
        assert (status, json.loads(text)["image"][:22]) == (200, "data:image/png;base64,")
        over = page.answer(tool="act", action=action)["over"]
    assert over["pictures"]
    (row,) = play.folder.rows()
    assert row["deviations"]["pictures"] == {"paper": "none", "played": "shown when asked for"}
    record = play.folder.transcript(row["key"])
    shown = [(event["turn"], event["step"]) for event in sp.read_transcript(record) if event["event"] == "picture"]
    assert shown == [(0, 0), (1, 1)]
    assert replay(record).identical


def test_options_of_a_play_need_one(tmp_path):
    assert "--prompt-tokens is for --play GAME" in refused("view", tmp_path, "--prompt-tokens", 500)
    assert "There is no game 'Chess-v0'" in refused("view", "--play", "Chess-v0", "--out", tmp_path / "human")


def test_a_game_is_chosen_and_each_has_a_run_of_its_own(tmp_path):
    games = BrowserGames([HANOI, BANDIT], tmp_path / "human", budget=sp.Budget(tool_calls=1))
    with games, view.ViewServer(view.RunList(own=[games.folder]), play=games) as server:
        page = Page(server.url, HANOI)
        chooser = page.request("GET", "/play")[1]
        links = re.findall(r'href="/play/([^"]+)"', chooser)
        assert links == [BANDIT, BANDIT, HANOI, HANOI], "a picture and a name of each"
        assert chooser.count("<svg") == 2
        for game in (HANOI, BANDIT):
            page = Page(server.url, game)
            page.state()
            over = page.answer(tool="observe")["over"]
            assert page.request("GET", over["replay"])[0] == 200
            assert [row["game"] for row in RunFolder(tmp_path / "human" / game).rows()] == [game]
        assert page.request("GET", "/play/Chess-v0")[0] == 404
    with pytest.raises(sp.InvalidArgumentError, match="the run of one game"):
        BrowserGames([BANDIT, RPS], tmp_path / "human" / HANOI)
