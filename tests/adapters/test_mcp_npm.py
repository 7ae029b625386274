"""The server with the protocol's client for TypeScript, run by Node, which is that of most hosts."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from smartplay_mcp import HttpServer

from smartplay_tools.web import EpisodeStore
from tests.adapters.conformance import GAME, move
from tests.processes import printed_by

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("npm") is None, reason="npm is not installed"),
]

PLAY = """
const [transport, target, first, second] = process.argv.slice(2);
const { Client } = await import("@modelcontextprotocol/sdk/client/index.js");
const { StdioClientTransport } = await import("@modelcontextprotocol/sdk/client/stdio.js");
const { StreamableHTTPClientTransport } = await import("@modelcontextprotocol/sdk/client/streamableHttp.js");
const client = new Client({ name: "test", version: "1" });
const command = { command: target, args: ["-m", "smartplay_tools", "serve", "mcp", "GAME", "--seed", "7"] };
await client.connect(
  transport === "stdio" ? new StdioClientTransport(command) : new StreamableHTTPClientTransport(new URL(target)),
);
const { tools } = await client.listTools();
await client.callTool({ name: "act", arguments: { action: first } });
const result = await client.callTool({ name: "act", arguments: { action: second } });
const { resources } = await client.listResources();
const { contents } = await client.readResource({ uri: resources[0].uri });
const names = tools.map((tool) => tool.name);
console.log(JSON.stringify({ names, result, manual: contents[0].text, instructions: client.getInstructions() }));
await client.close();
""".replace("GAME", GAME)


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    """Run a script in a folder that has the packages."""
    folder: Path = tmp_path_factory.mktemp("node")
    packages = ["@modelcontextprotocol/sdk"]
    printed_by("npm", "install", "--no-audit", "--no-fund", *packages, cwd=folder)

    def run(script, *arguments):
        (folder / "script.mjs").write_text(script)
        command = ["node", "script.mjs", *arguments]
        done = printed_by(*command, cwd=folder)
        return json.loads(done)

    return run


def check(printed):
    assert printed["names"] == ["observe", "act", "read_manual"]
    assert printed["result"]["structuredContent"]["step"] == 2
    assert printed["result"]["structuredContent"]["text"] == printed["result"]["content"][0]["text"]
    assert "until it is over" in printed["instructions"]
    assert printed["manual"]


def test_the_typescript_client_plays_on_stdio(node):
    check(node(PLAY, "stdio", sys.executable, move("A->C"), move("A->B")))


def test_the_typescript_client_plays_over_http(node):
    store = EpisodeStore()
    with HttpServer(store, port=0) as server:
        check(node(PLAY, "http", f"{server.url}/mcp/{store.open(GAME, seed=7)}", move("A->C"), move("A->B")))
