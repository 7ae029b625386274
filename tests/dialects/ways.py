"""The ways in: every player and adapter as a function that plays an episode at a server to its end.

Frameworks are imported when a way is first played, so that each is tested where it is installed.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

import smartplay_tools as sp
from tests.dialects.rules import DIALECTS, Dialect, limits
from tests.dialects.server import DialectServer

Play = Callable[..., None]
"""Plays an episode at a server, with streams or without, with options of the player or of the adapter."""

QUICK = {"api_key": "k", "retries": 1, "pause": 0.01}


APART = ("inspect_ai", "pydantic_ai", "verifiers")
"""The modules of frameworks that have an environment of their own."""


@dataclass(frozen=True)
class Way:
    """A way in."""

    name: str
    interface: str
    play: Play
    streams: bool = True
    """Whether it can be told to ask for streams."""
    is_exact: bool = True
    """Whether a stream gives the record of whole replies; LangChain repairs arguments that are cut."""
    needs: str = "openai"
    """The module without which it cannot be played."""

    @property
    def is_here(self) -> bool:
        """Whether this environment plays it: one of a framework that shares none with others plays that one alone."""
        apart = [name for name in APART if find_spec(name) is not None]
        return find_spec(self.needs) is not None and (not apart or self.needs in apart)

    def skip_if_missing(self) -> None:
        """Skip a test that another environment makes."""
        if not self.is_here:
            pytest.skip(f"{self.name} is played in another environment of `.ci/run`")

    def without(self, dialect: Dialect) -> set[str]:
        """What a server does not do in a game of this way in."""
        return {name for limit in limits(self.name, dialect) for name in limit.without}


def player(server: DialectServer, stream: bool, kind: str = "openai", **options: Any) -> Any:
    """A player of the package at a server."""
    streamed = {"stream": True} if stream else {}
    return sp.get_player(f"{kind}:{server.dialect.model}", base_url=server.base_url, **QUICK, **streamed, **options)


def by_player(kind: str) -> Play:
    def play(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
        with player(server, stream, kind, **options) as model:
            sp.play(episode, model)

    return play


def at_window(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
    from smartplay_gateway import WindowEndpoint

    from tests.adapters.window_host import HostAgent

    with player(server, stream, **options) as model, WindowEndpoint(model) as endpoint:
        HostAgent(endpoint, endpoint.serve(episode)).play()


def at_endpoint(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
    from smartplay_gateway import LocalEndpoint

    with (
        player(server, stream, **options) as model,
        LocalEndpoint(model) as endpoint,
        sp.get_player(f"openai:{model.name}", base_url=endpoint.base_url, stream=stream, **QUICK) as host,
    ):
        sp.play(episode, host)


# --- LangChain and LangGraph ---------------------------------------------------------------------------------------


@contextmanager
def chat_openai(server: DialectServer, stream: bool) -> Iterator[Any]:
    from langchain_openai import ChatOpenAI
    from openai import DefaultHttpxClient

    with DefaultHttpxClient() as client:
        own = {"base_url": server.base_url, "api_key": "k", "max_retries": 0, "http_client": client}
        yield ChatOpenAI(model=server.dialect.model, streaming=stream, **own)


@contextmanager
def chat_anthropic(server: DialectServer, stream: bool) -> Iterator[Any]:
    from langchain_anthropic import ChatAnthropic

    own = {"base_url": server.base_url, "api_key": "k", "max_retries": 0, "anthropic_proxy": server.url}
    yield ChatAnthropic(model_name=server.dialect.model, streaming=stream, **own)


Model = Callable[[DialectServer, bool], AbstractContextManager[Any]]


def by_langchain_player(model: Model) -> Play:
    def play(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
        from smartplay_langchain import LangChainPlayer

        with model(server, stream) as chat, LangChainPlayer(chat, retries=1, pause=0.01, **options) as langchain:
            sp.play(episode, langchain)

    return play


def by_middleware(model: Model) -> Play:
    def play(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
        from langchain.agents import create_agent
        from smartplay_langchain import SmartPlayMiddleware

        with model(server, stream) as chat:
            create_agent(chat, middleware=[SmartPlayMiddleware(episode, **options)]).invoke({"messages": []})

    return play


def by_graph(model: Model) -> Play:
    def play(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
        from smartplay_langchain import GraphSession

        from tests.adapters.scripted_langchain import playing_graph

        session = GraphSession(episode, **options)
        with model(server, stream) as chat:
            graph = playing_graph(session, lambda state: {"messages": session.ask(chat, state["messages"])})
            graph.invoke({"messages": []}, {"recursion_limit": 200})

    return play


# --- Other frameworks ----------------------------------------------------------------------------------------------


def by_agents_sdk(model: str) -> Play:
    def play(server: DialectServer, episode: sp.Episode, stream: bool, settings: Any = None, **options: Any) -> None:
        import agents
        from openai import AsyncOpenAI
        from smartplay_openai.agents import SmartPlayModel

        agents.set_tracing_disabled(True)

        async def run() -> None:
            async with AsyncOpenAI(base_url=server.base_url, api_key="k", max_retries=0) as client:
                kept = {"should_replay_reasoning_content": lambda context: True} if "Chat" in model else {}
                inner = getattr(agents, model)(server.dialect.model, client, **kept)
                plays = SmartPlayModel(inner, episode, **options)
                own = {} if settings is None else {"model_settings": settings}
                agent = agents.Agent("player", model=plays, tools=plays.tools, **own)
                if not stream:
                    await agents.Runner.run(agent, [], max_turns=None, run_config=plays.run_config)
                    return
                running = agents.Runner.run_streamed(agent, [], max_turns=None, run_config=plays.run_config)
                async for _ in running.stream_events():
                    pass

        asyncio.run(run())

    return play


def by_pydantic_ai(interface: str) -> Play:
    def play(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
        from pydantic_ai import Agent
        from pydantic_ai.models.anthropic import AnthropicModel
        from pydantic_ai.models.openai import OpenAIChatModel, OpenAIResponsesModel
        from pydantic_ai.providers.anthropic import AnthropicProvider
        from pydantic_ai.providers.openai import OpenAIProvider
        from pydantic_ai.usage import UsageLimits
        from smartplay_pydantic_ai import SmartPlay

        provider = AnthropicProvider if interface == "messages" else OpenAIProvider
        model = {"chat": OpenAIChatModel, "responses": OpenAIResponsesModel, "messages": AnthropicModel}[interface]
        agent = Agent(
            model(server.dialect.model, provider=provider(base_url=server.base_url, api_key="k")),
            capabilities=[SmartPlay(episode, **options)],
        )

        async def run() -> None:
            await agent.run("Play.", usage_limits=UsageLimits(request_limit=None))

        asyncio.run(run())

    return play


def by_inspect(server: DialectServer, episode: sp.Episode, stream: bool, **options: Any) -> None:
    from inspect_ai import Task, eval as evaluate
    from inspect_ai.dataset import Sample
    from inspect_ai.model import get_model
    from smartplay_inspect import smartplay_agent

    is_openai = server.dialect.interface == "chat" and server.dialect.cannot == ["thoughts"]
    is_openai = is_openai and server.dialect.name != "Bedrock"  # whose address Inspect knows, and asks for Responses
    name = f"{'openai' if is_openai else 'openai-api/server'}/{server.dialect.model}"
    own = {"responses_api": False, "memoize": False}
    model = get_model(name, base_url=server.base_url, api_key="k", **own)
    task = Task([Sample(input="Play.")], solver=smartplay_agent(lambda state, record: episode, **options))
    with TemporaryDirectory() as folder:
        (log,) = evaluate(task, model=model, display="none", max_retries=0, log_dir=folder)
    assert log.status == "success", log.error


def by_verifiers(server: DialectServer, episode: sp.Episode, stream: bool) -> None:
    from smartplay_verifiers import SmartPlayHarness, SmartPlayHarnessConfig

    from tests.adapters.test_verifiers import launched

    class Given(SmartPlayHarness):
        """Plays an episode that is there already."""

        def new_episode(self, data: Any, record: list[Any]) -> sp.Episode:
            return episode

    launched(server.base_url, Given(SmartPlayHarnessConfig()))


# --- The rows ------------------------------------------------------------------------------------------------------

WAYS = {
    way.name: way
    for way in [
        Way("openai:", "chat", by_player("openai")),
        Way("openai-responses:", "responses", by_player("openai-responses")),
        Way("anthropic:", "messages", by_player("anthropic"), streams=False, needs="anthropic"),
        Way("serve window", "chat", at_window),
        Way("serve openai", "chat", at_endpoint),
        Way(
            "langchain: (ChatOpenAI)",
            "chat",
            by_langchain_player(chat_openai),
            is_exact=False,
            needs="langchain_openai",
        ),
        Way(
            "langchain: (ChatAnthropic)",
            "messages",
            by_langchain_player(chat_anthropic),
            is_exact=False,
            needs="langchain_anthropic",
        ),
        Way(
            "LangChain agent (ChatOpenAI)", "chat", by_middleware(chat_openai), is_exact=False, needs="langchain_openai"
        ),
        Way(
            "LangChain agent (ChatAnthropic)",
            "messages",
            by_middleware(chat_anthropic),
            is_exact=False,
            needs="langchain_anthropic",
        ),
        Way("LangGraph (ChatOpenAI)", "chat", by_graph(chat_openai), is_exact=False, needs="langchain_openai"),
        Way("Agents SDK (chat)", "chat", by_agents_sdk("OpenAIChatCompletionsModel"), needs="agents"),
        Way("Agents SDK (Responses)", "responses", by_agents_sdk("OpenAIResponsesModel"), needs="agents"),
        Way("Pydantic AI (chat)", "chat", by_pydantic_ai("chat"), streams=False, needs="pydantic_ai"),
        Way("Pydantic AI (Responses)", "responses", by_pydantic_ai("responses"), streams=False, needs="pydantic_ai"),
        Way("Pydantic AI (Anthropic)", "messages", by_pydantic_ai("messages"), streams=False, needs="pydantic_ai"),
        Way("Inspect AI", "chat", by_inspect, streams=False, needs="inspect_ai"),
        Way("verifiers", "chat", by_verifiers, streams=False, needs="verifiers"),
    ]
}

MEET = [(way, dialect) for way in WAYS.values() for dialect in DIALECTS.values() if way.interface == dialect.interface]
PAIRS = [(way, dialect) for way, dialect in MEET if "play" not in way.without(dialect)]


@contextmanager
def reached(server: DialectServer) -> Iterator[DialectServer]:
    """Open a server, with the variables by which clients that ask for the real host reach it."""
    emptied = dict.fromkeys([name for name in os.environ if name.lower().endswith("_proxy")], "")
    # As tests/conftest.py says of fast tests.
    known = {"SSL_CERT_FILE": str(Path(__file__).parents[1] / "data" / "one_authority.pem")}
    with server, pytest.MonkeyPatch.context() as variables:
        ways = {"HTTP_PROXY": server.url, "http_proxy": server.url, "NO_PROXY": "127.0.0.1,localhost"}
        for name, value in {**emptied, **known, **ways}.items():
            variables.setenv(name, value)
        yield server
