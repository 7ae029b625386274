"""Work that several processes share: all of it is done, in whichever of them, also if they do not live to its end."""

from __future__ import annotations

import functools
import os
import time

import pytest

from smartplay_tools.evaluation.processes import Lost, ProcessPool, parallel_map, worth


def square(number: int) -> int:
    return number**2


def dies_elsewhere(number: int, *, home: int) -> tuple[int, int]:
    """Return the number with the process; slow in the first process, so that others begin, which die."""
    if os.getpid() != home:
        os._exit(1)
    time.sleep(0.02)
    return number, home


def refuse(number: int) -> int:
    raise ValueError(f"not {number}")


@pytest.mark.parametrize(
    ("processes", "count"),
    [
        *((1, count) for count in (0, 7, 3000)),
        *(pytest.param(*both, marks=pytest.mark.slow) for both in ((3, 1), (2, 3000))),
    ],
)
def test_every_item_is_done_once(processes, count):
    assert sorted(parallel_map(square, range(count), processes)) == [number**2 for number in range(count)]


@pytest.mark.slow
def test_when_the_other_processes_die_this_one_does_their_work():
    done = sorted(parallel_map(functools.partial(dies_elsewhere, home=os.getpid()), range(200), 3))
    assert done == [(number, os.getpid()) for number in range(200)]


@pytest.mark.parametrize("processes", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_an_error_of_the_work_is_raised(processes):
    with pytest.raises(ValueError, match=r"not [0-4]"):
        list(parallel_map(refuse, range(5), processes))


def dies_at(number: int, *, fatal: int) -> int:
    if number == fatal:
        os._exit(3)
    return number


@pytest.mark.slow
def test_a_worker_that_dies_takes_only_its_job_with_it():
    numbers = iter(range(6))
    with ProcessPool(functools.partial(dies_at, fatal=2), 2) as pool:
        done = dict(pool.run(lambda: next(numbers, None)))
    assert done == {number: number for number in range(6)} | {2: Lost("its process ended with code 3")}


def test_few_bytes_are_not_worth_a_process(tmp_path):
    record = tmp_path / "record"
    record.write_bytes(b"x" * 1000)
    assert worth(4, [record] * 3, 1000) == 3
    assert worth(2, [record] * 3, 1000) == 2
    assert worth(4, [record] * 3, 1001) == 2
    assert worth(4, [record], 5000) == 1
    assert worth(4, [tmp_path / "moved", record], 500) == 2
