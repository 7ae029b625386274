"""An interrupted episode whose record does not replay begins again: the run says why, once, and counts it."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.cli.runs import conclude

BANDIT = "BanditTwoArmedHighLowFixed-v0"
SHORT = sp.Budget(tool_calls=8)
REASON = "The record cannot be continued"


class Model:
    """It remembers nothing, as a model, and counts the replies that were paid."""

    name = "model"
    serves_many = True
    paid, works_for = 0, 10**6

    def __init__(self, **_: Any) -> None:
        self._rule = sp.get_player("rule")

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        if Model.paid >= Model.works_for:
            raise ConnectionError("The server is gone.")
        Model.paid += 1
        return self._rule.reply(prompt)


@pytest.fixture
def interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run of two episodes, each of which has failed after some replies."""
    for key, count in (("paid", 0), ("works_for", 5)):
        monkeypatch.setattr(Model, key, count)
    play(tmp_path / "run")
    Model.paid, Model.works_for = 0, 10**6
    return tmp_path / "run"


def play(out: Path) -> Any:
    return sp.evaluate([BANDIT], {"model": Model}, out=out, trials=2, budgets=SHORT, executor="inline")


def break_records(run: Path) -> None:
    """Another comma in a recorded text, as another release might have written."""
    for record in (run / "attempts").glob("*.jsonl"):
        text = record.read_text(encoding="ascii")
        record.write_text(text.replace("Show the current observation again,", "Show the current observation again"))


def test_an_episode_that_continues_says_nothing(interrupted, caplog):
    again = play(interrupted)
    assert again.complete
    assert Model.paid == 16 - 5
    assert caplog.text.count("began again") == 0
    assert (again.status.began_again, again.folder.beginnings()) == (0, {})


def test_an_episode_that_begins_again_says_why_once_for_a_run_and_is_counted(interrupted, caplog, tmp_path):
    break_records(interrupted)
    with caplog.at_level(logging.WARNING):
        again = play(interrupted)
    assert again.complete
    assert Model.paid == 16
    [said] = [record.message for record in caplog.records if "began again" in record.message]
    assert REASON in said
    assert again.folder.beginnings() == {REASON: 2}
    assert again.status.began_again == 2
    assert "2 began again" in again.status.describe()
    whole = play(tmp_path / "whole")
    assert again.rows == whole.rows, "rows are the same for equal play"


def test_the_commands_say_it_at_the_end(interrupted, capsys):
    break_records(interrupted)
    conclude(play(interrupted))
    said = f"2 episodes began again instead of going on, and what was spent before is counted: {REASON} (2)."
    assert said in capsys.readouterr().err.splitlines()
