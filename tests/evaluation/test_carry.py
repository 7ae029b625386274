"""Chains of trials: what a trial takes over from the one before it, whatever plays them and however often it stops."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.pairs import MEASURES, paired_difference, sample
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.audit import audit
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.types.messages import text_of
from tests.evaluation.command import result_of
from tests.evaluation.players import BrokenOnce

BANDIT = "BanditTwoArmedHighLowFixed-v0"
NOTING = sp.Budget(notes_tokens=100, prompt_tokens=900, tool_calls=12)


def run(out: Path, **options) -> Run:
    asked = {"trials": 6, "budgets": NOTING, "carry": "notes", "chain": 3, "executor": "inline", **options}
    return sp.evaluate([BANDIT], asked.pop("players", ["rule-notes"]), out=out, **asked)


def records(done: Run | RunFolder) -> dict[str, bytes]:
    folder = done if isinstance(done, RunFolder) else done.folder
    return {row["key"]: folder.transcript(row["key"]).read_bytes() for row in folder.rows()}


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    return run(tmp_path_factory.mktemp("carry") / "run")


def test_a_trial_begins_with_the_last_result_and_the_notes_of_the_one_before(played):
    before = None
    for row in played.rows:
        events = sp.read_transcript(played.transcript(row["key"]))
        start, head = events[0], next(event for event in events if event["event"] == "head")
        calls = [event for event in events if event["event"] == "call"]
        if row["trial"] % 3 == 0:
            assert "carried" not in start
            assert len(head["messages"]) == 2
        else:
            assert start["carried"] == before
            introduction = text_of(head["messages"][-1])
            assert introduction.startswith("You have played this game before, in another world.")
            assert before["result"] in introduction
            assert before["notes"] in introduction
        taken = [json.loads(call["arguments"])["text"] for call in calls if call["name"] == "take_notes"]
        before = {"record": events[-1]["chain"], "result": calls[-1]["text"], "notes": taken[-1]}
        assert row["carry"] == "notes"
        assert row["chain"] == 3
        assert row["deviations"]["carry"] == {"paper": None, "played": "notes"}


def test_what_carries_nothing_has_no_new_fields(tmp_path):
    done = run(tmp_path / "run", carry=None, chain=None, trials=1)
    assert not {"carry", "chain"} & done.rows[0].keys()
    assert "carry" not in (done.folder.path / "manifest.json").read_text()


@pytest.mark.parametrize(
    "how",
    [
        {"executor": "async", "workers": 4},
        pytest.param({"executor": "processes", "workers": 2}, marks=pytest.mark.slow),
    ],
)
def test_every_executor_plays_the_same_records(played, tmp_path, how):
    assert records(run(tmp_path / "run", **how)) == records(played)


def test_a_longer_run_continues_its_last_chain(played, tmp_path):
    run(tmp_path / "run", trials=2)
    assert records(run(tmp_path / "run")) == records(played)


def test_a_failed_trial_is_played_again_before_its_successors(tmp_path):
    (tmp_path / "marks").mkdir()
    options = {"players": {"stumbling": BrokenOnce}, "player_options": {"marks": str(tmp_path / "marks")}}
    done = run(tmp_path / "run", chain=None, **options)
    assert done.complete
    assert len(done.failures) == 6, "every trial has failed once, more than there are rounds of retries"
    assert not any(finding.differences for finding in audit(done.folder, 1))


def test_what_waits_for_a_trial_without_a_result_is_named(tmp_path):
    what = f"eval --games {BANDIT} --players tests/evaluation/players.py:Broken --trials 3 --executor inline --quiet"
    carrying = ["--carry", "notes", "--notes-tokens", "50", "--out", str(tmp_path / "run")]
    broken = result_of(*what.split(), *carrying)
    assert broken.exit_code == 1
    assert "2 of them wait for the trial before them in their chain" in broken.stderr
    assert {failure["seed"] for failure in RunFolder(tmp_path / "run").failures()} == {
        RunFolder(tmp_path / "run").manifest().episodes[0].seed
    }


def test_a_replay_of_a_run_finds_a_trial_that_follows_another_record(played, tmp_path):
    done = run(tmp_path / "run")
    assert not any(finding.differences for finding in audit(done.folder, 1))
    other = run(tmp_path / "other", players=[PlayerConfig(name="random")])
    first = done.rows[0]["key"]
    done.transcript(first).write_bytes(other.transcript(other.rows[0]["key"]).read_bytes())
    differences = {finding.key: " ".join(finding.differences) for finding in audit(done.folder, 1)}
    assert "another record" in differences[done.rows[1]["key"]]


def test_the_unit_of_every_interval_is_the_chain(played, tmp_path):
    without = run(tmp_path / "without", carry=None, chain=None)
    assert len(sample(played.rows, MEASURES["score"]).values) == 2
    assert len(sample(without.rows, MEASURES["score"]).values) == 6
    difference = paired_difference(played.rows, without.rows, MEASURES["score"])
    assert difference is not None
    assert difference.episodes == 2


def test_a_rule_learns_from_trial_to_trial_how_often_a_better_machine_wins(played):
    events = sp.read_transcript(played.transcript(played.rows[2]["key"]))
    noted = next(json.loads(event["arguments"])["text"] for event in events if event.get("name") == "take_notes")
    (better, _), (worse, _) = json.loads(noted.removeprefix("Notes: "))["ranks"]
    assert better > worse


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"budgets": sp.Budget()}, "give notes_tokens a number"),
        ({"carry": None}, 'ask for carry="notes" or carry="memory"'),
        ({"carry": "memories"}, "carry must be one of notes, memory, not 'memories'"),
        ({"carry": "memory"}, "give memory_tokens a number"),
        ({"repeats": 2}, "plays every world once"),
        ({"budgets": NOTING.model_copy(update={"result_tokens": None})}, "give result_tokens a number"),
        ({"budgets": sp.Budget(notes_tokens=100, prompt_tokens=450)}, "carried from the trial before"),
    ],
)
def test_what_cannot_be_carried_is_refused_in_a_sentence(tmp_path, options, reason):
    with pytest.raises(sp.InvalidArgumentError, match=reason):
        run(tmp_path / "run", **options)


def test_a_single_episode_carries_nothing():
    with pytest.raises(sp.InvalidArgumentError, match="rules of a run"):
        sp.Episode(BANDIT, seed=1, carry="notes", budget=NOTING)
