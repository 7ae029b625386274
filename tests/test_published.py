"""Results in the formats of those who collect them, checked against their published schemas.

`every_eval_ever.schema.json` is `eval.schema.json` of the package `every-eval-ever` 0.3.0; the entries of the Hub are
read and written by `huggingface_hub`.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.analysis import summarize
from smartplay_tools.evaluation.exports import export
from smartplay_tools.evaluation.runs import PlayerConfig
from tests.evaluation.players import FirstMoves

SCHEMA = Path(__file__).parent / "data" / "every_eval_ever.schema.json"
ABOUT = {"model": "smartplay/rule", "organization": "A laboratory", "relationship": "first_party"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("published") / "run"
    budgets = [sp.Budget(tool_calls=20), sp.Budget(tool_calls=20, prompt_tokens=900, reply_tokens=300)]
    games = ["Hanoi3Disk-v0", "Crafter-v0"]
    played = sp.evaluate(games, ["rule", "random"], budgets=budgets, trials=2, executor="inline", out=out)
    return out, [row for row in played.rows if row["player"] == "rule"]


def test_every_eval_ever(run, tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    out, rows = run
    exported = export(out, tmp_path / "eee", "eee", publication=ABOUT, players=("rule",))
    assert exported.counts == {"episodes": 8, "results": 4}
    (path,) = (tmp_path / "eee").rglob("*.json")
    assert path.parent == tmp_path / "eee" / "data" / "smartplay-tools" / "smartplay" / "rule"
    written = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.validate(written, json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert written["source_metadata"]["evaluator_relationship"] == "first_party"
    cells = {(cell.cell.game, cell.cell.budget["reply_tokens"]): cell.score for cell in summarize(rows).cells}
    for result in written["evaluation_results"]:
        expected = cells[result["evaluation_name"], result["generation_config"]["generation_args"].get("max_tokens")]
        details = result["score_details"]
        ends = details["uncertainty"].get("confidence_interval", {})
        assert details["score"] == expected.mean
        assert (ends.get("lower"), ends.get("upper")) == (expected.low, expected.high)
    bounds = {r["evaluation_name"]: r["metric_config"]["max_score"] for r in written["evaluation_results"]}
    assert bounds == {"Hanoi3Disk-v0": 3, "Crafter-v0": "Infinity"}
    limits = [r["generation_config"]["generation_args"].get("max_tokens") for r in written["evaluation_results"]]
    assert sorted(limits, key=str) == [300, 300, None, None]


def test_the_same_results_have_the_same_name(run, tmp_path):
    out, _ = run
    for folder in ("first", "second"):
        export(out, tmp_path / folder, "eee", publication=ABOUT, players=("rule",))
    first, second = ([path.name for path in (tmp_path / folder).rglob("*.json")] for folder in ("first", "second"))
    assert first == second


def test_results_of_a_models_repository(run, tmp_path):
    hub, yaml = pytest.importorskip("huggingface_hub"), pytest.importorskip("yaml")
    out, rows = run
    exported = export(
        out, tmp_path / "hub", "hf-results", publication={"dataset": "smartplay/tools"}, players=("rule",)
    )
    assert exported.counts == {"episodes": 8, "entries": 4, "files": 2}
    paths = sorted((tmp_path / "hub" / ".eval_results").iterdir())
    assert [path.name for path in paths] == [
        "smartplay_calls-20.yaml",
        "smartplay_prompts-900-replies-300-calls-20.yaml",
    ]
    means = {(row["game"], row["budget"]["reply_tokens"]): [] for row in rows}
    for row in rows:
        means[row["game"], row["budget"]["reply_tokens"]].append(row["score"])
    for path, limit in zip(paths, (None, 300), strict=True):
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        entries = hub.parse_eval_result_entries(data)
        assert hub.eval_result_entries_to_yaml(entries) == data  # nothing that the format does not have
        assert {entry.dataset_id for entry in entries} == {"smartplay/tools"}
        for entry in entries:
            assert entry.value == pytest.approx(sum(means[entry.task_id, limit]) / 2)
            assert "mean of 2 episodes" in entry.notes


def published_scores(folder: Path) -> dict[str, float]:
    """The published mean of each result by its player's options."""
    (path,) = folder.rglob("*.json")
    results = json.loads(path.read_text(encoding="utf-8"))["evaluation_results"]
    facts = ((each["generation_config"]["additional_details"], each["score_details"]) for each in results)
    return {details["player_options"]: score["score"] for details, score in facts}


def test_the_chains_of_a_run_are_those_of_its_plan(tmp_path):
    budget = sp.Budget(notes_tokens=100, prompt_tokens=900, tool_calls=6)
    arguments = {"trials": 5, "budgets": budget, "carry": "notes", "chain": 2, "executor": "inline"}
    played = sp.evaluate(["BanditTwoArmedHighLowFixed-v0"], ["random"], out=tmp_path / "run", **arguments)
    export(tmp_path / "run", tmp_path / "eee", "eee", publication=ABOUT)
    assert list(published_scores(tmp_path / "eee").values()) == [summarize(played.rows).cells[0].score.mean]
    bare = (tmp_path / "run" / "episodes").rename(tmp_path / "bare")
    with pytest.raises(sp.InvalidArgumentError, match="name the run's folder"):
        export(bare, tmp_path / "other", "eee", publication=ABOUT)


def test_every_condition_has_a_file_and_every_episode_is_counted(tmp_path):
    players = [PlayerConfig(name="first", factory=FirstMoves, options={"heat": heat}) for heat in (-1, 1)]
    sp.evaluate(["Hanoi3Disk-v0"], players, trials=2, repeats=2, executor="inline", out=tmp_path / "run")
    exported = export(tmp_path / "run", tmp_path / "hub", "hf-results", publication={"dataset": "a/b"})
    paths = sorted((tmp_path / "hub" / ".eval_results").iterdir())
    assert exported.counts["files"] == len(paths) == 2
    assert all("mean of 4 episodes" in path.read_text(encoding="utf-8") for path in paths)


def test_the_command(run, tmp_path):
    out, _ = run
    given = ["export", str(out), "--format", "eee", "--players", "rule", "--out", str(tmp_path / "out")]
    runner = CliRunner()
    assert "--model and --organization" in runner.invoke(app, given).output
    about = ["--model", "smartplay/rule", "--organization", "A laboratory"]
    assert "4 results" in runner.invoke(app, [*given, *about]).output


@pytest.mark.parametrize(
    ("name", "publication", "selection", "message"),
    [
        ("eee", ABOUT, {}, "name one with --players"),
        ("eee", {**ABOUT, "model": "rule"}, {"players": ("rule",)}, "model"),
        ("hf-results", {}, {"players": ("rule",)}, "--dataset"),
        ("sft", {"dataset": "a/b"}, {"players": ("rule",)}, "only eee and hf-results say whose results they hold"),
    ],
)
def test_what_is_missing_is_said(run, tmp_path, name, publication, selection, message):
    with pytest.raises(sp.InvalidArgumentError, match=message):
        export(run[0], tmp_path / "out", name, publication=publication, **selection)
