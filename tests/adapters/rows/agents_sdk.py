"""The Agents SDK's runner with `SmartPlayModel`."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from agents import (
    Agent,
    AgentOutputSchema,
    MaxTurnsExceeded,
    ModelSettings,
    Runner,
    Tool,
    ToolOutputImage,
    ToolOutputText,
    function_tool,
    set_tracing_disabled,
)
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from tests.adapters.conformance import EACH, SEED, WEATHER, Held, Replies, Window, fresh
from tests.adapters.scripted_agents import ReadingModel
from tests.adapters.situations import AWAITED, REFUSED, weather

PICTURE = "data:image/png;base64,AAAA"


def agents_sdk(
    episode: sp.Episode,
    script: Replies,
    *,
    own_cap: int | None = None,
    situation: str = "",
    streamed: bool = False,
) -> Held:
    set_tracing_disabled(True)  # no traces to a provider
    inner = ReadingModel(script, EACH)
    model = SmartPlayModel(inner, episode)
    settings = ModelSettings(max_tokens=own_cap, tool_choice="none" if situation == "no calls" else None)

    @function_tool
    def camera() -> Any:
        """Take a picture."""
        return [ToolOutputText(text="Here."), ToolOutputImage(image_url=PICTURE)]

    @function_tool
    async def helper() -> str:
        """Play for the agent."""
        other = Agent("helper", model=model, tools=model.tools)
        return str((await Runner.run(other, "Play.", run_config=model.run_config)).final_output)

    weather_tool = replace(
        function_tool(weather, name_override=WEATHER.name, strict_mode=False),
        description=WEATHER.description,
        params_json_schema=dict(WEATHER.parameters),
    )
    for_now = replace(weather_tool, is_enabled=lambda *_: not inner.received)
    own: dict[str, list[Tool]] = {
        "broken call": [weather_tool],
        "withdrawn": [for_now],
        "picture": [camera],
        "sub-agent": [helper],
    }
    others = SmartPlayModel(inner, fresh(seed=SEED + 1)[0]).tools if "another" in situation else []
    instead = {"no tools": [], "another episode instead": others}
    tools = instead.get(situation, [*model.tools, *others, *own.get(situation, [])])
    output = AgentOutputSchema(dict[str, int], strict_json_schema=False) if situation == "schema" else None
    agent = Agent("player", model=model, tools=tools, model_settings=settings, output_type=output)

    async def run(items: list[Any], most: int | None = None) -> Any:
        if not streamed:
            return await Runner.run(agent, items, max_turns=most, run_config=model.run_config)
        running = Runner.run_streamed(agent, items, max_turns=most, run_config=model.run_config)
        async for _ in running.stream_events():
            pass
        return running

    async def runs() -> Any:
        if situation == "forgets":  # what it said before the latest reply
            with pytest.raises(MaxTurnsExceeded) as stopped:
                await run([], 3)
            items = [item.to_input_item() for item in stopped.value.run_data.new_items]
            return await run(items[-2:])
        result = await run([])
        return await run([]) if situation == "again" else result

    result = asyncio.run(runs())
    spent = result.context_wrapper.usage
    return Held(inner.received, sp.Usage(prompt=spent.input_tokens, reply=spent.output_tokens), result.final_output)


row = partial(Window, through="Agents SDK `SmartPlayModel`", refuses=REFUSED)
WINDOW = {
    "Agents SDK": row(agents_sdk),
    "Agents SDK, streamed": row(partial(agents_sdk, streamed=True), lacks=AWAITED, repeats=True),
}
