"""A run that is tracked, without a tracker's client; tests/adapters/test_trackers.py has those."""

from __future__ import annotations

import importlib.util

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import UnknownNameError

GAME = "Hanoi3Disk-v0"


@pytest.mark.skipif(importlib.util.find_spec("mlflow") is not None, reason="MLflow is installed")
def test_a_client_that_is_missing_is_named_before_anything_is_played(tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match="pip install mlflow"):
        sp.evaluate([GAME], ["rule"], trials=1, executor="inline", track="mlflow", out=tmp_path / "run")
    assert not list((tmp_path / "run" / "episodes").glob("*"))


def test_an_unknown_tracker_is_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="mlflow, wandb"):
        sp.evaluate([GAME], ["rule"], trials=1, executor="inline", track="paper", out=tmp_path / "run")
