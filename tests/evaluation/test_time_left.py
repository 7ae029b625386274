"""The time left of a run, from looks at its progress with a clock of the test's."""

from __future__ import annotations

import pytest

from smartplay_tools.evaluation.run_folder.follower import RunFollower
from tests.evaluation.test_progress import half_played


def test_a_follower_estimates_from_the_records(tmp_path):
    """One episode of 51 calls is finished, the other half played; it took a second for each reply."""
    clock = [0.0]
    folder = half_played(tmp_path)
    (record,) = (folder.path / "running").iterdir()
    lines = record.read_text().splitlines(keepends=True)
    record.write_text("".join(lines[:3]))
    follower = RunFollower(folder, lambda: clock[0])
    assert follower.snapshot().seconds_left is None
    record.write_text("".join(lines))
    clock[0] = 25.0
    now = follower.snapshot()
    (playing,) = now.playing
    (finished,) = follower.results.values()
    assert now.seconds_left == pytest.approx(finished.spent.replies - playing.totals.replies, rel=0.2)
