"""The window endpoint: which call of the model's a host runs, repeats or changes, and whose tool it is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest
from smartplay_gateway import WindowEndpoint

import smartplay_tools as sp
from tests.adapters.conformance import WAY, act, calling, move
from tests.adapters.test_window_endpoint import BY_CLIENT, ask
from tests.adapters.window_host import INTERFACES, TOOLS, WORDS, HostAgent, client_of, play_through, scripted

GAME = "Hanoi3Disk-v0"
MOVES = [calling(act(short)) for short in WAY]


def of_the_game(episode: sp.Episode, events: list[Any]) -> list[tuple[int, str, str | None]]:
    """The calls on record: their turns, actions, and what the host did to them; the record replays."""
    episode.close()
    assert sp.replay(events).identical
    calls = [event for event in events if event["event"] == "call"]
    return [(event["turn"], json.loads(event["arguments"])["action"], event.get("host")) for event in calls]


@contextmanager
def hosted(*replies: sp.Message) -> Iterator[tuple[HostAgent, sp.ScriptedPlayer, sp.Episode, list[Any]]]:
    """A host at an endpoint whose model says these replies, the model, the episode, and its record."""
    endpoint, player = scripted(*replies)
    with endpoint, sp.Episode(GAME, seed=7, transcript=(events := [])) as episode:
        yield HostAgent(endpoint, endpoint.serve(episode)), player, episode, events


class TestCopies:
    """A call that was answered gets its answer again, however late."""

    @pytest.mark.parametrize("key", ["k", None], ids=["with a key", "without a key"])
    def test_one_that_comes_after_the_next_reply_plays_nothing(self, key):
        with hosted(*MOVES) as (host, _, episode, events):
            first = host.answer(host.post(), key=key)
            host.messages.append(host.post())
            assert host.run(*act(WAY[0]), key=key) == first
            assert of_the_game(episode, events) == [(0, move(WAY[0]), None)]

    def test_a_key_is_known_after_a_restart(self, tmp_path):
        endpoint, _ = scripted(*MOVES, folder=tmp_path)
        with endpoint:
            host = HostAgent(endpoint, handle := endpoint.open(GAME, seed=7))
            first = host.answer(host.post(), key="k")
        again, _ = scripted(*MOVES[1:], folder=tmp_path)
        with again:
            later = HostAgent(again, handle)
            later.messages = host.messages
            later.post()
            assert later.run(*act(WAY[0]), key="k") == first
            assert again.close(handle).steps == 1
        endpoint.close(handle)  # the file


class TestEdits:
    """What was played cannot be changed, which is said in the interface's own form."""

    @pytest.mark.parametrize("key", ["k", None], ids=["with a key", "without a key"])
    def test_of_a_call_that_was_run_before(self, key):
        with hosted(calling(act(WAY[0]), act(WAY[1]))) as (host, _, episode, events):
            host.post()
            host.run(*act(WAY[1]), key="later")  # which plays the first
            changed = host.run("act", {"action": "Fly"}, key="later" if key else None)
            assert "another call" in changed if key else "cannot be changed" in changed
            assert "cannot" not in host.run(*act(WAY[0]))
            assert of_the_game(episode, events) == [(0, move(short), None) for short in WAY[:2]]

    @pytest.mark.parametrize("changed", ["arguments", "name"])
    @pytest.mark.parametrize("interface", BY_CLIENT)
    def test_in_the_hosts_own_messages(self, interface, changed):
        endpoint, player = scripted(*MOVES)
        with endpoint, client_of(interface, endpoint) as client:
            handle = endpoint.open(GAME, seed=7)
            asks = INTERFACES[interface](client, endpoint.model(handle), False)
            first = asks.ask([*asks.begin], TOOLS)
            ((call_id, name, arguments),) = first.calls
            text = HostAgent(endpoint, handle).run(name, arguments)
            (kept,) = json.loads(json.dumps(first.items, default=lambda block: block.model_dump()))
            function = kept["tool_calls"][0]["function"] if interface == "chat" else kept
            function = kept["content"][-1] if interface == "messages" else function
            was = dict(function)
            field = "name" if changed == "name" else "input" if interface == "messages" else "arguments"
            function[field] = "observe" if changed == "name" else {"action": "Fly"}
            if field == "arguments":
                function[field] = json.dumps(function[field])
            results = asks.results([(call_id, text)])
            with pytest.raises(Exception, match="has been played") as refused:
                asks.ask([*asks.begin, kept, *results], TOOLS)
            assert refused.value.status_code == 400
            function |= was
            assert asks.ask([*asks.begin, kept, *results], TOOLS).calls
        assert len(player.prompts) == 2

    def test_of_a_text_into_its_number_is_none(self):
        """Clients print the arguments again: spaces, the order of keys, and numbers as they are or as text."""
        with hosted(calling(("act", {"action": "1"}), act(WAY[0])), calling(act(WAY[1]))) as (host, _, _, events):
            message = host.post()
            host.run(*act(WAY[0]))  # which plays the first
            host.run("act", {"action": 1})
            for call in message["tool_calls"]:
                call["function"]["arguments"] = call["function"]["arguments"].replace('"1"', " 1 ")
                host.messages.append({"role": "tool", "tool_call_id": call["id"], "content": "..."})
            host.messages.insert(len(WORDS), message)
            assert host.post()
        assert [event.get("host") for event in events if event["event"] == "call"] == [None, None]

    def test_before_it_is_played_goes_back_as_the_host_had_it(self):
        with hosted(calling(act(WAY[0])), *MOVES[1:]) as (host, player, episode, events):
            message = host.post()
            message["tool_calls"][0]["function"]["arguments"] = json.dumps(act("A->B")[1])
            host.answer(message)
            host.post()
            assert of_the_game(episode, events) == [(0, move("A->B"), "edited")]
        assert len(player.prompts) == 2


ONE_CALL: dict[str, Any] = {
    "chat": {"parallel_tool_calls": False},
    "responses": {"parallel_tool_calls": False},
    "messages": {"tool_choice": {"type": "auto", "disable_parallel_tool_use": True}},
}
"""How each interface asks for one call at a time."""


class TestOneAtATime:
    """A host that takes one call at a time gets those of a message one by one."""

    @pytest.mark.parametrize("interface", BY_CLIENT)
    def test_as_the_model_sent_them(self, interface):
        script = [
            calling(*map(act, WAY[:3]), say="Three."),
            calling(("jump", {}), act(WAY[3]), ("act", {}), act(WAY[4])),
            calling(*map(act, [*WAY[5:], WAY[0]])),
        ]
        asked = []
        player = sp.ScriptedPlayer(script)
        episode = sp.Episode(GAME, seed=7, transcript=(events := []))
        with WindowEndpoint(player) as endpoint, client_of(interface, endpoint) as client, episode:
            host = HostAgent(endpoint, handle := endpoint.serve(episode))
            asks = INTERFACES[interface](client, endpoint.model(handle), False)
            once = asks.ask

            def ask(*given: Any, **extra: Any) -> Any:
                asked.append(once(*given, **extra))
                return asked[-1]

            asks.ask = ask  # type: ignore[method-assign]
            tools = {name: partial(host.run_named, name) for name in ("observe", "act", "read_manual")}
            _, usage = play_through(asks, tools, **ONE_CALL[interface])
            assert "parallel_tool_calls" not in endpoint.ignored(handle)
        assert [len(answer.calls) for answer in asked] == [1] * 8 + [0]
        assert usage.prompt == episode.result.tokens.prompt
        calls = [(event["position"], event.get("host")) for event in events if event["event"] == "call"]
        assert calls == [(at, None) for count in (3, 4, 3) for at in range(count)]
        with sp.Episode(GAME, seed=7) as alone:
            assert episode.result == sp.play(alone, sp.ScriptedPlayer(script))

    def test_and_what_it_refuses_is_refused_in_its_place(self):
        with hosted(calling(act(WAY[0]), ("observe", {})), *MOVES) as (host, player, _, events):
            for text in ("My user said no.", None):
                host.messages.append(message := host.post(host.request(parallel_tool_calls=False)))
                (call,) = message["tool_calls"]
                said = text or host.run("observe", {})
                host.messages.append({"role": "tool", "tool_call_id": call["id"], "content": said})
            host.post()
        assert [event.get("host") for event in events if event["event"] == "call"] == ["refused", None]
        assert [message["content"] for message in player.prompts[1].messages[-2:]] == ["My user said no.", said]


def named(name: str, description: str = "Something of the host's.") -> Any:
    parameters = {"type": "object", "properties": {"where": {"type": "string"}}}
    function = {"name": name, "description": description, "parameters": parameters}
    return {"type": "function", "function": function}


def prefixed(tools: list[Any]) -> list[Any]:
    """The game's tools as MCP clients name them."""
    return [
        {**tool, "function": {**tool["function"], "name": f"mcp__it__{tool['function']['name']}"}} for tool in tools
    ]


class TestNames:
    """A tool of the host's own may have the name of one of the game's."""

    @pytest.mark.parametrize("first", [True, False], ids=["before the game's", "after the game's"])
    def test_it_is_shown_under_another(self, first):
        endpoint, player = scripted(calling(act(WAY[0]), ("host_act", {"where": "x"})), calling(act(WAY[1])))
        game = prefixed(TOOLS)
        with endpoint, sp.Episode(GAME, seed=7, transcript=(events := [])) as episode:
            tools = [named("act"), *game] if first else [*game, named("act")]
            host = HostAgent(endpoint, endpoint.serve(episode), tools=tools)
            host.messages.append(message := host.post())
            ours, theirs = message["tool_calls"]
            assert [ours["function"]["name"], theirs["function"]["name"]] == ["mcp__it__act", "act"]
            text = host.run(*act(WAY[0]))
            host.messages.append({"role": "tool", "tool_call_id": theirs["id"], "content": "Theirs."})
            host.messages.append({"role": "tool", "tool_call_id": ours["id"], "content": text})
            host.post()
            assert of_the_game(episode, events) == [(0, move(WAY[0]), None)]
        assert [tool.name for tool in player.prompts[0].tools] == ["observe", "act", "read_manual", "host_act"]
        assert [message["content"] for message in player.prompts[1].messages[-2:]] == [text, "Theirs."]

    @pytest.mark.parametrize("interface", BY_CLIENT)
    def test_two_tools_with_one_name_are_refused(self, interface):
        endpoint, player = scripted(*MOVES)
        with endpoint, client_of(interface, endpoint) as client:
            asks = INTERFACES[interface](client, endpoint.model(endpoint.open(GAME, seed=7)), False)
            with pytest.raises(Exception, match="Two tools have the name weather; rename yours"):
                asks.ask([*asks.begin], [*TOOLS, named("weather"), named("weather")])
        assert not player.prompts


@pytest.mark.parametrize(
    ("field", "is_told"), [("store", False), ("enable_thinking", True), ("include_reasoning", True), ("stream", False)]
)
def test_a_field_that_is_false_is_a_wish_unless_that_is_usual(field, is_told):
    endpoint, _ = scripted(*MOVES)
    with endpoint:
        host = HostAgent(endpoint, endpoint.open(GAME, seed=7))
        answer = ask(host, **{field: False})
    assert (field in answer.headers["x-smartplay-ignored"]) == is_told
