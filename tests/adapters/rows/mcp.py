"""MCP's own client at our server: in memory, on stdio and over HTTP, by each version of the protocol."""

from __future__ import annotations

import os
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import httpx2
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from smartplay_mcp import HttpServer

from smartplay_tools.web import EpisodeStore
from tests.adapters.conformance import GAME, HOST_BUDGET, Host, Send

Opened = AsyncIterator[list[Send]]


class ThroughClient:
    def __init__(self, client: Client) -> None:
        self.client = client

    async def __call__(self, name: str, arguments: Any) -> tuple[str, bool]:
        result = await self.client.call_tool(name, arguments)
        return result.content[0].text, result.is_error


@asynccontextmanager
async def mcp_on_stdio(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    """A process for each episode, as a host would start it."""
    async with AsyncExitStack() as stack:
        senders = []
        for seed in seeds:
            options = ["--seed", str(seed), "--history", str(HOST_BUDGET.history)]
            options += ["--transcript", str(folder / f"{seed}.jsonl")]
            command = ["-m", "smartplay_tools", "serve", "mcp", GAME, *options]
            server = StdioServerParameters(command=sys.executable, args=command, env=dict(os.environ))
            transport = stdio_client(server)
            senders.append(ThroughClient(await stack.enter_async_context(Client(transport, mode=mode))))
        yield senders


@asynccontextmanager
async def mcp_over_http(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    """One server for all episodes."""
    episodes = EpisodeStore(folder=folder)
    handles = [episodes.open(GAME, seed=seed, budget=HOST_BUDGET) for seed in seeds]
    async with AsyncExitStack() as stack:
        server = stack.enter_context(HttpServer(episodes, port=0))
        http = await stack.enter_async_context(httpx2.AsyncClient(trust_env=False, verify=False))
        addresses = [f"{server.url}/mcp/{handle}" for handle in handles]
        clients = [Client(streamable_http_client(address, http_client=http), mode=mode) for address in addresses]
        yield [ThroughClient(await stack.enter_async_context(client)) for client in clients]
    for handle in handles:
        episodes.close(handle)


row = partial(Host, through="MCP")
HOST = {
    "MCP on stdio": row(partial(mcp_on_stdio, mode="auto"), slow=True),
    "MCP on stdio, legacy": row(partial(mcp_on_stdio, mode="legacy"), slow=True),
    "MCP over HTTP": row(partial(mcp_over_http, mode="auto")),
    "MCP over HTTP, legacy": row(partial(mcp_over_http, mode="legacy")),
}
