"""What raises after an episode has ended: the record has the result, and nothing is played or paid for again."""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import ClosingWarning
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.games import GAMES
from smartplay_tools.games.hanoi import Hanoi

RPS, HANOI = "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"
ASKED: Counter[str] = Counter()


class OnDisplay(Hanoi):
    """A game whose display is gone at the end, whether or not it was played."""

    def close(self) -> None:
        raise RuntimeError("the display is gone")


class Paid:
    """A player whose replies are paid for, and whose connections cannot be closed."""

    name = "paid"

    def __init__(self, how: str = "raises") -> None:
        self._rule, self._how = sp.get_player("rule"), how

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        ASKED["paid"] += 1
        return self._rule.reply(prompt)

    def __enter__(self) -> Paid:
        return self

    def __exit__(self, *_: object) -> None:
        if self._how == "dies":
            os._exit(3)
        raise OSError("the connection is gone")


def paid(seed: int) -> Paid:
    return Paid()


def dying(seed: int) -> Paid:
    return Paid("dies")


@pytest.fixture
def display() -> Any:
    yield sp.register(replace(GAMES[HANOI], id="Display-v0", entry_point=OnDisplay)).id
    GAMES._specs.pop("Display-v0")


def attempts(run: Run) -> int:
    return len((run.folder.path / "timings.jsonl").read_text().splitlines())


@pytest.mark.parametrize("executor", ["inline", "async"])
def test_a_game_that_cannot_be_closed_keeps_its_results(display: str, executor: str, tmp_path: Path) -> None:
    here = r"The game OnDisplay could not be closed: RuntimeError: the display is gone \(test_ends_that_raise.py, line"
    with pytest.warns(ClosingWarning, match=here):
        run = sp.evaluate([display], ["random"], out=tmp_path, trials=2, executor=executor)
    assert ([row["end_reason"] for row in run.rows], attempts(run), run.failures) == (["rollout"] * 2, 2, [])
    with pytest.warns(ClosingWarning, match=here):
        assert all(sp.replay(run.transcript(row["key"])).identical for row in run.rows)


@pytest.mark.parametrize("executor", ["inline", "async"])
def test_a_player_that_cannot_be_closed_is_paid_once(executor: str, tmp_path: Path) -> None:
    ASKED.clear()
    with pytest.warns(ClosingWarning, match=r"The player paid could not be closed: OSError: .*, line \d+\)"):
        run = sp.evaluate([RPS], {"mine": paid}, out=tmp_path, trials=1, executor=executor)
    assert (len(run.rows), run.rows[0]["steps"], attempts(run)) == (1, 50, 1)
    assert ASKED["paid"] == run.spending.total.replies >= 50


@pytest.mark.slow
def test_a_worker_that_dies_while_it_closes_has_played(tmp_path: Path) -> None:
    run = sp.evaluate([HANOI], {"mine": dying}, out=tmp_path, trials=2, executor="processes", workers=2)
    assert (len(run.rows), run.failures) == (2, [])


def ends_and_raises(episode: sp.Episode) -> None:
    ASKED["ends"] += 1
    sp.play(episode, sp.get_player("rule"))
    raise KeyError("score")


def raises_midway(session: sp.AgentSession) -> None:
    ASKED["midway"] += 1
    reply = session.ask(sp.get_player("rule").reply)
    assert reply is not None
    for call in session.receive(reply.message):
        session.answer(call.id)
    raise RuntimeError("boom")


def test_an_agent_that_fails_after_the_end_has_played_and_one_that_fails_midway_is_stopped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ASKED.clear()
    run = sp.evaluate([HANOI], {"ends": ends_and_raises, "midway": raises_midway}, out=tmp_path, trials=20, workers=1)
    assert (ASKED["ends"], ASKED["midway"]) == (20, 3)
    assert [row["player"] for row in run.rows] == ["ends"] * 20
    rows = [json.loads(line) for line in (tmp_path / "timings.jsonl").read_text().splitlines()]
    assert sum(row.get("after_the_end", "").startswith("KeyError: 'score' (test_ends_that") for row in rows) == 20
    assert sum("keeps its result" in message for message in caplog.messages) == 1
    assert sum(message.startswith("midway plays no more: it failed 3 times in one") for message in caplog.messages) == 1


def test_a_finished_episode_begins_the_count_of_failures_anew(tmp_path: Path) -> None:
    ASKED.clear()

    def fails_twice(session: sp.AgentSession) -> None:
        if (ASKED["twice"] + 1) % 3:
            ASKED["twice"] += 1
            raises_midway(session)
        ASKED["twice"] += 1
        while (reply := session.ask(sp.get_player("rule").reply)) is not None:
            for call in session.receive(reply.message):
                session.answer(call.id)

    run = sp.evaluate([HANOI], {"mine": fails_twice}, out=tmp_path, trials=2, workers=1)
    assert (len(run.rows), ASKED["twice"]) == (2, 6)
