"""A disk without space: one sentence, what is finished is kept, and the same command goes on."""

from __future__ import annotations

import errno
import gc

import pytest

import smartplay_tools as sp
from smartplay_tools.files.full_disk import DiskFullError
from smartplay_tools.files.lines import AppendedFile
from tests.evaluation.runs import under_way

BANDIT = "BanditTwoArmedHighLowFixed-v0"


def no_space() -> OSError:
    return OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(("executor", "workers"), [("inline", 1), ("async", 6)])
def test_a_run_on_a_full_disk_keeps_what_is_finished_and_goes_on(tmp_path, monkeypatch, caplog, executor, workers):
    """The disk is full at its 205th write; attempts that are under way then end without a word."""
    write, count = AppendedFile.write, [0]
    each = 51 * 4

    def full(self, lines):
        count[0] += 1
        if count[0] > each:
            raise no_space()
        write(self, lines)

    with monkeypatch.context() as patched:
        patched.setattr(AppendedFile, "write", full)
        with pytest.raises(DiskFullError, match=r"There is no space left for .*make room, and the same command"):
            sp.evaluate([BANDIT], ["random"], out=tmp_path, trials=6, executor=executor, workers=workers)
    gc.collect()  # asyncio complains of a lost error when its task is deleted
    assert not [record for record in caplog.records if record.name == "asyncio"]
    again = sp.evaluate([BANDIT], ["random"], out=tmp_path, trials=6, executor="inline")
    assert again.complete
    assert {failure["end_reason"] for failure in again.failures} <= {"interrupted"}
    assert all(sp.replay(again.transcript(row["key"])).identical for row in again.rows)


def test_a_file_without_an_event_is_not_an_attempt(tmp_path):
    run = sp.evaluate([BANDIT], ["random"], out=tmp_path, trials=1, executor="inline")
    under_way(tmp_path, run.rows[0]["key"], 0)
    again = sp.evaluate([BANDIT], ["random"], out=tmp_path, trials=1, executor="inline")
    assert (again.complete, again.failures) == (True, [])
