"""An agent goes on after its process has died: the graph from a checkpoint on disk, the episode from its record."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("langgraph.checkpoint.sqlite", reason="needs langgraph-checkpoint-sqlite")

import smartplay_tools as sp

pytestmark = pytest.mark.slow

AGENT = """
import json
import os
import sys
from pathlib import Path

from langchain.agents import create_agent
from langchain.agents.middleware import wrap_model_call, wrap_tool_call
from langchain_core.messages import ToolMessage
from langgraph.checkpoint.sqlite import SqliteSaver
from smartplay_langchain import PlayerChatModel, SmartPlayMiddleware

import smartplay_tools as sp

where, left, record = sys.argv[1], [int(sys.argv[2])], Path("episode.jsonl")


def die(place):
    left[0] -= place == where
    if place == where and left[0] == 0:
        os._exit(9)  # nothing is closed and nothing flushed


@wrap_model_call
def around_model(request, handler):
    response = handler(request)
    die("after a reply")
    return response


@wrap_tool_call
def around_tool(request, handler):
    die("before a call")
    result = handler(request)
    die("after a call")
    return result


is_new = not record.exists()
opened = sp.Episode("Hanoi3Disk-v0", seed=7, transcript=record) if is_new else sp.resume(record, session=True)
with opened, SqliteSaver.from_conn_string("checkpoints.sqlite") as saver:
    play = SmartPlayMiddleware(opened if is_new else opened.conversation)
    model = PlayerChatModel(player=sp.get_player("rule"))
    agent = create_agent(model, middleware=[around_model, around_tool, play], checkpointer=saver)
    thread = {"configurable": {"thread_id": "1"}}
    state = agent.invoke({"messages": []} if is_new else None, thread, durability="sync")
    print(json.dumps({
        "asked": [call["id"] for message in state["messages"] for call in getattr(message, "tool_calls", ())],
        "answered": [message.tool_call_id for message in state["messages"] if isinstance(message, ToolMessage)],
    }))
"""


@pytest.mark.parametrize("where", ["after a reply", "before a call", "after a call"])
def test_a_new_process_goes_on_from_a_checkpoint_on_disk(where, tmp_path):
    (tmp_path / "agent.py").write_text(AGENT, encoding="utf-8")

    def run(times: int) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "agent.py", where, str(times)]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)

    assert run(times=3).returncode == 9
    interrupted = events_of(tmp_path / "episode.jsonl")
    assert not [event for event in interrupted if event["event"] == "end"]

    done = run(times=0)
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed["answered"] == printed["asked"], "the state has every call and its result once"

    events = events_of(tmp_path / "episode.jsonl")
    assert events[: len(interrupted)] == interrupted, "the record went on where it was"
    assert sp.replay(events).identical
    with sp.Episode("Hanoi3Disk-v0", seed=7) as episode:
        expected = sp.play(episode, sp.get_player("rule"))
    result = events[-1]["result"]
    whole = ("score", "turns", "steps", "end_reason")
    assert {name: result[name] for name in whole} == {name: getattr(expected, name) for name in whole}


def events_of(record: Path) -> list[dict]:
    return list(map(json.loads, record.read_text(encoding="utf-8").splitlines()))
