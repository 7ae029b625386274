"""What a game hands out: converted to Python's values or refused in a sentence, and its record is always read back."""

import fractions
import json
import re

import numpy as np
import pytest
from hypothesis import given, strategies as st

import smartplay_tools as sp
from smartplay_tools.games import TextGame
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import read_row, row_of

FIRST = {"observation": "Dark.", "reward": 1, "terminated": False, "truncated": False, "score": 1, "completed": False}
FIRST |= {"needs": None, "breaks": None, "state": 0, "deviations": {}}


class Hostile(TextGame):
    """Hands out what a test has put into `values`, from the step `since` on, 0 being the reset."""

    actions, manual = ("Wait", "Go"), "Play."
    values: dict = {}  # noqa: RUF012
    since = 1

    def _of(self, name, step):
        value = (FIRST | (self.values if step >= self.since else {}))[name]
        return value() if callable(value) else value

    def _played(self, step):
        self.score, self.completed, self.step_played = self._of("score", step), self._of("completed", step), step
        return self._of("observation", step)

    def _reset(self):
        return self._played(0)

    def _step(self, action):
        step = self.step_played + 1
        ends = self._of("terminated", step), self._of("truncated", step)
        return self._played(step), self._of("reward", step), *ends

    def _state(self):
        return self._of("state", self.step_played)

    def deviations(self):
        return self._of("deviations", self.step_played)

    needs = property(lambda self: self._of("needs", self.step_played))
    breaks = property(lambda self: self._of("breaks", self.step_played))


SPEC = sp.GameSpec(
    id="Hostile-v0", family="hostile", entry_point=Hostile, history=3, rollout=4, trials=2,
    human_score=1e-9, min_score=0,
)  # fmt: skip


def played(path, monkeypatch, since=2, **values):
    """Play the hostile game, read its record back in every way, and return its result."""
    monkeypatch.setattr(Hostile, "values", values)
    monkeypatch.setattr(Hostile, "since", since)
    path.unlink(missing_ok=True)
    with sp.Episode(SPEC, seed=1, transcript=path) as episode:
        result = sp.play(episode, sp.get_player("random"))
    record = Record.read(path)
    assert record.result == result == Record.head(path).result
    if record.outcome == "finished":
        row = row_of(record, 0) | {"key": "0" * 16}
        assert read_row(json.dumps(row).encode()) == row
    sp.register(SPEC)
    assert sp.replay(path).identical
    return result


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [
        ("score", np.int64(3), 3), ("score", np.float32(0.5), 0.5), ("score", True, 1), ("score", np.array(2), 2),
        ("score", fractions.Fraction(1, 2), 0.5), ("completed", np.bool_(True), True), ("completed", 1, True),
    ],
)  # fmt: skip
def test_numbers_of_other_libraries_become_pythons(tmp_path, monkeypatch, name, value, kept):
    result = played(tmp_path / "record.jsonl", monkeypatch, **{name: value})
    assert (result.end_reason, result.error) == ("rollout", None)
    assert getattr(result, name) == kept
    assert type(getattr(result, name)) in (float, bool)


def test_declared_steps_and_ends_of_numpy_become_pythons(tmp_path, monkeypatch):
    ends = {"terminated": np.bool_(True), "needs": np.array([0, 1]), "breaks": {np.int8(1)}}
    result = played(tmp_path / "record.jsonl", monkeypatch, since=0, **ends)
    assert (result.end_reason, result.steps) == ("terminated", 1)
    call = Record.read(tmp_path / "record.jsonl").calls[-1]["data"]
    assert (call["needs"], call["breaks"]) == ([0, 1], [1])


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("reward", np.float64("nan"), "The reward of step 2 is .*nan.*, and not a finite number"),
        ("reward", 1e300, r"The reward of step 2 is 1e\+300, and not a finite number of at most 1e\+15"),
        ("reward", [1, 2], r"The reward of step 2 is \[1, 2\], and not a finite"),
        ("score", float("-inf"), "The score of step 2 is -inf, and not a finite number"),
        ("score", "3", "The score of step 2 is '3', and not a finite number"),
        ("completed", None, "`completed` of step 2 is None, and not a truth value"),
        ("terminated", "yes", "`terminated` of step 2 is 'yes', and not a truth value"),
        ("observation", 5, "The observation of step 2 is 5, and not a text"),
        ("observation", "a\ud83db", r"The observation of step 2 has '\\ud83d', which is not a character"),
        ("needs", [0.5], r"`needs` of step 2 is \[0.5\], and not a list of whole numbers"),
        ("breaks", 7, "`breaks` of step 2 is 7, and not a list"),
        ("state", np.int64(1), "`_state` of step 2 is not JSON: Object of type int64"),
        ("deviations", {"a": {"b": float("nan")}}, "`deviations` of step 4 is not JSON"),
        ("deviations", {"a": 3}, "`deviations` of step 4 is {'a': 3}, and not a dictionary of dictionaries"),
    ],
)
def test_what_is_no_value_ends_the_episode_in_a_sentence_and_is_a_result(tmp_path, monkeypatch, name, value, sentence):
    path = tmp_path / "record.jsonl"
    result = played(path, monkeypatch, **{name: value})
    assert result.end_reason == "game_error"
    assert re.match(f"GameValueError: {sentence}", result.error), result.error
    assert (result.score, result.completed) == (1, False)
    assert Record.head(path).outcome == "finished"


@pytest.mark.parametrize(
    ("name", "value"), [("observation", "\udc00"), ("observation", None), ("score", float("nan")), ("completed", "no")]
)
def test_a_reset_is_checked_as_a_step_is(tmp_path, monkeypatch, name, value):
    result = played(tmp_path / "record.jsonl", monkeypatch, since=0, **{name: value})
    assert (result.end_reason, result.steps, result.score, result.state_hash) == ("game_error", 0, 0, "")
    assert " of the reset " in result.error


def test_a_run_counts_such_a_result_says_so_and_goes_on(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(Hostile, "values", {"reward": float("nan")})
    run = sp.evaluate([sp.register(SPEC).id], ["random"], out=tmp_path, trials=2, executor="inline")
    assert [(row["end_reason"], row["steps"]) for row in run.rows] == [("game_error", 0)] * 2
    assert run.failures == []
    assert "ended early: GameValueError: The reward of step 1 is nan" in caplog.text


def test_an_error_in_any_of_them_is_the_games_and_is_tried_again(tmp_path, monkeypatch):
    for name in ("needs", "breaks", "state", "deviations"):
        result = played(tmp_path / "record.jsonl", monkeypatch, **{name: lambda: 1 / 0})
        assert (result.end_reason, result.error) == ("game_error", "ZeroDivisionError: division by zero")
        assert Record.head(tmp_path / "record.jsonl").outcome == "failed"


class Odd:
    """An object whose text raises."""

    def __repr__(self):
        raise OSError("no text")


SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.binary(max_size=3), st.builds(Odd),
    st.sampled_from([10**400, -(10**15), 10**15, 1e15, 1e16, "\ud83d", "\0", np.str_("x"), 1j, np.datetime64("NaT")]),
    st.floats(width=32).map(np.float32), st.booleans().map(np.bool_), st.integers(-9, 9).map(np.int8),
    st.floats().map(np.array), st.lists(st.floats(), max_size=2).map(np.array),
)  # fmt: skip
VALUES = st.one_of(
    SCALARS,
    st.lists(SCALARS, max_size=3),
    st.sets(st.integers()),
    st.dictionaries(st.text(max_size=3), SCALARS, max_size=2),
)


@given(values=st.dictionaries(st.sampled_from(sorted(FIRST)), VALUES, min_size=1), since=st.integers(0, 4))
def test_whatever_a_game_hands_out_its_record_is_read_back(values, since, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        played(tmp_path_factory.getbasetemp() / "hostile.jsonl", patch, since, **values)
