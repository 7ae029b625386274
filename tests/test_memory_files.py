"""Memory: files that the agent keeps, what each command answers, the cap, and what is on record."""

from __future__ import annotations

import json

import pytest

import smartplay_tools as sp
from smartplay_tools.records import resume
from tests import scripts
from tests.test_conversation import calling

RPS, BANDIT = "RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0"


@pytest.fixture
def files():
    """Calls the tool `memory` of an episode: the text of the answer, without `Error: ` in front of a refusal."""
    episode = sp.Episode(RPS, seed=1, tokenizer=scripts.Words(), budget=sp.Budget(memory_tokens=60, tool_calls=None))

    def call(command, **arguments):
        return episode.call("memory", {"command": command, **arguments}).text

    call.episode = episode
    return call


def test_a_file_is_made_seen_changed_and_deleted(files):
    assert files("create", path="/memories/plan", file_text="one\ntwo\nthree") == (
        "File created successfully at: /memories/plan"
    )
    assert files("view", path="/memories/plan") == (
        "Here's the content of /memories/plan with line numbers:\n     1\tone\n     2\ttwo\n     3\tthree"
    )
    assert files("str_replace", path="/memories/plan", old_str="two", new_str="2") == (
        "The memory file has been edited. Here is the snippet showing the change (with line numbers):\n"
        "     1\tone\n     2\t2\n     3\tthree"
    )
    assert files("insert", path="/memories/plan", insert_line=0, insert_text="zero\n") == (
        "The file /memories/plan has been edited."
    )
    assert files("rename", old_path="/memories/plan", new_path="/memories/old/plan") == (
        "Successfully renamed /memories/plan to /memories/old/plan"
    )
    assert files("view", path="/memories").splitlines()[2:] == [
        "10 tokens\t/memories/old/",
        "10 tokens\t/memories/old/plan",
    ]
    assert files("view", path="/memories/old/plan", view_range=[2, 3]).endswith(":\n     2\tone\n     3\t2")
    assert files("delete", path="/memories/old") == "Successfully deleted /memories/old"
    assert files("view", path="/memories").endswith("\n0 tokens\t/memories")


@pytest.mark.parametrize(
    ("command", "arguments", "answer"),
    [
        ("view", {"path": "/memories/x"}, "The path /memories/x does not exist. Please provide a valid path."),
        ("create", {"path": "/memories/a", "file_text": "x"}, "File /memories/a already exists"),
        ("create", {"path": "/memories/a/b", "file_text": "x"}, "The path /memories/a is not a directory."),
        ("create", {"path": "/else", "file_text": "x"}, "Path must start with /memories, got: /else"),
        ("create", {"path": "/memories/../a", "file_text": "x"}, "Path /memories/../a would escape /memories"),
        ("create", {"path": "/memories/b", "file_text": "word " * 60}, "The files would have"),
        (
            "str_replace",
            {"path": "/memories/a", "old_str": "z", "new_str": ""},
            "No replacement was performed",
        ),
        (
            "insert",
            {"path": "/memories/a", "insert_line": 3, "insert_text": "x"},
            "Invalid `insert_line` parameter",
        ),
        ("delete", {"path": "/memories"}, "Cannot delete the /memories directory itself"),
        ("rename", {"old_path": "/memories/a", "new_path": "/memories/a/b"}, "The destination /memories/a/b is below"),
    ],
)
def test_what_cannot_be_done_changes_nothing_and_is_no_malformed_call(files, command, arguments, answer):
    files("create", path="/memories/a", file_text="one\ntwo")
    before = dict(files.episode.ledger.strategies.asked["memory_tokens"].files.texts)
    assert files(command, **arguments).startswith(f"Error: {answer}")
    assert files.episode.ledger.strategies.asked["memory_tokens"].files.texts == before
    stats = files.episode.stats
    assert (stats.malformed_calls, stats.refused_memory, stats.refused_calls) == (0, answer.startswith("The files"), 0)


@pytest.mark.parametrize(
    ("sent", "problem"),
    [
        ({}, "`command` must be one of view, create, str_replace, insert, delete, rename."),
        ({"command": "read", "path": "/memories"}, "`command` must be one of"),
        ({"command": "view"}, "The command view needs `path`."),
        ({"command": "create", "path": "/memories/a", "file_text": None}, "The command create needs `file_text`."),
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


def test_the_rule_player_with_files_plays_as_in_full_context():
    def actions(**budget):
        events = []
        with sp.Episode(BANDIT, seed=3, budget=sp.Budget(history=None, **budget), transcript=events) as episode:
            sp.play(episode, sp.get_player("rule-notes", words=False))
        return [event["arguments"] for event in events if event["event"] == "call" and event["name"] == "act"]

    assert actions(prompt_tokens=1_000, memory_tokens=100) == actions()


def test_it_is_refused_where_there_is_no_window_and_changes_nothing_when_off():
    with pytest.raises(
        sp.InvalidArgumentError, match='memory_tokens needs a window over tool calls, and context="host'
    ):
        sp.Episode(RPS, seed=1, context="host", budget=sp.Budget(memory_tokens=50))
    assert sp.Budget(memory_tokens=400).describe() == "memory <= 400"
    with sp.Episode(RPS, seed=1) as episode:
        assert "memory" not in json.dumps(sp.play(episode, sp.get_player("rule")).model_dump())
    assert "memory" not in json.dumps(sp.Budget().model_dump())


def test_a_tool_of_a_host_with_the_same_name_stays_the_host_s():
    own = sp.ToolSpec("memory", "Mine.", {"type": "object", "properties": {}, "additionalProperties": False})
    assert sp.schema(own, "anthropic")["input_schema"] == own.parameters
    with pytest.raises(sp.InvalidArgumentError, match="rename yours"):
        sp.AgentSession(sp.Episode(RPS, seed=1, budget=sp.Budget(memory_tokens=9)), foreign_tools=[own])
