"""Experiment trackers with their own clients, which keep everything on this machine: a database and an offline run.

`.ci/run` has an environment with them.
"""

from __future__ import annotations

import json
import struct

import pytest

pytest.importorskip("mlflow", reason="needs mlflow and wandb; `.ci/run` has an environment with them")
pytest.importorskip("wandb")

from mlflow import MlflowClient
from typer.testing import CliRunner
from wandb.proto import wandb_internal_pb2

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.analysis.summary import summarize

pytestmark = pytest.mark.filterwarnings("ignore")
GAME = "Hanoi3Disk-v0"


@pytest.fixture
def client(tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'mlflow.db'}")
    return MlflowClient()


def test_mlflow_has_every_episode_and_the_means(client, tmp_path):
    options = {"budgets": sp.Budget(prompt_tokens=700), "executor": "inline", "out": tmp_path / "run"}
    sp.evaluate([GAME], ["rule", "random"], trials=2, track="mlflow", **options)
    run = sp.evaluate([GAME], ["rule", "random"], trials=2, track="mlflow", **options)  # all of it is there already
    experiment = client.get_experiment_by_name("smartplay-tools")
    tracked = client.search_runs([experiment.experiment_id])
    assert [each.info.status for each in tracked] == ["FINISHED", "FINISHED"]
    for each in tracked:
        assert each.data.params["players"] == "rule, random"
        for cell in summarize(run.rows).cells:
            name = f"{GAME}/{cell.cell.player}/prompts max 700"
            points = client.get_metric_history(each.info.run_id, f"{name}/score")
            played = [row["score"] for row in run.rows if row["player"] == cell.cell.player]
            assert [(point.step, point.value) for point in points] == list(enumerate(played, start=1))
            assert each.data.metrics[f"{name}/score_mean"] == cell.score.mean
            assert each.data.metrics[f"{name}/score_low"] == pytest.approx(cell.score.low)


def test_weights_and_biases_offline(tmp_path, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_DIR", str(tmp_path))
    given = ["eval", "--games", GAME, "--players", "rule", "--trials", "2", "--executor", "inline", "--quiet"]
    shown = CliRunner().invoke(app, [*given, "--track", "wandb", "--out", str(tmp_path / "run")])
    assert shown.exit_code == 0, shown.output
    (written,) = (tmp_path / "wandb").glob("offline-run-*/*.wandb")
    history, summary = [], {}
    for record in records(written):
        if record.WhichOneof("record_type") == "history":
            history.append({key(item): json.loads(item.value_json) for item in record.history.item})
        elif record.WhichOneof("record_type") == "summary":
            summary |= {key(item): json.loads(item.value_json) for item in record.summary.update}
    scores = [(line[f"{GAME}/rule/episode"], line[f"{GAME}/rule/score"]) for line in history]
    assert scores == [(1, 3), (2, 3)]
    assert summary[f"{GAME}/rule/score_mean"] == 3


def records(path):
    """The records of an offline run: a log as LevelDB writes it, in blocks of 32 kB."""
    data, at, parts = path.read_bytes(), 7, b""
    while at + 7 <= len(data):
        if (left := 32768 - at % 32768) < 7:
            at += left
            continue
        _, length, kind = struct.unpack_from("<IHB", data, at)
        parts, at = parts + data[at + 7 : at + 7 + length], at + 7 + length
        if kind in (1, 4):  # a whole record, or the last part of one
            record = wandb_internal_pb2.Record()
            record.ParseFromString(parts)
            yield record
            parts = b""


def key(item):
    return item.key or "/".join(item.nested_key)


def test_a_tracker_that_cannot_begin_is_refused_before_anything_is_played(tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "nowhere://at.all")
    with pytest.raises(sp.InvalidArgumentError, match="The tracker mlflow cannot begin a run"):
        sp.evaluate([GAME], ["rule"], trials=1, executor="inline", track="mlflow", out=tmp_path / "run")
    assert not list((tmp_path / "run" / "episodes").glob("*"))


def test_a_tracker_that_fails_does_not_end_the_run(client, tmp_path):
    def drop(progress):
        if progress.episode is None:
            (tmp_path / "mlflow.db").unlink()

    with pytest.warns(UserWarning, match="nothing more of this run"):
        run = sp.evaluate(
            [GAME], ["rule"], trials=2, executor="inline", track="mlflow", out=tmp_path / "run", on_progress=drop
        )
    assert run.complete
