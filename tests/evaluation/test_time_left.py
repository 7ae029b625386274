"""The time left of a run: the estimate against the truth of simulated runs, with a clock of their own.

Each simulation plays episodes of given lengths at given speeds, some at a time. From the first tenth of its time on,
the estimate has to be right within a factor of two.
"""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass, field

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.follower import RunFollower
from smartplay_tools.evaluation.run_folder.time_left import CellWork, Growing, TimeLeft, most_replies, rest_of_tokens
from smartplay_tools.evaluation.runs.plan import make_cells
from smartplay_tools.records.spent import Spent
from tests.evaluation.test_progress import half_played


@dataclass
class Cell:
    """Episodes of these lengths, of a player that takes `seconds` for a reply."""

    lengths: list[int]
    most: int
    seconds: float = 1.0
    player: str = "openai:m"
    concurrency: int = 10_000
    begun: list[tuple[float, int]] = field(default_factory=list)

    def at(self, now: float) -> CellWork:
        """Return what is seen of it at a time."""
        finished = [length for began, length in self.begun if began + length * self.seconds <= now]
        running = [
            Growing(int((now - began) / self.seconds))
            for began, length in self.begun
            if began <= now < began + length * self.seconds
        ]
        waiting = len(self.lengths) - len(finished) - len(running)
        calls = sum(finished) + sum(one.replies for one in running)
        return CellWork(self.player, "models", self.most, waiting, finished, running, calls)


def play(cells: list[Cell], workers: int) -> float:
    """Play all episodes, the first of each cell first, `workers` at a time, and return when the last one ends."""
    waiting = [(cell, cell.lengths[0]) for cell in cells]
    waiting += [(cell, length) for cell in cells for length in cell.lengths[1:]]
    ends: list[tuple[float, int]] = []
    now, number = 0.0, 0
    running: dict[int, str] = {}
    while waiting or ends:
        while len(ends) < workers:
            busy = list(running.values())
            first = next((one for one in waiting if busy.count(one[0].player) < one[0].concurrency), None)
            if first is None:
                break
            waiting.remove(first)
            cell, length = first
            cell.begun.append((now, length))
            heapq.heappush(ends, (now + length * cell.seconds, number))
            running[number], number = cell.player, number + 1
        now, done = heapq.heappop(ends)
        del running[done]
    return now


def lengths(count: int, low: int, high: int) -> list[int]:
    draw = random.Random(count)
    return [draw.randint(low, high) for _ in range(count)]


RUNS = {
    "capped by tool_calls": ([Cell([20] * 8, 20), Cell([20] * 8, 20)], 4),
    "a player's concurrency": (
        [Cell([50] * 40, 51, player="openai:slow", concurrency=2), Cell([50] * 40, 51, 0.1, player="openai:quick")],
        64,
    ),
    "long and short games together": ([Cell([30] * 40, 31), Cell([1000] * 3, 1001)], 64),
    "one after another": ([Cell(lengths(30, 20, 60), 101)], 1),
    "many episodes of different lengths": ([Cell(lengths(400, 20, 400), 10_001)], 16),
    "a slow and a fast model": ([Cell([100] * 30, 101, 5.0, "openai:a"), Cell([100] * 30, 101, 0.5, "openai:b")], 20),
}


@pytest.mark.parametrize("name", RUNS)
def test_the_estimate_is_right_within_a_factor_of_two_after_the_first_tenth(name):
    cells, workers = RUNS[name]
    for cell in cells:
        cell.begun.clear()
    end = play(cells, workers)
    clock = [0.0]
    estimate = TimeLeft(lambda: clock[0])
    for tick in range(1000):
        clock[0] = end * tick / 1000
        left = estimate.look([cell.at(clock[0]) for cell in cells], Spent(), {})
        if 100 <= tick <= 900:
            truth = end - clock[0]
            assert left is not None
            assert truth / 2 <= left <= truth * 2, (name, tick)


def test_the_run_s_own_caps_end_it():
    clock = [0.0]
    estimate = TimeLeft(lambda: clock[0])
    cell = Cell([100] * 50, 101)
    play([cell], 1)
    assert estimate.look([cell.at(0)], Spent(), {"tokens": 10_000}) is None, "nothing is known yet"
    clock[0] = 20.0
    assert estimate.look([cell.at(20)], Spent(20, 2_000, 0), {"tokens": 10_000}) == pytest.approx(80)
    assert estimate.look([cell.at(20)], Spent(20, 2_000, 0), {"tokens": None}) == pytest.approx(50 * 101 - 20, rel=0.05)


@pytest.mark.parametrize(("growth", "most"), [(0, None), (100, None), (100, 1_500)])
def test_a_cap_on_an_episode_s_tokens_bounds_its_replies(growth, most):
    """A tenth of the prompts has been sent; how many more fit?"""
    (cell,) = make_cells(["Hanoi3Disk-v0"], ["rule"], [sp.Budget(episode_tokens=100_000, prompt_tokens=most)])
    prompts, spent = [], 0
    while spent + (prompt := min(500 + growth * len(prompts), most or 10**9)) + 20 <= 100_000:
        prompts.append(prompt)
        spent += prompt + 20
    sent = prompts[: max(2, len(prompts) // 10)]
    rest = rest_of_tokens(cell, Spent(len(sent), sum(sent), 20 * len(sent)), max(sent))
    truth = len(prompts) - len(sent)
    assert truth / 2 <= rest <= truth * 2


def test_the_longest_episode_is_that_of_the_budget():
    capped, usual = make_cells(["Crafter-v0"], ["rule"], [sp.Budget(tool_calls=20), sp.Budget()])
    assert (most_replies(capped), most_replies(usual)) == (20, 10_001)


def test_a_follower_estimates_from_the_records(tmp_path):
    """One episode of 51 calls is finished, the other half played; it took a second for each reply."""
    clock = [0.0]
    folder = half_played(tmp_path)
    (record,) = (folder.path / "running").iterdir()
    lines = record.read_text().splitlines(keepends=True)
    record.write_text("".join(lines[:3]))
    follower = RunFollower(folder, lambda: clock[0])
    assert follower.count().seconds_left is None
    record.write_text("".join(lines))
    clock[0] = 25.0
    now = follower.count()
    (playing,) = now.playing
    assert now.seconds_left == pytest.approx(
        (follower.results.popitem()[1].spent.replies - playing.totals.replies), rel=0.2
    )
