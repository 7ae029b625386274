"""The endpoint's rule player in external agents, whose prompts differ from those of a window."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import openai
import pytest
import smartplay_gateway as sg
from hypothesis import given, settings, strategies as st
from starlette.testclient import TestClient

import smartplay_tools as sp
from smartplay_tools.players.conversion import function_call
from tests.adapters.window_host import openai_client

LOCAL = "http://localhost"

GAMES = {
    "Hanoi3Disk-v0": 3,
    "BanditTwoArmedHighLowFixed-v0": None,
    "RockPaperScissorBasic-v0": None,
    "MessengerL1-v0": 1,
}
"""Games, and the score that the rules reach."""

WRAPPINGS: dict[str, Callable[[str], str]] = {
    "plain": str,
    "a JSON string": json.dumps,
    "a list of parts": lambda text: json.dumps([{"type": "text", "text": text}]),
    "an MCP result": lambda text: json.dumps(
        {"content": [{"type": "text", "text": text}], "structuredContent": {"text": text, "step": 1}, "isError": False}
    ),
    "an output with a type": lambda text: json.dumps({"type": "text", "value": text}),
}


@pytest.fixture(scope="module")
def client():
    with sg.LocalEndpoint(sp.get_player("rule")) as endpoint, openai_client(endpoint) as client:
        yield client


def play_as_a_host(client, episode, wrap=str, shuffle=False, turns=60):
    """Play until the player says no more than words, keeping every message, as most agents do."""
    tools = [sp.schema(tool, "openai") for tool in episode.tools]
    messages: list[Any] = [{"role": "system", "content": "You play games."}, {"role": "user", "content": "Play."}]
    for _ in range(turns):
        reply = client.chat.completions.create(model="rule", messages=messages, tools=tools).choices[0].message
        messages.append(reply.model_dump(exclude_none=True))
        if not reply.tool_calls:
            return reply.content
        for call in reply.tool_calls:
            result = episode.call(call.function.name, call.function.arguments)
            messages.append({"role": "tool", "tool_call_id": call.id, "content": wrap(result.text)})
    return None


PLAYED = [
    *(
        pytest.param(game, "plain", marks=[pytest.mark.slow] if game.startswith(("Bandit", "RockPaper")) else [])
        for game in GAMES
    ),
    *(("Hanoi3Disk-v0", wrapping) for wrapping in WRAPPINGS),
]


@pytest.mark.parametrize(("game", "wrapping"), PLAYED)
def test_it_plays_to_the_end_and_stops_in_words(client, game, wrapping):
    with sp.Episode(game, seed=3, context="host") as episode:
        assert play_as_a_host(client, episode, WRAPPINGS[wrapping]) == "The game is over."
        assert episode.done
        assert GAMES[game] is None or episode.result.score == GAMES[game]


def tools_of(game="Hanoi3Disk-v0"):
    with sp.Episode(game, seed=1) as episode:
        return [sp.schema(tool, "openai") for tool in episode.tools]


HANOI = "- A: |bottom, [{}], top|\n- B: |bottom, [{}], top|\n- C: |bottom, [{}], top|"


def round_of(call_id, name, arguments, text):
    """A reply with a call, and its result."""
    reply = {"role": "assistant", "content": None, "tool_calls": [function_call(call_id, name, arguments)]}
    return [reply, {"role": "tool", "tool_call_id": call_id, "content": text}]


def asked(client, *messages, **options):
    """The player's next message; a text is sent as the result of `observe`."""
    sent: list[Any] = [{"role": "user", "content": "Play."}]
    for at, text in enumerate(messages):
        sent += round_of(f"c{at}", "observe", "{}", text)
    options = {"tools": tools_of(), **options}
    return client.chat.completions.create(model="rule", messages=sent, **options).choices[0].message


def called(message):
    return [call.function.name for call in message.tool_calls or ()]


def test_results_out_of_order_are_told_apart_by_their_ids(client):
    calls = [function_call("c0", "read_manual", "{}"), function_call("c1", "observe", "{}")]
    messages = [
        {"role": "user", "content": "Play."},
        {"role": "assistant", "content": None, "tool_calls": calls},
        {"role": "tool", "tool_call_id": "c1", "content": HANOI.format("2", "", "1, 0")},
        {"role": "tool", "tool_call_id": "c0", "content": HANOI.format("2, 1, 0", "", "")},
    ]
    reply = client.chat.completions.create(model="rule", messages=messages, tools=tools_of()).choices[0].message
    (call,) = reply.tool_calls
    assert "rod C to the top of rod A" in call.function.arguments


def test_requests_without_tools_are_answered_in_words(client):
    """Hosts ask for a title, or for a summary, in between."""
    messages = [{"role": "user", "content": "Give this conversation a title."}]
    reply = client.chat.completions.create(model="rule", messages=messages).choices[0].message
    assert "no tool `act`" in reply.content
    assert not called(asked(client, HANOI.format("2, 1, 0", "", ""), tools=[])), "no call without tools"
    tool = {"name": "act", "description": "1. Castle\n2. Resign", "parameters": {"type": "object"}}
    with pytest.raises(openai.BadRequestError, match="no rules for a game with the actions Castle, Resign"):
        asked(client, tools=[{"type": "function", "function": tool}])


# Tool choice.


@pytest.mark.parametrize(
    ("choice", "calls"),
    [
        ("auto", ["observe"]),
        ("required", ["observe"]),
        ("none", []),
        ({"type": "function", "function": {"name": "act"}}, ["act"]),
        ({"type": "function", "function": {"name": "read_manual"}}, ["read_manual"]),
        (
            {
                "type": "allowed_tools",
                "allowed_tools": {"mode": "auto", "tools": [{"type": "function", "function": {"name": "act"}}]},
            },
            ["act"],
        ),
    ],
    ids=str,
)
def test_tool_choice_is_honoured(client, choice, calls):
    assert called(asked(client, tool_choice=choice)) == calls


def test_tool_choice_is_honoured_by_responses(client):
    tools = [{"type": "function", **tool["function"]} for tool in tools_of()]

    def names(choice):
        response = client.responses.create(model="rule", input="Play.", tools=tools, tool_choice=choice)
        return [item.name for item in response.output if item.type == "function_call"]

    assert names("none") == []
    assert names({"type": "function", "name": "act"}) == ["act"]
    allowed = {"type": "allowed_tools", "mode": "required", "tools": [{"type": "function", "name": "read_manual"}]}
    assert names(allowed) == ["read_manual"]


def test_a_forced_tool_that_is_not_the_games_gets_plain_arguments(client):
    properties = {"answer": {"type": "string"}, "score": {"type": "integer"}, "kind": {"enum": ["won", "lost"]}}
    schema = {"type": "object", "properties": properties, "required": ["answer", "score", "kind"]}
    tool = {"type": "function", "function": {"name": "final_answer", "parameters": schema}}
    choice = {"type": "function", "function": {"name": "final_answer"}}
    (call,) = asked(client, tools=[*tools_of(), tool], tool_choice=choice).tool_calls
    assert json.loads(call.function.arguments) == {"answer": "", "score": 0, "kind": "won"}


def test_one_call_at_a_time_where_that_is_asked_for():
    two = [function_call(call_id, "observe", "{}") for call_id in ("c0", "c1")]
    script = [{"role": "assistant", "content": None, "tool_calls": two}] * 2
    app = TestClient(sg.endpoint_app(sp.ScriptedPlayer(script)), LOCAL)
    for parallel, count in ((False, 1), (True, 2)):
        body = {"model": "scripted", "messages": [{"role": "user", "content": "?"}], "tools": tools_of()}
        answer = app.post("/v1/chat/completions", json={**body, "parallel_tool_calls": parallel}).json()
        assert len(answer["choices"][0]["message"]["tool_calls"]) == count


@pytest.mark.parametrize(
    "choice",
    ["always", 7, {"type": "function", "function": {"name": "jump"}}, {"type": "custom"}, {"type": "allowed_tools"}],
    ids=str,
)
def test_a_choice_that_cannot_be_made_is_refused(client, choice):
    with pytest.raises(openai.BadRequestError, match=r"tool_choice|allowed_tools"):
        asked(client, tool_choice=choice)


@pytest.mark.parametrize("tool", [{"type": "web_search"}, {"type": "custom", "custom": {"name": "grep"}}], ids=repr)
def test_a_tool_that_is_no_function_is_refused_in_a_true_sentence(client, tool):
    with pytest.raises(openai.BadRequestError, match=f"type '{tool['type']}' cannot be counted or run here"):
        asked(client, tools=[tool])


# The length of prompts.


def test_a_prompt_can_be_too_long():
    with (
        sg.LocalEndpoint(sp.get_player("rule"), context_tokens=400) as endpoint,
        sp.get_player("openai:rule", base_url=endpoint.base_url) as player,
    ):
        with sp.Episode("Hanoi3Disk-v0", seed=3) as episode:
            result = sp.play(episode, player)
        assert result.end_reason == "host"
        assert "The model's context of 400 tokens is full; --prompt-tokens keeps" in result.detail
        with sp.Episode("Hanoi3Disk-v0", seed=3, budget=sp.Budget(prompt_tokens=400, history=0)) as episode:
            assert sp.play(episode, player).end_reason != "host", "who keeps to the limit plays"


def test_a_limit_that_would_refuse_everything_is_refused():
    with pytest.raises(sp.InvalidArgumentError, match="from 1 on"):
        sg.LocalEndpoint(sp.get_player("rule"), context_tokens=0)


# Whatever is sent.

OBSERVED = st.sampled_from(
    [
        HANOI.format("2, 1", "0", ""),
        "- A: |bottom, [1,, 2], top|",
        "Coordinate (1,2,3). Facing nowhere. - sand, 3 blocks away",
        "You took action Move North.",
        "Error: no",
        "The game is over.",
        "You see:\n- tree 3 steps to your north\nYour status:\n- health: x/9",
        '{"text": 1}',
        '[{"type": "image"}]',
        "You pulled slot machine 99, you received reward 1.",
        "MESSENGER\nYou (agent) don't have the message.\nYou see: - airplane 3 steps to your north.",
    ]
)
ROUND = st.builds(
    round_of,
    st.sampled_from(["c1", "c2"]),
    st.sampled_from(["act", "observe", "read_manual", "jump"]),
    st.sampled_from(["{}", '{"action": "1"}', "{", '{"action": 3}']),
    OBSERVED | st.text(max_size=20),
)


@pytest.fixture(scope="module")
def app():
    return TestClient(sg.endpoint_app(sp.get_player("rule"), sp.get_player("rule-notes")), LOCAL)


@pytest.mark.parametrize("content", [True, 1, [None], [[]]])
def test_an_output_item_without_text_is_refused(app, content):
    items = [{"role": "user", "content": "Play."}, {"role": "assistant", "content": content}]
    answer = app.post("/v1/responses", json={"model": "rule", "input": items})
    assert answer.status_code == 400
    assert answer.json()["error"]["param"] == "input[1]"


TOOLS = {game: tools_of(game) for game in [*GAMES, "MessengerL3-v0", "Crafter-v0", "MinedojoCreative0-v0"]}


@pytest.mark.slow
@pytest.mark.parametrize(("player", "game"), [*(("rule", game) for game in TOOLS), ("rule-notes", "Crafter-v0")])
@settings(max_examples=settings().max_examples // 5, deadline=None)
@given(rounds=st.lists(ROUND, max_size=3), system=OBSERVED | st.text(max_size=20))
def test_no_observation_makes_a_rule_player_fail(app, game, player, rounds, system):
    messages = [{"role": "system", "content": system}, {"role": "user", "content": "Play."}]
    messages += [message for both in rounds for message in both]
    answer = app.post("/v1/chat/completions", json={"model": player, "messages": messages, "tools": TOOLS[game]})
    assert answer.status_code == 200, answer.text


def test_a_body_that_is_nested_deeply_is_refused(app):
    for depth in (900, 990, 100_000):
        deep = "[" * depth + "]" * depth
        for field in ("messages", "tools", "tool_choice"):
            text = '{"model": "rule", "messages": [{"role": "user", "content": "?"}], "' + field + '": ' + deep + "}"
            assert app.post("/v1/chat/completions", content=text).status_code in (400, 404)
