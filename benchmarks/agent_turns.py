"""The time of a turn in agents of LangChain and of the Agents SDK with our context window.

    python benchmarks/agent_turns.py [--turns 100]

A turn is one model call and its one tool call. "Ours" is the time of the adapter, without the model and the framework:
budgets, view, conversion of the window's messages, answers, and the record. It grows with the number of messages in the
window (at most 4,096 tokens here). The framework's share grows with the whole run, so "whole" is the mean over
`--turns` turns, and "bare" is the same agent with a tool that returns a constant. Microseconds; the median for ours.
The Agents SDK is asynchronous, so every turn goes to a thread and back three times.
"""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import statistics
import time
from collections.abc import Callable
from typing import Any

from agents import Agent, FunctionTool, Model, ModelResponse, RunConfig, Runner, set_tracing_disabled
from agents.testing import assistant_message, function_call
from agents.usage import Usage
from langchain.agents import create_agent
from langchain.agents.middleware import hook_config
from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AIMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.tools import StructuredTool
from rich.console import Console
from rich.table import Table
from smartplay_langchain import SmartPlayMiddleware
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from smartplay_tools.games import get_spec

GAME = "RockPaperScissorBasic-v0"
ACT = {"action": "Rock"}
ACT_TEXT = '{"action": "Rock"}'


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--turns", type=int, default=100)
    turns = parser.parse_args().turns
    set_tracing_disabled(True)
    rows = {
        "LangChain, SmartPlayMiddleware": langchain_agent(turns),
        "Agents SDK, SmartPlayModel": asyncio.run(agents_sdk(turns)),
    }
    table = Table("one turn of an agent", "ours", "whole", "bare", title=f"Microseconds a turn, {turns} turns")
    for name, figures in rows.items():
        table.add_row(name, *(f"{figure:,.0f}" for figure in figures))
    Console().print(table)


def fresh(turns: int) -> sp.Episode:
    """An episode that ends after the given number of turns."""
    long = dataclasses.replace(get_spec(GAME), rollout=10**9)
    return sp.Episode(long, seed=1, budget=sp.Budget(prompt_tokens=4096, history=200, tool_calls=turns))


def schema() -> dict[str, Any]:
    with fresh(1) as episode:
        return dict(episode.tools[1].parameters)


class ActingModel(BaseChatModel):
    """Calls `act` the given number of times, then says so."""

    left: int

    @property
    def _llm_type(self) -> str:
        return "acting"

    def bind_tools(self, tools: Any, **kwargs: Any) -> Any:
        """It knows which tool it calls."""
        return self

    def _generate(self, messages: Any, stop: Any = None, run_manager: Any = None, **_: Any) -> ChatResult:
        self.left -= 1
        calls = [{"name": "act", "args": ACT, "id": f"c{self.left}", "type": "tool_call"}] if self.left >= 0 else []
        return ChatResult(generations=[ChatGeneration(message=AIMessage("", tool_calls=calls))])


class TimedMiddleware(SmartPlayMiddleware):
    """Knows what each turn took in its own hooks."""

    def __init__(self, episode: sp.Episode) -> None:
        super().__init__(episode)
        self.turns: list[float] = []

    @hook_config(can_jump_to=["end"])
    def before_model(self, state: Any, runtime: Any) -> Any:
        """Begin a turn."""
        begun = time.perf_counter()
        try:
            return super().before_model(state, runtime)
        finally:
            self.turns.append(time.perf_counter() - begun)

    def wrap_model_call(self, request: Any, handler: Any) -> Any:
        """Leave out what the model took."""
        begun, asked = time.perf_counter(), 0.0

        def timed(request: Any) -> Any:
            nonlocal asked
            sent = time.perf_counter()
            response = handler(request)
            asked = time.perf_counter() - sent
            return response

        response = super().wrap_model_call(request, timed)
        self.turns[-1] += time.perf_counter() - begun - asked
        return response

    @hook_config(can_jump_to=["model"])
    def after_model(self, state: Any, runtime: Any) -> Any:
        """Add what comes after the reply."""
        begun = time.perf_counter()
        result = super().after_model(state, runtime)
        self.turns[-1] += time.perf_counter() - begun
        return result


def langchain_agent(turns: int) -> tuple[float, float, float]:
    with fresh(turns) as episode:
        middleware = TimedMiddleware(episode)
        agent = create_agent(ActingModel(left=turns), middleware=[middleware])
        whole = seconds(lambda: agent.invoke({"messages": []}))
    assert episode.result is not None
    assert episode.result.steps == turns
    tool = StructuredTool(name="act", description="-", args_schema=schema(), func=lambda **_: "constant")
    alone = create_agent(ActingModel(left=turns), [tool])
    constant = seconds(lambda: alone.invoke({"messages": []}))
    return statistics.median(middleware.turns[:turns]) * 1e6, whole / turns * 1e6, constant / turns * 1e6


def seconds(call: Callable[[], Any]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


class ActingAgentsModel(Model):
    """The same for the Agents SDK; knows what its replies took."""

    def __init__(self, turns: int) -> None:
        self.left, self.seconds = turns, 0.0

    async def get_response(self, *_: Any, **__: Any) -> ModelResponse:
        """Reply at once."""
        begun = time.perf_counter()
        self.left -= 1
        item = function_call("act", ACT_TEXT, call_id=f"c{self.left}") if self.left >= 0 else assistant_message("Done.")
        response = ModelResponse(output=[item], usage=Usage(), response_id=None)
        self.seconds = time.perf_counter() - begun
        return response

    def stream_response(self, *_: Any, **__: Any) -> Any:
        """Nobody asks for streams here."""
        raise NotImplementedError


class TimedModel(SmartPlayModel):
    """Knows what each turn took beside the model's reply."""

    def __init__(self, inner: ActingAgentsModel, episode: sp.Episode) -> None:
        super().__init__(inner, episode)
        self._inner, self.turns = inner, []

    async def get_response(self, *arguments: Any, **options: Any) -> ModelResponse:
        """Leave out what the model took."""
        begun = time.perf_counter()
        response = await super().get_response(*arguments, **options)
        self.turns.append(time.perf_counter() - begun - self._inner.seconds)
        return response


async def agents_sdk(turns: int) -> tuple[float, float, float]:
    async def run(model: Model, tools: list[Any], config: RunConfig | None = None) -> float:
        begun = time.perf_counter()
        await Runner.run(Agent("player", model=model, tools=tools), [], max_turns=None, run_config=config)
        return (time.perf_counter() - begun) / turns * 1e6

    async def constant(_: Any, __: str) -> str:
        return "constant"

    with fresh(turns) as episode:
        model = TimedModel(ActingAgentsModel(turns), episode)
        whole = await run(model, model.tools, model.run_config)
    assert episode.result is not None
    assert episode.result.steps == turns
    tool = FunctionTool("act", "-", schema(), constant)
    return statistics.median(model.turns[:turns]) * 1e6, whole, await run(ActingAgentsModel(turns), [tool])


if __name__ == "__main__":
    main()
