"""An agent of OpenAI's package plays one episode; docs/clients.md says how it is started.

pip install openai==3.54.0 'mcp==2.3.0'
"""

import asyncio
import json
import os
from typing import Any

from mcp import Client
from openai import AsyncOpenAI

model = AsyncOpenAI()
messages: list[Any] = [{"role": "user", "content": "Play."}]


def schema(tool: Any) -> Any:
    function = {"name": tool.name, "description": tool.description, "parameters": tool.input_schema}
    return {"type": "function", "function": function}


async def play() -> None:
    async with Client(os.environ["SMARTPLAY_MCP_URL"]) as server:
        tools = [schema(tool) for tool in (await server.list_tools()).tools]
        calls: Any = True
        while calls:
            name = os.environ["OPENAI_MODEL"]
            answer = await model.chat.completions.create(model=name, messages=messages, tools=tools)
            reply = answer.choices[0].message
            messages.append(reply.model_dump(exclude_none=True))
            calls = reply.tool_calls
            for call in calls or ():
                result: Any = await server.call_tool(call.function.name, json.loads(call.function.arguments))
                messages.append({"role": "tool", "tool_call_id": call.id, "content": result.content[0].text})
        print(reply.content)


asyncio.run(play())
