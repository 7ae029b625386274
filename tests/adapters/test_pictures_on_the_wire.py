"""Pictures on the wire: where each interface gets them, in the bytes that the real client libraries send."""

from __future__ import annotations

import base64
from functools import partial

import pytest

import smartplay_tools as sp
from smartplay_tools.players.conversion import function_call
from smartplay_tools.records import recorded_pictures
from tests import scripts

OBSERVE, NOOP = ("observe", "{}"), ("act", '{"action": "Noop"}')
SHOWN = "The picture shows the current observation."


def calling(*calls, at):
    """A reply with calls, whose ids name its turn."""
    listed = [function_call(f"call_{at}_{position}", *call) for position, call in enumerate(calls)]
    return {"role": "assistant", "content": None, "tool_calls": listed}


SCRIPT = [calling(NOOP, OBSERVE, at=0), calling(("act", '{"action": "Fly"}'), at=1), calling(NOOP, at=2)]


BELOW = "The picture is in the message below."


def begun(form="picture"):
    """An episode of four calls, and its record."""
    events = []
    budget = sp.Budget(tool_calls=4)
    return sp.Episode("Crafter-v0", seed=1, observation=form, budget=budget, transcript=events), events


def played(player, form, server):
    """Play the script; return the record and the last request's body."""
    episode, events = begun(form)
    with server, episode, player:
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


def is_below(body, files):
    """A request of chat completions has the pictures of its first turn in a user message after the results."""
    roles = [message["role"] for message in body["messages"]]
    begin = roles.index("assistant")
    assert roles[begin:] == ["assistant", "tool", "tool", "user", "assistant", "tool"]
    one, two, below = body["messages"][begin + 1 : begin + 4]
    assert one["content"] == two["content"] == f"{SHOWN}\n{BELOW}"
    words = [part["text"] for part in below["content"] if part["type"] == "text"]
    assert words == [f"The picture of the result of {message['tool_call_id']}:" for message in (one, two)]
    assert files_below(body) == files[:2]
    assert "Error: " in str(body["messages"][-1]["content"])


def files_below(body):
    """The pictures in the user messages of a request of chat completions."""
    parts = [part for message in body["messages"] if message["role"] == "user" for part in message["content"]]
    return [unpacked(part["image_url"]["url"]) for part in parts if isinstance(part, dict) and "image_url" in part]


def is_in_outputs(body, files):
    """A request of Responses has the pictures of its first turn in its results."""
    outputs = [item["output"] for item in body["input"] if item.get("type") == "function_call_output"]
    for output, file in zip(outputs[:2], files, strict=False):
        text, picture = output
        assert text["type"] == "input_text"
        assert text["text"].startswith((SHOWN, "You took", "You see"))
        assert picture["type"] == "input_image"
        assert unpacked(picture["image_url"]) == file
    assert outputs[2].startswith("Error: ")


def is_in_results(body, files):
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


def by_openai(name, **options):
    server = pytest.importorskip("tests.adapters.openai_stub").OpenAIStub(SCRIPT)
    return server, sp.get_player(f"{name}:m", base_url=server.base_url, pictures=True, **options)


def by_anthropic(cache):
    pytest.importorskip("anthropic")
    server = pytest.importorskip("tests.adapters.anthropic_stub").AnthropicStub(SCRIPT)
    return server, sp.get_player("anthropic:m", base_url=server.url, api_key="k", cache=cache)


def by_langchains_openai(**options):
    client = pytest.importorskip("langchain_openai").ChatOpenAI
    server = pytest.importorskip("tests.adapters.openai_stub").OpenAIStub(SCRIPT)
    model = client(model="m", base_url=server.base_url, api_key="k", **options)
    return server, pytest.importorskip("smartplay_langchain").LangChainPlayer(model, pictures=True)


def by_langchains_anthropic(cache):
    client = pytest.importorskip("langchain_anthropic").ChatAnthropic
    server = pytest.importorskip("tests.adapters.anthropic_stub").AnthropicStub(SCRIPT)
    model = client(model="m", base_url=server.url, api_key="k")
    return server, pytest.importorskip("smartplay_langchain").LangChainPlayer(model, cache=cache, pictures=True)


slowly = partial(pytest.param, marks=pytest.mark.slow)
"""A client of a framework, whose library takes seconds to import."""


@pytest.mark.parametrize(
    ("ask", "form", "is_shown"),
    [
        (partial(by_openai, "openai", typed=True), "picture", is_below),
        (partial(by_openai, "openai", typed=False), "picture", is_below),
        (partial(by_openai, "openai-responses"), "both", is_in_outputs),
        slowly(by_langchains_openai, "picture", is_below),
        slowly(partial(by_langchains_openai, use_responses_api=True), "both", is_in_outputs),
        *(slowly(partial(by_anthropic, cache), "picture", is_in_results) for cache in (True, "stable", False)),
        *(
            slowly(partial(by_langchains_anthropic, cache), "picture", is_in_results)
            for cache in (True, "stable", False)
        ),
    ],
)
def test_each_client_sends_pictures_where_its_interface_takes_them(ask, form, is_shown):
    server, player = ask()
    events, body = played(player, form, server)
    is_shown(body, files(events))


@pytest.mark.slow
def test_a_langchain_agent_is_sent_the_pictures_and_keeps_words_in_its_state():
    langchain_openai = pytest.importorskip("langchain_openai")
    agents = pytest.importorskip("langchain.agents")
    openai_stub = pytest.importorskip("tests.adapters.openai_stub")
    from smartplay_langchain import SmartPlayMiddleware

    episode, events = begun()
    with openai_stub.OpenAIStub(SCRIPT) as server, episode:
        model = langchain_openai.ChatOpenAI(model="m", base_url=server.base_url, api_key="k")
        with pytest.raises(sp.InvalidArgumentError, match="pass pictures=True if the model sees them"):
            SmartPlayMiddleware(episode)
        agent = agents.create_agent(model, middleware=[SmartPlayMiddleware(episode, pictures=True)])
        state = agent.invoke({"messages": []})
    is_below(server.bodies[-1], files(events))
    assert next(message.content for message in state["messages"] if message.type == "tool") == SHOWN


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


@pytest.mark.slow
@pytest.mark.parametrize("interface", ["responses", "chat"])
async def test_the_agents_sdk_has_pictures_where_the_interface_takes_them(interface):
    agents = pytest.importorskip("agents")
    openai = pytest.importorskip("openai")
    openai_stub = pytest.importorskip("tests.adapters.openai_stub")
    from smartplay_openai.agents import SmartPlayModel

    agents.set_tracing_disabled(True)
    episode, events = begun()
    kind = agents.OpenAIResponsesModel if interface == "responses" else agents.OpenAIChatCompletionsModel
    with openai_stub.OpenAIStub(SCRIPT) as server, episode:
        http_client = openai.DefaultAsyncHttpxClient(trust_env=False, verify=False)
        async with openai.AsyncOpenAI(base_url=server.base_url, api_key="k", http_client=http_client) as client:
            model = SmartPlayModel(kind("m", client), episode, pictures=True)
            agent = agents.Agent("player", model=model, tools=model.tools)
            await agents.Runner.run(agent, [], max_turns=None, run_config=model.run_config)
    IS_SHOWN[interface](server.bodies[-1], files(events))


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


@pytest.mark.parametrize("interface", ["chat", "responses", "messages"])
def test_pydantic_ai_has_pictures_where_the_interface_takes_them(interface):
    pydantic_ai = pytest.importorskip("pydantic_ai")
    anthropic, openai = pytest.importorskip("anthropic"), pytest.importorskip("openai")
    from pydantic_ai.models.anthropic import AnthropicModel
    from pydantic_ai.models.openai import OpenAIChatModel, OpenAIResponsesModel
    from pydantic_ai.providers.anthropic import AnthropicProvider
    from pydantic_ai.providers.openai import OpenAIProvider
    from smartplay_pydantic_ai import SmartPlay

    from tests.adapters.anthropic_stub import AnthropicStub
    from tests.adapters.openai_stub import OpenAIStub

    episode, events = begun()
    with AnthropicStub(SCRIPT) if interface == "messages" else OpenAIStub(SCRIPT) as server, episode:
        if interface == "messages":
            anthropic_client = anthropic.AsyncAnthropic(base_url=server.url, api_key="k")
            model = AnthropicModel("m", provider=AnthropicProvider(anthropic_client=anthropic_client))
        else:
            openai_client = openai.AsyncOpenAI(base_url=server.base_url, api_key="k")
            kind = OpenAIChatModel if interface == "chat" else OpenAIResponsesModel
            model = kind("m", provider=OpenAIProvider(openai_client=openai_client))
        with pytest.raises(sp.InvalidArgumentError, match="pass pictures=True if the model sees them"):
            SmartPlay(episode)
        agent = pydantic_ai.Agent(model, capabilities=[SmartPlay(episode, pictures=True)])
        agent.run_sync("Play.")
    IS_SHOWN[interface](server.bodies[-1], files(events))


@pytest.mark.parametrize("interface", ["chat", "responses"])
def test_inspect_has_pictures_where_the_interface_takes_them(interface):
    inspect_ai = pytest.importorskip("inspect_ai")
    pytest.importorskip("openai")
    from inspect_ai.dataset import Sample
    from inspect_ai.model import get_model
    from smartplay_inspect import smartplay_agent

    from tests.adapters.openai_stub import OpenAIStub

    episode, events = begun()
    responses = interface == "responses"
    with OpenAIStub(SCRIPT) as server, episode:
        model = get_model("openai/m", memoize=False, base_url=server.base_url, api_key="k", responses_api=responses)
        solver = smartplay_agent(lambda state, record: episode, pictures=True)
        task = inspect_ai.Task([Sample(input="Play.")], solver=solver)
        (log,) = inspect_ai.eval(task, model=model, display="none", max_retries=0, log_dir="memory://logs")
    assert log.status == "success", log.error
    IS_SHOWN[interface](server.bodies[-1], files(events))


@pytest.mark.parametrize("interface", ["chat", slowly("responses"), slowly("messages")])
def test_the_window_endpoint_sends_its_model_the_pictures_whatever_the_host_asks_in(interface):
    """The host's agent may speak any interface and keep words only; the model is sent the window."""
    pytest.importorskip("anthropic" if interface == "messages" else "openai")
    from smartplay_gateway import WindowEndpoint

    from tests.adapters.openai_stub import OpenAIStub
    from tests.adapters.window_host import INTERFACES, client_of, play_through

    with (
        OpenAIStub(SCRIPT) as server,
        sp.get_player("openai:m", base_url=server.base_url, pictures=True) as player,
        WindowEndpoint(player) as endpoint,
        client_of(interface, endpoint) as client,
    ):
        handle = endpoint.open("Crafter-v0", seed=1, observation="picture", budget=sp.Budget(tool_calls=4))
        tools = dict(zip(("observe", "act", "read_manual"), endpoint.functions(handle), strict=True))
        play_through(INTERFACES[interface](client, endpoint.model(handle), False), tools)
        assert endpoint.result(handle).tool_calls == 4
        shown = files_below(server.bodies[-1])
    assert len(shown) == 2
    with sp.Episode("Crafter-v0", seed=1, observation="picture") as episode:
        assert shown == [episode.call(*call).picture.png for call in (NOOP, OBSERVE)]


def test_the_window_endpoint_refuses_a_model_that_is_not_said_to_see():
    pytest.importorskip("openai")
    from smartplay_gateway import WindowEndpoint

    with (
        WindowEndpoint(sp.get_player("rule")) as endpoint,
        pytest.raises(sp.InvalidArgumentError, match="rule does not play from observation"),
    ):
        endpoint.open("Crafter-v0", seed=1, observation="picture")
