"""What each way in tells a provider for its cache: the requests that a server receives.

`test_inspect.py` has what a user of Inspect sets.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import smartplay_tools as sp
from tests.adapters.conformance import GAME, SEED
from tests.dialects.rules import DIALECTS
from tests.dialects.said import Json
from tests.dialects.scripts import act
from tests.dialects.server import INTERFACES, DialectServer
from tests.dialects.ways import WAYS, Way, chat_anthropic, chat_openai, reached

pytestmark = pytest.mark.filterwarnings("ignore")

MOVES = [act(at, "") for at in range(3)]
MINE: Json = {"prompt_cache_key": "mine"}
NO_MARKS: list[list[int]] = [[], [], []]
BEFORE: list[list[int]] = [[], [0], [1]]
"""What stood in the prompt before: the task, then a result more each time."""
BOTH_ENDS = [[0], [0, 1], [1, 2]]


def at(provider: str, model: str, play: Any, budget: sp.Budget | None = None) -> tuple[list[Json], str]:
    """The requests of an episode at a provider's server, and the episode's key."""
    episode = sp.Episode(GAME, seed=SEED, budget=budget or sp.Budget(tool_calls=3))
    with reached(DialectServer(replace(DIALECTS[provider], model=model), MOVES)) as server, episode:
        play(server, episode)
    return server.requests, episode.config.key


def by(way: Way, **options: Any) -> Any:
    return lambda server, episode: way.play(server, episode, False, **options)


def ways(*interfaces: str) -> Any:
    """The ways in whose prompts are those of an episode, and whose options have `cache`."""
    no_key = ("serve openai", "Inspect AI", "verifiers")
    found = [way for way in WAYS.values() if way.interface in interfaces and way.name not in no_key]
    fast = ("openai:", "openai-responses:")
    marked = [pytest.param(way, id=way.name, marks=() if way.name in fast else pytest.mark.slow) for way in found]
    return pytest.mark.parametrize("way", marked)


@ways("messages")
def test_anthropic_has_the_ends_of_a_prompt_and_of_what_stood_before_marked(way):
    way.skip_if_missing()
    turns = []
    for options, places in (({"cache": False}, NO_MARKS), ({}, BOTH_ENDS), ({"cache": "stable"}, BEFORE)):
        bodies, _ = at("Anthropic", "claude-opus-5", by(way, **options))
        assert [marks(body) for body in bodies] == places
        turns.append([*map(read, bodies)])
    assert turns == [turns[0]] * 3, "nothing else is changed"


@ways("chat", "responses")
def test_openai_is_told_which_prompts_belong_together_and_what_is_stable(way):
    way.skip_if_missing()
    provider, turns = "OpenAI" if way.interface == "chat" else "OpenAI Responses", []
    for model, options, has_key, places in (
        ("gpt-5.6", {"cache": False}, False, NO_MARKS),
        ("gpt-5.6", {}, True, BEFORE),
        ("gpt-5.5", {}, True, NO_MARKS),
    ):
        bodies, key = at(provider, model, by(way, **options))
        assert {body.get("prompt_cache_key") for body in bodies} == {key if has_key else None}
        assert [marks(body) for body in bodies] == places
        turns.append([*map(read, bodies)])
    assert turns == [turns[0]] * 3, "nothing else is changed"


def marks(body: Json) -> list[int]:
    """After how many results each mark stands."""
    found, results = [], 0
    for item in body.get("messages") or body["input"]:
        results += item.get("role") == "tool" or item.get("type") == "function_call_output"
        for part in item["content"] if isinstance(item.get("content"), list) else [item]:
            results += part.get("type") == "tool_result"
            found += [results] if "cache_control" in part or "prompt_cache_breakpoint" in str(part) else []
    return found


def read(body: Json) -> list[Any]:
    """The turns of a request, without marks."""
    interface = "responses" if "input" in body else "messages" if "system" in body else "chat"
    return [(turn.role, turn.words, turn.calls, turn.results) for turn in INTERFACES[interface][1](body)]


@ways("chat")
def test_other_servers_are_told_nothing_of_caches(way):
    way.skip_if_missing()
    bodies, _ = at("vLLM", "gpt-5.6", by(way))
    assert [("prompt_cache_key" in body, marks(body)) for body in bodies] == [(False, [])] * 3


def of_langchain(server: DialectServer, episode: sp.Episode) -> None:
    WAYS["langchain: (ChatOpenAI)"].skip_if_missing()
    from smartplay_langchain import LangChainPlayer

    with chat_openai(server, False) as chat:
        sp.play(episode, LangChainPlayer(chat.model_copy(update={"model_kwargs": MINE})))


def of_the_agents_sdk(server: DialectServer, episode: sp.Episode) -> None:
    agents = pytest.importorskip("agents")
    WAYS["Agents SDK (chat)"].play(server, episode, False, settings=agents.ModelSettings(extra_args=MINE))


@pytest.mark.parametrize(
    "play",
    [
        by(WAYS["openai:"], parameters=MINE),
        *(pytest.param(play, marks=pytest.mark.slow) for play in (of_langchain, of_the_agents_sdk)),
    ],
)
def test_a_key_of_the_users_own_stays(play):
    bodies, _ = at("OpenAI", "gpt-5.5", play)
    assert {body["prompt_cache_key"] for body in bodies} == {"mine"}


@pytest.mark.slow
def test_langchains_own_middleware_for_anthropics_cache_is_not_added_to():
    agents = pytest.importorskip("langchain.agents")
    own = pytest.importorskip("langchain_anthropic.middleware").AnthropicPromptCachingMiddleware(ttl="1h")
    from smartplay_langchain import SmartPlayMiddleware

    def play(server: DialectServer, episode: sp.Episode) -> None:
        with chat_anthropic(server, False) as chat:
            agents.create_agent(chat, middleware=[own, SmartPlayMiddleware(episode)]).invoke({"messages": []})

    bodies, _ = at("Anthropic", "claude-opus-5", play)
    assert [marks(body) for body in bodies] == NO_MARKS
    assert all(body["cache_control"] == {"type": "ephemeral", "ttl": "1h"} for body in bodies)


@pytest.mark.slow
def test_a_window_that_slides_keeps_its_head_marked():
    way = WAYS["anthropic:"]
    way.skip_if_missing()
    budget = sp.Budget(tool_calls=4, history=0, prompt_tokens=700)
    bodies, _ = at("Anthropic", "claude-opus-5", by(way, cache="stable"), budget)
    assert [marks(body) for body in bodies[2:]] == [[0], [0]]
