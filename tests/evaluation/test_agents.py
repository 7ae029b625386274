"""Agents in a run: functions that play an episode through any adapter, with everything that a run gives to players."""

from __future__ import annotations

import asyncio
import json
import re
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.runner import Run
from tests.evaluation.command import shown_by

HANOI = "Hanoi3Disk-v0"
BUDGET = sp.Budget(prompt_tokens=700)


def through_a_session(session: sp.AgentSession) -> None:
    player = sp.get_player("rule")
    while (reply := session.ask(player.reply)) is not None:
        for call in session.receive(reply):
            session.answer(call.id)


async def on_the_loop(episode: sp.Episode) -> None:
    await sp.aplay(episode, sp.get_player("rule"))


def evaluate(out: Path, *, trials: int = 2, **agents: Any) -> Run:
    return sp.evaluate([HANOI], agents, out=out, trials=trials, budgets=BUDGET)


def test_an_agent_plays_the_episodes_of_a_player(tmp_path: Path) -> None:
    run = evaluate(tmp_path / "agents", session=through_a_session, loop=on_the_loop)
    players = sp.evaluate([HANOI], ["rule"], out=tmp_path / "rule", trials=2, budgets=BUDGET, executor="inline")
    facts = ("trial", "seed", "score", "steps", "tokens")
    expected = [[row[fact] for fact in facts] for row in players.rows]
    for name in ("session", "loop"):
        assert [[row[fact] for fact in facts] for row in run.rows if row["player"] == name] == expected
    assert all(sp.replay(run.transcript(row["key"])).identical for row in run.rows)
    assert evaluate(tmp_path / "agents", session=through_a_session, loop=on_the_loop).rows == run.rows


def test_an_agent_that_stops_has_ended_its_episode(tmp_path: Path) -> None:
    def looks_once(episode: sp.Episode) -> None:
        episode.call("observe")

    run = evaluate(tmp_path, mine=looks_once)
    assert [(row["end_reason"], row["detail"]) for row in run.rows] == [("host", "The agent has ended.")] * 2


def test_an_agent_that_always_fails_is_tried_three_times_and_its_error_is_said_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def raises(episode: sp.Episode) -> None:
        json.loads("no key")

    def does_nothing(episode: sp.Episode) -> None:
        pass

    def closes(episode: sp.Episode) -> None:
        episode.call("observe")
        episode.close()

    run = evaluate(tmp_path, trials=20, raises=raises, nothing=does_nothing, closes=closes)
    assert run.rows == []
    line = raises.__code__.co_firstlineno + 1
    error = f"JSONDecodeError: Expecting value: line 1 column 1 (char 0) (test_agents.py, line {line})"
    first, last = [words for words in caplog.messages if words.startswith("raises ")]
    assert re.fullmatch(rf"raises at {HANOI} \([0-9a-f]{{16}}\) failed: {re.escape(error)}", first)
    assert last == f"raises plays no more: it failed 3 times in one place, and finished no episode in between. {error}"
    assert Counter(failure["error"] for failure in run.failures)[error] == 3
    assert repr(run).startswith("<Run: 0 of 60 episodes finished, 9 failed attempts, the last: ")
    assert {(row["player"], row["error"]) for row in run.failures} == {
        ("raises", error),
        ("nothing", "AgentFailedError: The agent has ended. It has not asked its model."),
        ("closes", "AgentFailedError: The agent has closed its episode; leave that to the run."),
    }


def test_a_function_says_by_its_argument_what_it_takes(tmp_path: Path) -> None:
    with pytest.raises(sp.InvalidArgumentError, match="the only argument of an agent is `session` or `episode`"):
        evaluate(tmp_path, mine=lambda game: None)


def test_many_agents_play_at_once(tmp_path: Path) -> None:
    together: list[int] = []

    def waits(episode: sp.Episode) -> None:
        episode.call("act", {"action": sp.GAMES[HANOI].load().actions[0]})  # the others begin once the first has played
        together.append(1)
        until = time.monotonic() + 30
        while len(together) < 12 and time.monotonic() < until:
            time.sleep(0.01)
        episode.call("observe")

    evaluate(tmp_path, trials=12, mine=waits)
    assert len(together) == 12


def test_a_cap_of_the_run_pauses_an_agent_s_episode_which_then_starts_over_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def wordy(session: sp.AgentSession) -> None:
        player = sp.get_player("rule")
        while (prompt := session.prompt()) is not None:
            for call in session.receive({**player.reply(prompt).message, "content": "so " * 4_000}):
                session.answer(call.id)

    def run(name: str, **caps: int) -> Run:
        return sp.evaluate([HANOI], {"mine": wordy}, out=tmp_path / name, trials=1, **caps)

    whole = run("whole").spending.total.tokens
    paused = run("run", run_tokens=whole // 2)
    assert (paused.cap_reached, paused.rows, paused.status.paused) == (True, [], 1)
    spent = paused.spending.total.tokens
    assert 0 < spent < whole // 2 + 8_000, "the cap is exact but for a reply, which has no cap"
    assert "began again" not in caplog.text
    again = run("run", run_tokens=4 * whole)
    assert caplog.text.count("began again from its start: The record does not have the state of its agent.") == 1
    assert again.folder.beginnings() == {"The record does not have the state of its agent": 1}
    assert [row["score"] for row in again.rows] == [3.0]
    assert again.spending.total.tokens == whole + spent


def test_a_run_can_be_played_where_an_event_loop_runs_already(tmp_path: Path) -> None:
    async def main() -> Run:
        return evaluate(tmp_path, mine=through_a_session)

    assert asyncio.run(main()).complete


AGENT = """
import smartplay_tools as sp

async def play_it(episode):
    await sp.aplay(episode, sp.get_player("rule"))
"""


def test_an_agent_of_a_file_plays_on_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(AGENT)
    words = ["eval", "--games", HANOI, "--agent", f"{tmp_path / 'mine.py'}:play_it", "--trials", "2"]
    assert "replies are assumed to have 75 to 300" in shown_by(*words, "--out", tmp_path / "run", "--dry-run")
    shown_by(*words, "--out", tmp_path / "run", "--quiet")
    assert [row["score"] for row in RunFolder(tmp_path / "run").rows()] == [3.0, 3.0]
