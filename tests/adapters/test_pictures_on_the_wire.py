"""Pictures on the wire: where each interface gets them, in the bytes that the real client libraries send."""

from __future__ import annotations

import base64
import hashlib

import pytest

import smartplay_tools as sp
from smartplay_tools.records import recorded_pictures

OBSERVE, NOOP = ("observe", "{}"), ("act", '{"action": "Noop"}')
SHOWN = "The picture shows the current observation."


def calling(*calls, at):
    """A reply with calls, whose ids name its turn."""
    listed = [
        {"id": f"call_{at}_{position}", "type": "function", "function": {"name": name, "arguments": arguments}}
        for position, (name, arguments) in enumerate(calls)
    ]
    return {"role": "assistant", "content": None, "tool_calls": listed}


SCRIPT = [calling(NOOP, OBSERVE, at=0), calling(("act", '{"action": "Fly"}'), at=1), calling(NOOP, at=2)]


def played(player, form, server):
    """Play the script; return the record and the last request's body."""
    events = []
    budget = sp.Budget(tool_calls=4)
    with (
        server,
        sp.Episode("Crafter-v0", seed=1, observation=form, budget=budget, transcript=events) as episode,
        player,
    ):
        sp.play(episode, player)
    return events, server.bodies[-1]


def files(events):
    """The pictures of a record, in the order of its results."""
    pictures = recorded_pictures(events)
    calls = [event["data"] for event in events if event["event"] == "call"]
    return [pictures[data["picture"]["sha256"]].png for data in calls if "picture" in data]


def unpacked(url):
    """The file in a data URL."""
    assert url.startswith("data:image/png;base64,")
    return base64.b64decode(url.removeprefix("data:image/png;base64,"))


@pytest.mark.parametrize("typed", [True, False])
def test_chat_completions_have_pictures_in_a_user_message_after_the_results(typed):
    openai_stub = pytest.importorskip("tests.adapters.openai_stub")
    server = openai_stub.OpenAIStub(SCRIPT)
    player = sp.get_player("openai:m", base_url=server.base_url, pictures=True, typed=typed)
    events, body = played(player, "picture", server)
    first, second, _ = files(events)
    roles = [message["role"] for message in body["messages"]]
    assert roles[2:] == ["assistant", "tool", "tool", "user", "assistant", "tool"]
    one, two, below = body["messages"][3:6]
    assert one["content"] == two["content"] == f"{SHOWN}\nThe picture is in the message below."
    words = [part["text"] for part in below["content"] if part["type"] == "text"]
    assert words == [f"The picture of the result of {message['tool_call_id']}:" for message in (one, two)]
    urls = [part["image_url"]["url"] for part in below["content"] if part["type"] == "image_url"]
    assert [unpacked(url) for url in urls] == [first, second]
    assert body["messages"][-1]["content"].startswith("Error: ")


def test_responses_have_pictures_inside_the_result():
    openai_stub = pytest.importorskip("tests.adapters.openai_stub")
    server = openai_stub.OpenAIStub(SCRIPT)
    player = sp.get_player("openai-responses:m", base_url=server.base_url, pictures=True)
    events, body = played(player, "both", server)
    outputs = [item["output"] for item in body["input"] if item.get("type") == "function_call_output"]
    for output, file in zip(outputs[:2], files(events), strict=False):
        text, picture = output
        assert text["type"] == "input_text"
        assert text["text"].startswith(("You took action noop.", "You see"))
        assert picture["type"] == "input_image"
        assert unpacked(picture["image_url"]) == file
    assert outputs[2].startswith("Error: ")


@pytest.mark.parametrize("cache", [True, "stable", False])
def test_messages_have_pictures_inside_the_result(cache):
    pytest.importorskip("anthropic")
    anthropic_stub = pytest.importorskip("tests.adapters.anthropic_stub")
    server = anthropic_stub.AnthropicStub(SCRIPT)
    player = sp.get_player("anthropic:m", base_url=server.url, api_key="k", cache=cache)
    events, body = played(player, "picture", server)
    results = [
        block["content"]
        for message in body["messages"]
        for block in message["content"]
        if block["type"] == "tool_result"
    ]
    for (text, picture), file in zip(results[:2], files(events), strict=False):
        assert text == {"type": "text", "text": SHOWN}
        assert picture["source"]["media_type"] == "image/png"
        assert base64.b64decode(picture["source"]["data"]) == file
    assert results[2].startswith("Error: ")


def test_a_model_that_is_not_said_to_see_is_refused_before_the_first_request():
    openai_stub = pytest.importorskip("tests.adapters.openai_stub")
    with openai_stub.OpenAIStub(SCRIPT) as server:
        player = sp.get_player("openai:m", base_url=server.base_url)
        with (
            sp.Episode("Crafter-v0", seed=1, observation="picture") as episode,
            pytest.raises(sp.InvalidArgumentError, match="has the option pictures=true"),
        ):
            sp.play(episode, player)
        assert not server.bodies


async def test_mcp_has_the_picture_as_content_of_the_result():
    mcp = pytest.importorskip("mcp")
    smartplay_mcp = pytest.importorskip("smartplay_mcp")
    from smartplay_tools.web import HostedEpisode

    episode = sp.Episode("Crafter-v0", seed=1, observation="picture", context="host")
    hosted = HostedEpisode(episode)
    with episode:
        async with mcp.Client(smartplay_mcp.game_server(lambda _: hosted)) as client:
            result = await client.call_tool("act", {"action": "Noop"})
            text, picture = result.content
            assert text.text == SHOWN
            assert (picture.type, picture.mime_type) == ("image", "image/png")
            shown = episode.call("observe").data["picture"]["sha256"]
            assert hashlib.sha256(base64.b64decode(picture.data)).hexdigest() == shown
            (refused,) = (await client.call_tool("act", {"action": "Fly"})).content
            assert refused.text.startswith("Error: ")
