"""Memory: files that the agent keeps, what each command answers, the cap, and what is on record."""

from __future__ import annotations

import json
import random
import re

import pytest

import smartplay_tools as sp
from smartplay_tools.records import resume
from tests import scripts
from tests.checker import well_formed
from tests.model_from_docs.files import Files
from tests.test_conversation import calling

RPS, BANDIT = "RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0"


BUDGET = sp.Budget(memory_tokens=27, tool_calls=None, stalled_turns=None)


@pytest.fixture
def files():
    """Calls the tool `memory` of an episode: the text of the answer, without `Error: ` in front of a refusal."""
    episode = sp.Episode(RPS, seed=1, tokenizer=scripts.Words(), budget=BUDGET)

    def call(command, **arguments):
        return episode.call("memory", {"command": command, **arguments}).text

    call.episode = episode
    return call


def test_whatever_is_called_the_answer_is_that_of_the_definition(files):
    """Conversations at random are judged as well, but meet few of the commands' errors."""
    chance, judge, kinds = random.Random(3), Files(27, scripts.Words().count), set()
    for _ in range(800):
        _, sent = scripts.memory_call(chance)
        result, (text, kind) = files.episode.call("memory", sent), judge.call(json.loads(sent))
        assert (result.data.get("mistake", ""), result.is_error) == (kind, kind != ""), sent
        assert text is None or result.text == well_formed(text)
        kinds |= {kind or "answered", *([re.sub("/.*|[0-9]+", "", text)] if kind == "file" else [])}
    assert len(kinds) > 12, "of every kind"


@pytest.mark.parametrize(
    ("sent", "problem"),
    [
        ({}, "`command` must be one of view, create, str_replace, insert, delete, rename."),
        ({"command": "read", "path": "/memories"}, "`command` must be one of"),
        ({"command": "view"}, "The command view needs `path`."),
        ({"command": "create", "path": "/memories/a", "file_text": None}, "The command create needs `file_text`."),
        ({"command": "rename", "old_path": "/memories/a"}, "The command rename needs `new_path`."),
        ({"command": "delete", "path": "/memories/a", "old_str": "x"}, "The command delete takes `path` only."),
        ({"command": "view", "path": 5}, "`path` must be a string."),
        ({"command": "view", "path": "/memories", "view_range": [1]}, "`view_range` must be two integers."),
        (
            {"command": "insert", "path": "/memories/a", "insert_line": True, "insert_text": "x"},
            "`insert_line` must be an",
        ),
    ],
)
def test_arguments_that_a_command_does_not_take_are_malformed(files, sent, problem):
    result = files.episode.call("memory", sent)
    assert result.text.startswith(f"Error: {problem}")
    assert files.episode.stats.malformed_calls == 1


def test_arguments_that_are_not_needed_may_be_null(files):
    every = dict.fromkeys(["path", "view_range", "file_text", "old_str", "new_str", "insert_line", "insert_text"])
    sent = {**every, "old_path": None, "new_path": None, "command": "create", "path": "/memories/a", "file_text": ""}
    assert not files.episode.call("memory", sent).is_error
    (spec,) = [tool for tool in files.episode.tools if tool.name == "memory"]
    assert spec.parameters["required"] == list(spec.parameters["properties"])
    assert sp.schema(spec, "openai")["function"]["strict"]


def test_the_files_are_there_again_after_a_resume_and_a_refused_call_changes_nothing():
    events = []
    conversation = sp.AgentSession(
        sp.Episode(RPS, seed=1, transcript=events, budget=sp.Budget(memory_tokens=50)), player="script"
    )
    write = {"command": "create", "path": "/memories/a", "file_text": "x"}
    conversation.prompt()
    first, second = conversation.receive(
        calling(("memory", json.dumps(write)), ("memory", json.dumps({**write, "path": "/memories/b"})))
    )
    conversation.refuse(first.id, "The user said no.")
    conversation.answer(second.id)
    conversation.prompt()
    with resume(scripts.as_json(events), transcript=[], session=True) as resumed:
        assert resumed.episode.ledger.strategies.asked["memory_tokens"].files.texts == {"/memories/b": "x"}


def test_a_tool_of_a_host_with_the_same_name_stays_the_host_s():
    own = sp.ToolSpec("memory", "Mine.", {"type": "object", "properties": {}, "additionalProperties": False})
    assert sp.schema(own, "anthropic")["input_schema"] == own.parameters
    with pytest.raises(sp.InvalidArgumentError, match="rename yours"):
        sp.AgentSession(sp.Episode(RPS, seed=1, budget=sp.Budget(memory_tokens=9)), foreign_tools=[own])
