"""An agent of LiteLLM plays one episode; docs/clients.md says how it is started.

pip install litellm==1.106.2 'mcp==2.3.0'
"""

import asyncio
import json
import os
from typing import Any

import litellm
from mcp import Client

messages: list[Any] = [{"role": "user", "content": "Play."}]


def schema(tool: Any) -> Any:
    function = {"name": tool.name, "description": tool.description, "parameters": tool.input_schema}
    return {"type": "function", "function": function}


async def play() -> None:
    async with Client(os.environ["SMARTPLAY_MCP_URL"]) as server:
        tools = [schema(tool) for tool in (await server.list_tools()).tools]
        calls: Any = True
        while calls:
            model = f"openai/{os.environ['OPENAI_MODEL']}"
            answer: Any = await litellm.acompletion(model, messages, tools=tools)
            reply = answer.choices[0].message
            messages.append(reply.model_dump(exclude_none=True))
            calls = reply.tool_calls
            for call in calls or ():
                result: Any = await server.call_tool(call.function.name, json.loads(call.function.arguments))
                messages.append({"role": "tool", "tool_call_id": call.id, "content": result.content[0].text})
        print(reply.content)


asyncio.run(play())
