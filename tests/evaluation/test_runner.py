"""Runs: what is played, what is kept, and that neither workers, failures nor interruptions change a result."""

from __future__ import annotations

import json
import multiprocessing
import subprocess
import sys
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.cli.progress import spending_sentences
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.merge import merge
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.evaluation.suites import suite_games
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.providers.prices import Price
from tests.evaluation.command import shown_by
from tests.evaluation.players import Broken, BrokenOnce, Connected, Killer, Leaver, Metered

BANDIT, RPS, HANOI = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"
GAMES = [BANDIT, HANOI]


def results(folder: Path) -> bytes:
    return (folder / "results.jsonl").read_bytes()


def test_a_run_has_a_row_and_a_record_for_every_game_player_and_trial(tmp_path):
    run = sp.evaluate(GAMES, ["rule", "random"], out=tmp_path, trials=2, executor="inline")
    assert run.complete
    assert [(row["game"], row["player"], row["trial"]) for row in run.rows] == [
        (game, player, trial) for game in GAMES for player in ("rule", "random") for trial in (0, 1)
    ]
    for row in run.rows:
        record = run.folder.transcript(row["key"])
        assert sp.replay(record).identical
        assert sp.read_transcript(record)[-1]["result"]["score"] == row["score"]
    assert run.failures == []


def test_a_trial_has_the_same_seed_in_every_cell_and_another_one_in_another_run(tmp_path):
    run = sp.evaluate([HANOI], ["rule", "random"], out=tmp_path / "a", trials=3, executor="inline", seed=5)
    seeds = [row["seed"] for row in run.rows]
    assert seeds[:3] == seeds[3:] == [trial_seed(5, HANOI, trial) for trial in range(3)]
    assert len({trial_seed(seed, game, 0) for seed in range(9) for game in sp.GAMES}) == 9 * len(sp.GAMES)


def test_the_papers_suite_has_the_papers_games_and_trials(tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match="no suite 'papers'"):
        sp.evaluate(suite="papers", out=tmp_path)
    plan = plan_episodes(make_cells(suite_games("paper", []), ["rule"], [sp.Budget()]))
    trials = {game: sum(e.cell.game == game for e in plan.episodes) for game in suite_games("paper", [])}
    assert list(trials.values()) == [20, 20, 10, 100, 100, 10, 20]


@pytest.mark.parametrize(("executor", "workers"), [pytest.param("processes", 2, marks=pytest.mark.slow), ("async", 5)])
def test_the_results_do_not_depend_on_executor_or_workers(tmp_path, executor, workers):
    for name, how in {"one": ("inline", 1), "many": (executor, workers)}.items():
        run = sp.evaluate(GAMES, ["random"], out=tmp_path / name, trials=4, executor=how[0], workers=how[1])
        assert run.complete
    assert results(tmp_path / "one") == results(tmp_path / "many")


def test_a_run_can_be_extended_by_trials_games_and_players(tmp_path):
    sp.evaluate([HANOI], ["rule"], out=tmp_path / "a", trials=1, executor="inline")
    sp.evaluate(GAMES, ["rule", "random"], out=tmp_path / "a", trials=2, executor="inline")
    sp.evaluate(GAMES, ["rule", "random"], out=tmp_path / "b", trials=2, executor="inline")
    assert results(tmp_path / "a") == results(tmp_path / "b")


def test_a_run_from_before_stalled_turns_says_how_to_go_on(tmp_path):
    def evaluate(budget):
        return sp.evaluate([HANOI], ["rule"], out=tmp_path, trials=1, executor="inline", budgets=budget)

    evaluate(sp.Budget.from_record({}))  # as it stands in older manifests
    with pytest.raises(sp.InvalidArgumentError, match=r"with stalled_turns=None \(--stalled-turns none\)"):
        evaluate(sp.Budget())
    assert len(evaluate(sp.Budget(stalled_turns=None)).rows) == 1


def test_a_run_that_was_begun_by_a_run_file_says_where_its_text_is(tmp_path):
    plan = {"out": tmp_path, "trials": 1, "executor": "inline"}
    sp.evaluate([HANOI], ["rule"], **plan)
    begun = RunFolder(tmp_path).manifest().model_copy(update={"run_file": "games = []"})
    (tmp_path / "manifest.json").write_text(json.dumps(begun.to_json()))
    with pytest.raises(sp.InvalidArgumentError, match=r"begun by a run file, whose text is in manifest\.json"):
        sp.evaluate([HANOI], ["random"], **plan)


def test_a_run_of_an_earlier_version_that_ended_once_it_was_decided_is_read_and_goes_on(tmp_path, caplog):
    """Its manifest has the margin of `--until decided`, and two of its three planned trials were not needed."""
    plan = {"games": [HANOI], "players": ["rule"], "out": tmp_path, "executor": "inline"}
    sp.evaluate(**plan, trials=1)
    planned = plan_episodes(make_cells([HANOI], ["rule"], [sp.Budget()]), trials=3).manifest(shard=None, prices={})
    older = planned.model_copy(update={"until": {"margin": "0.1h", "clip": None, "by": "score"}})
    (tmp_path / "manifest.json").write_text(json.dumps(older.to_json()))
    for command in ("replay", "results"):
        shown_by(command, tmp_path)
    assert sp.evaluate(**plan, trials=3).complete
    assert "it has all episodes that are asked for" in caplog.text
    assert RunFolder(tmp_path).manifest().until is None


def test_a_run_does_not_go_into_the_folder_of_another_or_into_a_file(tmp_path):
    sp.evaluate([HANOI], out=tmp_path, trials=1, executor="inline")
    with pytest.raises(sp.InvalidArgumentError, match="holds another run: 1 of its 1 episodes"):
        sp.evaluate([HANOI], out=tmp_path, trials=1, executor="inline", seed=1)
    (tmp_path / "taken").touch()
    with pytest.raises(sp.InvalidArgumentError, match="taken cannot be written"):
        sp.evaluate([HANOI], out=tmp_path / "taken", trials=1, executor="inline")


def test_two_runs_cannot_write_one_folder_at_the_same_time(tmp_path):
    with RunWriter(tmp_path).writing(), pytest.raises(sp.InvalidArgumentError, match="Another process is writing"):
        sp.evaluate([HANOI], out=tmp_path, trials=1, executor="inline")


def test_what_cannot_be_played_is_told_before_the_first_episode_with_its_cells(tmp_path):
    budgets = [sp.Budget(prompt_tokens=100), sp.Budget(prompt_tokens=2000)]
    with pytest.raises(sp.InvalidArgumentError) as caught:
        sp.evaluate(GAMES, out=tmp_path, budgets=budgets, executor="inline")
    for game in GAMES:
        assert f"{game}, rule, prompts <= 100: prompt_tokens=100 cannot hold the head" in str(caught.value)
    assert "prompt_tokens=2000" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"players": ["rul"]}, "There is no player 'rul'; did you mean rule?"),
        ({"players": []}, "at least one player"),
        ({"games": ["Hanoi-v0"]}, "did you mean"),
        ({"games": []}, "Name games"),
        ({"games": [HANOI, HANOI]}, "the same episode twice"),
        ({"trials": 0}, "at least 1"),
        ({"workers": 0}, "at least 1"),
        ({"executor": "fork"}, "no executor 'fork'"),
        ({"shard": (3, 2)}, "no shard 3 of 2"),
        ({"engine": "voxel"}, "None of the games has an engine 'voxel'"),
        ({"player_options": {"marks": {1, 2}}}, "Options are recorded, so they must be JSON"),
        ({"run_tokens": -5}, "run_tokens must be above 0"),
        ({"options": {"area": 9}}, "None of the games has an option 'area'"),
        ({"protocol": "telepathy"}, "protocol must be one of"),
        (
            {"player_options": {"temperature": 1}},
            "The player 'rule' cannot be made with these arguments: .*'temperature'",
        ),
        ({"players": {"mine": lambda seed: Broken(seed=seed)}, "executor": "processes"}, "worker processes"),
        ({"player_options": {"seed": 1}}, "seed is not an option of a player"),
        ({"players": ["openai:x"], "run_cost": 1.0, "player_options": {"base_url": "http://127.0.0.1:9"}}, "--price"),
    ],
)
def test_a_mistake_of_the_user_is_one_sentence(tmp_path, wrong, message):
    with pytest.raises(sp.SmartPlayError, match=message):
        sp.evaluate(**{"games": [HANOI], "players": ["rule"], "out": tmp_path, "executor": "inline", **wrong})


def test_an_option_and_an_engine_go_to_the_games_that_know_them(tmp_path):

    games = [HANOI, "MessengerL1-v0", "MinedojoCreative0-v0"]
    cells = make_cells(games, ["rule"], [sp.Budget()], engine="voxel", options={"split": "train"})
    asked = [(cell.engine, dict(cell.options)) for cell in cells]
    assert asked == [(None, {}), (None, {"split": "train"}), ("voxel", {})]


# What goes wrong.


def test_a_failed_episode_is_tried_again_and_both_attempts_are_on_record(tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    arguments = {"trials": 2, "executor": "inline", "player_options": {"marks": str(marks)}}
    run = sp.evaluate([BANDIT], {"broken": BrokenOnce}, out=tmp_path / "run", **arguments)
    assert run.complete
    assert [(f["attempt"], f["end_reason"], f["error"]) for f in run.failures] == [
        (1, "player_error", "RuntimeError: stumbled")
    ] * 2
    assert [row["attempt"] for row in run.folder.timings()] == [1, 1, 2, 2]


def test_a_player_that_exits_ends_its_episode_and_not_the_run(tmp_path):
    players = {"leaver": Leaver, "rule": sp.get_player("rule").__class__}
    run = sp.evaluate([BANDIT], players, out=tmp_path, trials=1, executor="inline")
    assert [row["player"] for row in run.rows] == ["rule"]
    (failed,) = {(failure["end_reason"], failure["error"]) for failure in run.failures}
    assert failed[0] == "exception"
    assert failed[1].startswith("SystemExit: 0 (players.py, line ")


PROGRAM = f"""import smartplay_tools as sp
sp.evaluate([{HANOI!r}], ["random"], trials=2, workers=2, executor="processes", out="run")
"""


@pytest.mark.slow
@pytest.mark.parametrize("from_file", [True, False], ids=["file", "standard input"])
def test_a_program_that_workers_cannot_import_is_told_so(tmp_path, from_file):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    command = [sys.executable, str(program)] if from_file else [sys.executable]
    shown = subprocess.run(command, cwd=tmp_path, input=PROGRAM, capture_output=True, text=True, timeout=120)
    assert shown.returncode == 1
    sentence = shown.stderr.splitlines()[-1]
    assert 'executor="async" or executor="inline"' in sentence
    assert ('if __name__ == "__main__":' if from_file else "<stdin> is not a file") in sentence


@pytest.mark.slow
def test_a_worker_that_dies_takes_no_other_episode_with_it(tmp_path):
    victim = trial_seed(0, BANDIT, 1)
    arguments = {"executor": "processes", "workers": 2, "player_options": {"victim": victim}}
    run = sp.evaluate([BANDIT], {"killer": Killer}, out=tmp_path, trials=4, **arguments)
    assert [row["trial"] for row in run.rows] == [0, 2, 3]
    failed = [failure for failure in run.failures if failure["end_reason"] != "interrupted"]
    assert {failure["seed"] for failure in failed} == {victim}
    assert {failure["error"] for failure in failed} == {"The worker process died while it played this episode."}
    lost = run.spending.other_attempts.unknown_calls
    assert 4 <= lost <= 8, "four attempts, in each of which the other worker's call was lost, too, if there was one"
    assert f"{lost} calls were under way when the run or a worker stopped" in spending_sentences(run.spending)[0]
    assert multiprocessing.active_children() == []


def test_a_torn_row_and_a_lost_row_are_made_again_from_the_records(tmp_path):
    sp.evaluate(GAMES, out=tmp_path, trials=2, executor="inline")
    whole = results(tmp_path)
    (tmp_path / "results.jsonl").write_bytes(whole[: len(whole) // 2])
    assert 0 < len(RunFolder(tmp_path).rows()) < 4
    run = sp.evaluate(GAMES, out=tmp_path, trials=2, executor="inline")
    assert results(tmp_path) == whole
    assert len(run.folder.timings()) == 4


# Many at once, and many machines.


def test_a_player_that_serves_many_episodes_is_opened_anew_for_those_that_are_tried_again(tmp_path):
    run = sp.evaluate([HANOI], {"connected": Connected}, out=tmp_path, trials=3, executor="async")
    assert run.complete
    assert {failure["error"] for failure in run.failures} == {"RuntimeError: the line broke"}
    assert (Connected.opened, Connected.closed) == (2, 2)


def test_shards_put_together_are_the_whole_run(tmp_path):
    arguments = {"players": ["random"], "trials": 3, "executor": "inline"}
    sp.evaluate(GAMES, out=tmp_path / "whole", **arguments)
    for number in (1, 2):
        run = sp.evaluate(GAMES, out=tmp_path / str(number), shard=(number, 2), **arguments)
        assert run.complete
        assert 2 <= len(run.rows) <= 4
    for shard in (None, (2, 2)):
        with pytest.raises(sp.InvalidArgumentError, match="holds shard 1/2 of this run"):
            sp.evaluate(GAMES, out=tmp_path / "1", shard=shard, **arguments)
    merge([tmp_path / "1", tmp_path / "2"], tmp_path / "merged")
    assert results(tmp_path / "merged") == results(tmp_path / "whole")
    again = sp.evaluate(GAMES, out=tmp_path / "merged", **arguments)
    assert len(again.folder.timings()) == 6
    merge([tmp_path / "1"], tmp_path / "half")  # which is played to its end
    sp.evaluate(GAMES, out=tmp_path / "half", **arguments)
    assert results(tmp_path / "half") == results(tmp_path / "whole")


def test_an_episode_stays_in_its_shard_when_the_run_is_extended(tmp_path):

    def keys(games: list[str], players: list[str], trials: int) -> list[set[str]]:
        plan = plan_episodes(make_cells(games, players, [sp.Budget()]), trials=trials)
        return [{episode.key for episode in plan.shard(number, 3).episodes} for number in (1, 2, 3)]

    for small, large in zip(keys([HANOI], ["rule"], 4), keys(GAMES, ["random", "rule"], 7), strict=True):
        assert small <= large


def test_a_part_is_merged_once_and_with_parts_of_the_same_prices_only(tmp_path):
    arguments = {"games": [HANOI], "players": {"metered": Metered}, "trials": 2, "executor": "inline"}
    for part, price in ((1, 1.0), (2, 2.0)):
        prices = {"metered": Price.per_million(price, 1.0)}
        sp.evaluate(out=tmp_path / str(part), shard=(part, 2), prices=prices, **arguments)
    with pytest.raises(sp.InvalidArgumentError, match="named twice"):
        merge([tmp_path / "1", tmp_path / "1"], tmp_path / "merged")
    with pytest.raises(sp.InvalidArgumentError, match="costs at different prices"):
        merge([tmp_path / "1", tmp_path / "2"], tmp_path / "merged")
    sp.evaluate(out=tmp_path / "1", shard=(1, 2), prices=prices, **arguments)
    merge([tmp_path / "1", tmp_path / "2"], tmp_path / "merged")
    sp.evaluate(out=tmp_path / "whole", prices=prices, **arguments)
    assert results(tmp_path / "merged") == results(tmp_path / "whole")


def test_what_does_not_belong_together_is_not_merged(tmp_path):
    sp.evaluate([HANOI], ["rule"], out=tmp_path / "a", trials=1, executor="inline")
    sp.evaluate([HANOI], ["random"], out=tmp_path / "b", trials=1, executor="inline")
    with pytest.raises(sp.InvalidArgumentError, match="not parts of the same run"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    with pytest.raises(sp.InvalidArgumentError, match="already contains a run"):
        merge([tmp_path / "a"], tmp_path / "b")
    rows = [json.loads(line) | {"score": -1.0} for line in results(tmp_path / "a").splitlines()]
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "manifest.json").write_bytes((tmp_path / "a" / "manifest.json").read_bytes())
    (tmp_path / "d" / "results.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(sp.InvalidArgumentError, match="played twice with different results"):
        merge([tmp_path / "a", tmp_path / "d"], tmp_path / "e")
