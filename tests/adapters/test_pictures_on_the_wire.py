"""Pictures on the wire: where each interface gets them, in the bytes that the real client libraries send."""

from __future__ import annotations

import base64
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.records import recorded_pictures
from tests import scripts
from tests.dialects.rules import DIALECTS
from tests.dialects.said import Json, Said
from tests.dialects.server import DialectServer
from tests.dialects.ways import WAYS, Way, reached

pytestmark = pytest.mark.filterwarnings("ignore")

OBSERVE, NOOP = ("observe", "{}"), ("act", '{"action": "Noop"}')
SCRIPT = [Said(calls=(NOOP, OBSERVE)), Said(calls=(("act", '{"action": "Fly"}'),)), Said(calls=(NOOP,))]
SERVERS = {"chat": "OpenAI", "responses": "OpenAI Responses", "messages": "Anthropic"}
SHOWN = "The picture shows the current observation."


def begun(**options: Any) -> tuple[sp.Episode, list[Any]]:
    """An episode of four calls, and its record."""
    events: list[Any] = []
    given = {"observation": "picture", "budget": sp.Budget(tool_calls=4), **options}
    return sp.Episode("Crafter-v0", seed=1, transcript=events, **given), events


def server_of(way: Way) -> DialectServer:
    return DialectServer(DIALECTS[SERVERS[way.interface]], SCRIPT)


def files(events: list[Any]) -> list[bytes]:
    """The pictures of a record, in the order of its results."""
    pictures = recorded_pictures(events)
    calls = [event["data"] for event in events if event["event"] == "call"]
    return [pictures[data["picture"]["sha256"]].png for data in calls if "picture" in data]


def unpacked(url: str) -> bytes:
    """The file in a data URL."""
    assert url.startswith("data:image/png;base64,")
    return base64.b64decode(url.removeprefix("data:image/png;base64,"))


def is_below(body: Json, files: list[bytes]) -> None:
    """A request of chat completions has the pictures of its first turn in a user message after the results."""
    roles = [message["role"] for message in body["messages"]]
    begin = roles.index("assistant")
    assert roles[begin:] == ["assistant", "tool", "tool", "user", "assistant", "tool"]
    one, two, below = body["messages"][begin + 1 : begin + 4]
    assert text_of(one) == text_of(two) == f"{SHOWN}\nThe picture is in the message below."
    words = [part["text"] for part in below["content"] if part["type"] == "text"]
    assert words == [f"The picture of the result of {message['tool_call_id']}:" for message in (one, two)]
    assert [unpacked(part["image_url"]["url"]) for part in below["content"] if "image_url" in part] == files[:2]
    assert "Error: " in str(body["messages"][-1]["content"])


def text_of(message: Json) -> str:
    """The text of a message, which Inspect sends as a part."""
    content = message["content"]
    return content if isinstance(content, str) else "".join(part["text"] for part in content)


def is_in_outputs(body: Json, files: list[bytes]) -> None:
    """A request of Responses has the pictures of its first turn in its results."""
    outputs = [item["output"] for item in body["input"] if item.get("type") == "function_call_output"]
    for (text, picture), file in zip(outputs[:2], files, strict=False):
        assert (text["type"], text["text"]) == ("input_text", SHOWN)
        assert picture["type"] == "input_image"
        assert unpacked(picture["image_url"]) == file
    assert outputs[2].startswith("Error: ")


def is_in_results(body: Json, files: list[bytes]) -> None:
    """A request of Anthropic's Messages has the pictures of its first turn in its results."""
    blocks = [block for message in body["messages"] for block in message["content"] if isinstance(block, dict)]
    results = [block["content"] for block in blocks if block["type"] == "tool_result"]
    for (text, picture), file in zip(results[:2], files, strict=False):
        assert text == {"type": "text", "text": SHOWN}
        assert picture["source"]["media_type"] == "image/png"
        assert base64.b64decode(picture["source"]["data"]) == file
    assert "Error: " in str(results[2])


IS_SHOWN = {"chat": is_below, "responses": is_in_outputs, "messages": is_in_results}
"""How each interface is sent the pictures."""
BLIND = ("serve openai", "verifiers")
SEES = WAYS["anthropic:"]
"""The player whose models all see pictures."""
FAST = ("openai:", "openai-responses:", "serve window")
EVERY_WAY = pytest.mark.parametrize(
    "way",
    [
        pytest.param(way, id=name, marks=() if name in FAST else pytest.mark.slow)
        for name, way in WAYS.items()
        if name not in BLIND
    ],
)


@EVERY_WAY
def test_each_client_sends_pictures_where_its_interface_takes_them(way):
    way.skip_if_missing()
    caches = [{"cache": "stable"}, {"cache": False}] if way.interface == "messages" else []
    for options in ({}, *caches):
        episode, events = begun()
        with reached(server_of(way)) as server, episode:
            way.play(server, episode, False, **({} if way is SEES else {"pictures": True}), **options)
        IS_SHOWN[way.interface](server.requests[-1], files(events))


@EVERY_WAY
def test_a_model_that_is_not_said_to_see_is_refused_before_the_first_request(way):
    way.skip_if_missing()
    if way is SEES:
        pytest.skip("its models see")
    episode, _ = begun()
    with reached(server_of(way)) as server, episode, pytest.raises(Exception, match=r"pictures=[tT]rue|does not play"):
        way.play(server, episode, False)
    assert not server.requests


@pytest.mark.slow
def test_a_langchain_agent_keeps_words_in_its_state():
    agents = pytest.importorskip("langchain.agents")
    from smartplay_langchain import PlayerChatModel, SmartPlayMiddleware

    episode, _ = begun(budget=sp.Budget(tool_calls=1))
    with episode:
        model = PlayerChatModel(player=sp.ScriptedPlayer([sp.call("observe")]), pictures=True)
        agent = agents.create_agent(model, middleware=[SmartPlayMiddleware(episode, pictures=True)])
        state = agent.invoke({"messages": []})
    assert [message.content for message in state["messages"] if message.type == "tool"] == [SHOWN]


@pytest.mark.slow
def test_langchains_tools_return_content_blocks():
    pytest.importorskip("langchain_core")
    from smartplay_langchain import SmartPlayToolkit

    episode = sp.Episode("Crafter-v0", seed=1, observation="picture", context="host")
    toolkit = SmartPlayToolkit(episode=episode, pictures=True)
    with toolkit.episode:
        act = {tool.name: tool for tool in toolkit.get_tools()}["act"]
        call = {"type": "tool_call", "id": "c", "name": "act", "args": {"action": "Noop"}}
        message = act.invoke(call)
        text, picture = message.content
        assert text == {"type": "text", "text": SHOWN}
        assert (picture["type"], picture["mime_type"]) == ("image", "image/png")
        file = base64.b64decode(picture["base64"])
        assert scripts.picture_digest(file) == message.artifact["picture"]["sha256"]
        assert message.content_blocks[1]["type"] == "image"


async def test_mcp_has_the_picture_as_content_of_the_result():
    pytest.importorskip("mcp")
    from tests.adapters.test_mcp import client_of

    episode = sp.Episode("Crafter-v0", seed=1, observation="picture", context="host")
    with episode:
        async with client_of(episode) as client:
            result = await client.call_tool("act", {"action": "Noop"})
            text, picture = result.content
            assert text.text == SHOWN
            assert (picture.type, picture.mime_type) == ("image", "image/png")
            shown = episode.call("observe").data["picture"]["sha256"]
            assert scripts.picture_digest(base64.b64decode(picture.data)) == shown
            (refused,) = (await client.call_tool("act", {"action": "Fly"})).content
            assert refused.text.startswith("Error: ")
