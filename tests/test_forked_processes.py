"""Forked processes: threads, locks and connections are their parent's, so a child makes them anew."""

from __future__ import annotations

import asyncio
import multiprocessing
import threading
from collections.abc import Callable
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import TranscriptError
from smartplay_tools.evaluation.runs.audit import audit
from smartplay_tools.threads import SerialQueue
from smartplay_tools.transcript.file import read_transcript
from tests.adapters.openai_stub import OpenAIStub
from tests.processes import needs_unix

needs_unix()
pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")

HANOI = "Hanoi3Disk-v0"


def in_a_fork(function: Callable[[], Any]) -> Any:
    """Return what a function returns in a forked process, or the sentence that it raises."""
    context = multiprocessing.get_context("fork")
    answers = context.SimpleQueue()

    def answer() -> None:
        try:
            answers.put(function())
        except sp.SmartPlayError as error:
            answers.put(str(error))

    child = context.Process(target=answer, daemon=True)
    child.start()
    child.join(30)
    if child.is_alive():
        child.kill()
        pytest.fail("the forked process does not end")
    return answers.get()


def aplay() -> float:
    with sp.Episode(HANOI, seed=1) as episode:
        return asyncio.run(sp.aplay(episode, sp.get_player("rule"))).score


def test_threads_begin_anew():
    """Here and in a child: a new episode, and one whose parent runs a call in a thread meanwhile."""
    begun, may_end = threading.Event(), threading.Event()

    async def both() -> float:
        running = asyncio.ensure_future(queue.run(lambda: begun.set() or may_end.wait(30)))
        await asyncio.to_thread(begun.wait)
        try:
            return in_a_fork(lambda: (aplay(), asyncio.run(queue.run(lambda: "run"))))
        finally:
            may_end.set()
            await running

    queue = SerialQueue()
    assert asyncio.run(both()) == (aplay(), "run")


def test_a_record_is_written_by_the_process_that_writes_first(tmp_path):
    episode = sp.Episode(HANOI, seed=1, transcript=tmp_path / "record.jsonl")
    episode.call("observe", "{}")
    assert in_a_fork(lambda: episode.call("act", '{"action": "1"}').is_error) is False
    with pytest.raises(TranscriptError, match="another program has changed it"):
        episode.call("observe", "{}")
    assert len(read_transcript(tmp_path / "record.jsonl")) == 3


def test_a_player_opens_new_connections():
    script = [{"role": "assistant", "content": f"{number}"} for number in range(3)]
    with OpenAIStub(script) as server, sp.get_player("openai:m", base_url=server.base_url) as player:
        prompt = sp.Prompt([{"role": "user", "content": "Play."}], ())

        def ask() -> str:
            return player.reply(prompt).message["content"]

        assert [ask(), in_a_fork(ask), ask()] == ["0", "1", "2"]


def test_a_daemonic_process_plays_without_further_processes(tmp_path):
    """As in a worker of `multiprocessing.Pool`: what cannot be done is told before there is a folder."""
    asked = {"games": [HANOI], "players": ["rule"], "trials": 2}
    assert 'executor="inline"' in in_a_fork(lambda: sp.evaluate(**asked, out=tmp_path / "refused"))
    assert not (tmp_path / "refused").exists()

    def play() -> list[tuple[str, ...]]:
        run = sp.evaluate(**asked, out=tmp_path / "run", executor="inline")
        return [found.differences for found in audit(run.folder, 2)]

    assert in_a_fork(play) == [(), ()]


async def test_a_call_that_raises_what_no_task_can_raise_is_answered():
    def ends() -> None:
        raise StopIteration

    queue = SerialQueue()
    with pytest.raises(RuntimeError, match="StopIteration"):
        await asyncio.wait_for(queue.run(ends), 5)
    assert await asyncio.wait_for(queue.run(lambda: 5), 5) == 5


async def test_a_cancelled_call_that_waits_is_not_run_and_other_loops_change_no_order():
    """Here: a slow function, one behind it that is cancelled, one of another loop, and one more."""
    queue, begun, may_end, done = SerialQueue(), threading.Event(), threading.Event(), list[str]()
    slow = asyncio.create_task(queue.run(lambda: begun.set() or (may_end.wait(30) and done.append("slow"))))
    await asyncio.to_thread(begun.wait)
    cancelled = asyncio.create_task(queue.run(lambda: done.append("cancelled")))
    await asyncio.sleep(0)
    cancelled.cancel()
    other = asyncio.create_task(asyncio.to_thread(lambda: asyncio.run(queue.run(lambda: done.append("other")))))
    await asyncio.sleep(0.1)
    last = asyncio.create_task(queue.run(lambda: done.append("last")))
    slow.cancel()  # the task leaves, and the function runs to its end before any other
    await asyncio.sleep(0.1)
    assert done == []
    may_end.set()
    await asyncio.gather(slow, cancelled, other, last, return_exceptions=True)
    assert done == ["slow", "other", "last"]
