"""Chains of trials: what a trial takes over from the one before it, whatever plays them and however often it stops."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.episode.carried import Carried, longest_message
from smartplay_tools.evaluation.analysis.area import areas
from smartplay_tools.evaluation.analysis.pairs import MEASURES, paired_difference, sample
from smartplay_tools.evaluation.board.submissions.check import check_submission
from smartplay_tools.evaluation.board.submissions.prepare import prepare_submission
from smartplay_tools.evaluation.run_folder.folder import RunFolder, Until, trial_seed
from smartplay_tools.evaluation.runs.merge import audit, merge
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.registry import read_file
from smartplay_tools.types.messages import text_of
from tests.evaluation.bundles import FACTS
from tests.evaluation.players import BrokenOnce, act
from tests.processes import heed_interrupts, needs_unix

BANDIT = "BanditTwoArmedHighLowFixed-v0"
NOTING = sp.Budget(notes_tokens=100, prompt_tokens=900, tool_calls=12)
ROOT = Path(__file__).parents[2]
EXPERIMENT = ROOT / "experiments" / "carry.py"


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


def test_shards_hold_whole_chains_and_merge_to_the_same_records(played, tmp_path):
    parts = [run(tmp_path / f"part{number}", shard=(number, 2)) for number in (1, 2)]
    assert [{row["trial"] // 3 for row in part.rows} for part in parts] in ([{0}, {1}], [{1}, {0}])
    whole = merge([part.folder.path for part in parts], tmp_path / "whole")
    assert records(whole) == records(played)


def test_a_part_of_a_chain_is_not_merged(played, tmp_path):
    for number in (1, 2):
        run(tmp_path / f"part{number}", shard=(number, 2))
    part = RunFolder(tmp_path / "part1")
    part.transcript(part.rows()[0]["key"]).unlink()
    with pytest.raises(sp.InvalidArgumentError, match="has no record"):
        merge([part.path, tmp_path / "part2"], tmp_path / "whole")


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
    broken = CliRunner().invoke(app, [*what.split(), *carrying])
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


def test_a_submission_is_verified_with_its_chains(played, tmp_path):
    prepare_submission(played.folder.path, tmp_path / "bundle.zip", FACTS)
    checked = check_submission(tmp_path / "bundle.zip", workers=0)
    assert checked.errors == []
    assert len(checked.rows) == 6


def test_the_unit_of_every_interval_is_the_chain(played, tmp_path):
    without = run(tmp_path / "without", carry=None, chain=None)
    assert len(sample(played.rows, MEASURES["score"]).values) == 2
    assert len(sample(without.rows, MEASURES["score"]).values) == 6
    difference = paired_difference(played.rows, without.rows, MEASURES["score"])
    assert difference is not None
    assert difference.episodes == 2
    capped = [{**row, "budget": {**row["budget"], "prompt_tokens": cap}} for cap in (900, None) for row in played.rows]
    assert [each.reason for each in areas(capped)] == ["trials carry something over, so seeds are not independent"]


@pytest.mark.slow
@pytest.mark.skipif(not EXPERIMENT.exists(), reason="not in a checkout")
def test_the_figure_has_a_place_for_every_trial_of_a_chain(played, tmp_path):
    score_against_trial = read_file(f"{EXPERIMENT}:score_against_trial").value
    without = run(tmp_path / "without", carry=None, chain=None)
    (panel,) = score_against_trial([*without.rows, *played.rows]).axes
    assert [label.get_text() for label in panel.get_xticklabels()] == ["1", "2", "3"]
    assert len(panel.get_legend_handles_labels()[1]) == 2
    (begun,) = score_against_trial([row for row in played.rows if row["trial"] < 2]).axes
    assert [label.get_text() for label in begun.get_xticklabels()] == ["1", "2", "3"]
    with pytest.raises(sp.InvalidArgumentError, match="chains of one length"):
        score_against_trial(without.rows)


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
        ({"until": Until("1")}, "leave out --until or carry"),
    ],
)
def test_what_cannot_be_carried_is_refused_in_a_sentence(tmp_path, options, reason):
    with pytest.raises(sp.InvalidArgumentError, match=reason):
        run(tmp_path / "run", **options)


def test_a_single_episode_carries_nothing():
    with pytest.raises(sp.InvalidArgumentError, match="rules of a run"):
        sp.Episode(BANDIT, seed=1, carry="notes", budget=NOTING)


def test_the_longest_message_is_reserved_and_never_exceeded():
    counter, chance = shared_counter(), random.Random(1)
    with sp.Episode(BANDIT, seed=1, budget=NOTING) as episode:
        budget, words = episode.budget, episode.words
    longest = longest_message("notes", budget, counter, words)
    pieces = ["\n", " ", "/", "a", "word", "'s", "1", "\u00e9", "\u4e2d", "[", "\r\n\n"]
    for _ in range(20):
        result, notes = ("".join(chance.choices(pieces, k=400)) for _ in range(2))
        while counter.text(result) > budget.result_tokens:
            result = result[:-1]
        while counter.text(notes) > budget.notes_tokens:
            notes = notes[:-1]
        message = Carried(record="0" * 32, result=result, notes=notes).message(counter, longest, words)
        assert counter.message(message) <= longest


class Clearing:
    """Takes notes in the first trial, and clears them in the second."""

    name = "clearing"

    def __init__(self, *, seed: int, first: int) -> None:
        self._text = {0: "remember", 1: "  "}.get(seed - first)
        self._asked = False

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        self._asked, begins = True, not self._asked
        if self._text is None or not begins:
            return sp.Reply(act("1"))
        note = {"name": "take_notes", "arguments": json.dumps({"text": self._text})}
        return sp.Reply({"role": "assistant", "tool_calls": [{"id": "n", "type": "function", "function": note}]})


def test_notes_that_were_cleared_are_not_carried(tmp_path):
    first = trial_seed(0, BANDIT, 0)
    done = run(tmp_path / "run", players={"clearing": Clearing}, player_options={"first": first}, trials=4, chain=None)
    carried = [sp.read_transcript(done.transcript(row["key"]))[0].get("carried") for row in done.rows]
    assert [each and each.get("notes") for each in carried] == [None, "remember", None, None]


class Filing:
    """Looks at its files, and adds one with the number of the trial."""

    name = "filing"

    def __init__(self, *, seed: int, first: int) -> None:
        trial = seed - first
        path = f"/memories/{trial}.txt"
        self._calls = [
            {"command": "view", "path": "/memories"},
            {"command": "create", "path": path, "file_text": f"trial {trial}"},
            {"command": "create", "path": "/memories/long.txt", "file_text": "word " * 500},
        ]
        if trial == 2:
            self._calls.append({"command": "delete", "path": "/memories/0.txt"})

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        if not self._calls:
            return sp.Reply(act("1"))
        call = {"name": "memory", "arguments": json.dumps(self._calls.pop(0))}
        return sp.Reply({"role": "assistant", "tool_calls": [{"id": "m", "type": "function", "function": call}]})


def test_files_are_carried_and_none_is_in_view(tmp_path):
    options = {"first": trial_seed(0, BANDIT, 0)}
    budget = sp.Budget(memory_tokens=60, prompt_tokens=1500, tool_calls=8)
    done = run(
        tmp_path / "run",
        players={"filing": Filing},
        player_options=options,
        trials=4,
        chain=None,
        carry="memory",
        budgets=budget,
    )
    events = [sp.read_transcript(done.transcript(row["key"])) for row in done.rows]
    carried = [each[0].get("carried", {}).get("files") for each in events]
    first, second, third = ({f"/memories/{n}.txt": f"trial {n}"} for n in range(3))
    assert carried == [None, first, first | second, second | third]
    views = [next(event["text"] for event in each if event["event"] == "call") for each in events]
    assert "/memories/0.txt" in views[1]
    assert "/memories/1.txt" in views[3]
    heads = [str(next(event for event in each if event["event"] == "head")["messages"]) for each in events]
    assert not any("trial 0" in head for head in heads)
    assert "The last result there was" in heads[1]
    assert not any(finding.differences for finding in audit(done.folder, 1))


SCRIPT = """
import sys
import smartplay_tools as sp
from smartplay_tools.players import get_player

class Slow:
    name = "slow"
    def __init__(self, *, seed, seconds):
        self._player, self._seconds = get_player("rule-notes", seed=seed), seconds
    def reply(self, prompt):
        import time
        time.sleep(self._seconds)
        return self._player.reply(prompt)

if __name__ == "__main__":
    out, executor = sys.argv[1:3]
    run = sp.evaluate([{game!r}], {{"slow": Slow}}, out=out, trials={trials}, executor=executor, workers=2,
                      player_options={{"seconds": 0.002}}, budgets=sp.Budget(notes_tokens=100), carry="notes",
                      chain=3, on_progress=lambda p: print(p.finished, flush=True))
    sys.exit(0 if run.complete else 1)
"""


def start(out: Path, executor: str, trials: int) -> subprocess.Popen[str]:
    needs_unix()
    script = out.parent / "script.py"
    script.write_text(SCRIPT.format(game=BANDIT, trials=trials))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, str(script), str(out), executor]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, preexec_fn=heed_interrupts)


@pytest.mark.slow
def test_a_ray_cluster_plays_the_same_records(tmp_path):
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    for executor in ("inline", "ray"):
        with start(tmp_path / executor, executor, trials=6) as process:
            assert process.wait(240) == 0
    assert records(RunFolder(tmp_path / "ray")) == records(RunFolder(tmp_path / "inline"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("executor", "kills", "trials"),
    [("inline", 1, 4), ("processes", 8, 24)],
)
def test_a_run_that_was_killed_has_the_rows_of_one_that_was_not(tmp_path, executor, kills, trials):
    chance = random.Random(executor)
    with start(tmp_path / "whole", executor, trials) as process:
        assert process.wait(120) == 0
    for _ in range(kills):
        with start(tmp_path / "killed", executor, trials) as process:
            assert process.stdout is not None
            process.stdout.readline()  # the run has begun
            time.sleep(chance.random() * 0.5)
            process.kill()
    with start(tmp_path / "killed", executor, trials) as process:
        assert process.wait(120) == 0
    whole, killed = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "killed")
    rows = [(folder.path / "results.jsonl").read_bytes() for folder in (whole, killed)]
    assert rows[0] == rows[1]
    assert not any(finding.differences for finding in audit(killed, 1))
