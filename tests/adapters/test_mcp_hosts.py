"""MCP as hosts use it: what they show to models, how they start and stop servers, and requests of browsers."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from typing import Any
from urllib.parse import urlsplit

import pytest
from mcp import Client, StdioServerParameters, stdio_client
from smartplay_mcp import CALL_KEY, HttpServer, open_episode

import smartplay_tools as sp
from smartplay_tools.web import EpisodeStore, HostedEpisode
from tests.adapters.conformance import GAME, act, fresh
from tests.adapters.test_mcp import client_of, post
from tests.processes import printed_by


def on_stdio(*options: str) -> Any:
    command = ["-m", "smartplay_tools", "serve", "mcp", GAME, *options]
    return stdio_client(StdioServerParameters(command=sys.executable, args=command))


def talk(*messages: Any, options: tuple[str, ...] = ("--seed", "7")) -> list[Any]:
    """The answers of a server on stdio to lines, until its input ends."""
    lines = "".join((m if isinstance(m, str) else json.dumps(m)) + "\n" for m in messages)
    command = [sys.executable, "-m", "smartplay_tools", "serve", "mcp", GAME, *options]
    done = printed_by(*command, input=lines)
    return [json.loads(line) for line in done.splitlines()]


def request(method: str, number: Any = 1, **params: Any) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": number, "method": method, "params": params}


@pytest.mark.parametrize("mode", ["auto", pytest.param("legacy", marks=pytest.mark.slow)])
class TestWhatHostsShow:
    async def test_the_text_stands_where_hosts_look_for_it(self, mode):
        """pydantic-ai, Claude Code and VS Code show a model the structured content and nothing else."""
        episode, _ = fresh(context="host")
        async with client_of(episode, mode) as client:
            (_, act_tool, _) = (await client.list_tools()).tools
            result = await client.call_tool(*act("A->C"))
        assert result.structured_content["text"] == result.content[0].text
        assert set(act_tool.output_schema["properties"]) == set(result.structured_content)

    @pytest.mark.slow
    async def test_a_server_says_what_it_is(self, mode):
        async with Client(on_stdio("--seed", "7"), mode=mode) as client:
            tools = {tool.name: tool for tool in (await client.list_tools()).tools}
            info, instructions = client.server_info, client.instructions
        assert (info.name, info.version) == ("smartplay", version("smartplay-tools"))
        assert "until it is over" in instructions
        assert {name: tool.annotations.read_only_hint for name, tool in tools.items()} == {
            "observe": True,
            "act": False,
            "read_manual": True,
        }
        assert [tool.title for tool in tools.values()] == ["Observe", "Act", "Read the manual"]


class TestStdio:
    @pytest.mark.slow
    @pytest.mark.parametrize("mode", ["auto", "legacy"])
    async def test_a_session_for_each_call_keeps_the_game(self, mode, tmp_path):
        """langchain-mcp-adapters' `get_tools()` starts the server anew for every call."""
        record = tmp_path / "hanoi.jsonl"
        for step, move in enumerate(("A->C", "A->B"), start=1):
            async with Client(on_stdio("--seed", "7", "--transcript", str(record)), mode=mode) as client:
                result = await client.call_tool(*act(move))
            assert result.structured_content["step"] == step
        assert [event["event"] for event in sp.read_transcript(record)] == ["start", "call", "resume", "call"]
        assert sp.replay(record).differences == []

    @pytest.mark.slow
    def test_servers_that_are_started_at_once_play_one_after_the_other(self, tmp_path):
        """As a host does that starts one for each of the calls of a message."""
        record = tmp_path / "hanoi.jsonl"
        with ThreadPoolExecutor(3) as pool:

            def play(short: str) -> Any:
                name, arguments = act(short)
                call = request("tools/call", name=name, arguments=arguments)
                (answer,) = talk(call, options=("--seed", "7", "--transcript", str(record)))
                return answer["result"]["structuredContent"]["step"]

            steps = list(pool.map(play, ["A->C", "A->B", "C->B"]))
        assert sorted(steps) == [1, 2, 3]
        assert sp.replay(record).differences == []

    def test_a_record_of_another_game_is_not_continued(self, tmp_path):
        record = tmp_path / "hanoi.jsonl"
        with open_episode(GAME, seed=7, transcript=record) as episode:
            episode.call("observe")
        with pytest.raises(sp.InvalidArgumentError, match=r"with seed 7, not of .* with seed 8"):
            open_episode(GAME, seed=8, transcript=record)

    def test_only_what_is_needed_is_imported(self):
        """Some hosts wait a second for a server's first answer."""
        heavy = ["mcp", "mcp_types", "starlette", "uvicorn"]
        code = f"import sys, smartplay_mcp; print([name for name in {heavy} if name in sys.modules])"
        done = printed_by(sys.executable, "-c", code)
        assert done == "[]\n"

    @pytest.mark.slow
    def test_whatever_comes_is_answered_or_passed_by(self):
        answers = talk(
            "{",
            "",
            [],
            {"jsonrpc": "2.0", "method": "notifications/initialized"},
            request("ping", 1),
            request("jump", 2),
            request("tools/call", 3, name="act", arguments=[1]),
            request("tools/call", "four", name="jump"),
            request("resources/list", 5),
            request("server/discover", 6, _meta={"io.modelcontextprotocol/protocolVersion": "2099-01-01"}),
            {"jsonrpc": "2.0", "id": None, "method": "ping"},
        )
        codes = [(answer["id"], answer.get("error", {}).get("code")) for answer in answers]
        assert codes == [
            (None, -32700),
            (None, -32600),
            (1, None),
            (2, -32601),
            (3, -32602),
            ("four", None),
            (5, -32601),
            (6, -32602),
            (None, -32600),
        ]
        assert answers[5]["result"]["isError"]

    @pytest.mark.slow
    def test_a_mistake_is_one_sentence_while_the_host_keeps_the_input_open(self):
        command = [sys.executable, "-m", "smartplay_tools", "serve", "mcp", GAME, "--manual", "hidden"]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
            assert server.wait(120) == 2
            assert server.stderr.read() == "smartplay-tools: manual must be one of tool, pinned, none, not 'hidden'.\n"

    @pytest.mark.slow
    def test_the_second_host_of_a_record_is_told_why_its_call_is_not_played(self, tmp_path):
        def observed(server):
            print(json.dumps(request("tools/call", 1, name="observe", arguments={})), file=server.stdin, flush=True)
            return json.loads(server.stdout.readline())

        command = [sys.executable, "-m", "smartplay_tools", "serve", "mcp", GAME, "--seed", "7", "--transcript", "one"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": tmp_path}
        with subprocess.Popen(command, **pipes) as first:
            assert "result" in observed(first)
            with subprocess.Popen(command, **pipes) as second:
                refused = observed(second)
                assert second.wait(60) == 2
            first.stdin.close()
        assert refused["error"]["code"] == -32603
        assert "Another server plays the episode of one" in refused["error"]["message"]

    @pytest.mark.slow
    def test_answers_come_in_the_order_of_the_requests(self):
        calls = [request("tools/call", number, name="observe", _meta={CALL_KEY: str(number)}) for number in range(20)]
        assert [answer["id"] for answer in talk(*calls)] == list(range(20))


AGENT = {"Accept": "application/json, text/event-stream"}


class TestHttp:
    @pytest.mark.slow
    def test_the_command_stops_when_it_is_told_to(self):
        command = [sys.executable, "-m", "smartplay_tools", "serve", "mcp", GAME, "--http", "--port", "0"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        url = urlsplit(process.stdout.readline().split()[0])
        process.stdout.readline()
        with socket.create_connection((url.hostname, url.port)) as posting:
            head = f"POST {url.path} HTTP/1.1\r\nHost: {url.netloc}\r\nContent-Type: application/json\r\n"
            posting.sendall(f"{head}Content-Length: 999\r\n\r\n{{".encode())
            time.sleep(0.5)
            process.send_signal(signal.SIGTERM)
            process.wait(60)
        process.stdout.close()

    @pytest.mark.parametrize(
        ("headers", "code"),
        [
            ({"Mcp-Protocol-Version": "2099-01-01"}, -32022),
            ({"Mcp-Protocol-Version": "2026-07-28"}, -32602),
        ],
    )
    def test_headers_that_do_not_fit_the_body_are_refused(self, headers, code):
        store = EpisodeStore()
        with HttpServer(store, port=0) as server:
            url = f"{server.url}/mcp/{store.open(GAME, seed=1)}"
            answer = post(url, json=request("tools/list"), headers={**AGENT, **headers})
        assert (answer.status_code, answer.json()["error"]["code"]) == (400, code)

    @pytest.mark.parametrize("method", [[], {}, None, 1])
    @pytest.mark.parametrize("version", ["2025-11-25", "2026-07-28"])
    def test_a_method_that_is_not_a_text_is_refused_in_a_sentence(self, version, method):
        store = EpisodeStore()
        with HttpServer(store, port=0) as server:
            url = f"{server.url}/mcp/{store.open(GAME, seed=1)}"
            meta = {"io.modelcontextprotocol/protocolVersion": version}
            body = {**request("tools/list", _meta=meta), "method": method}
            headers = {**AGENT, "Mcp-Protocol-Version": version}
            answer = post(url, json=body, headers=headers)
        assert (answer.status_code, answer.json()["error"]["code"]) == (400, -32600)


def test_a_budget_that_only_a_window_can_keep_is_refused():
    episode = sp.Episode(GAME, seed=1, context="host", budget=sp.Budget(prompt_tokens=700))
    with pytest.raises(sp.InvalidArgumentError, match="cannot have prompt_tokens"):
        HostedEpisode(episode)
    with pytest.raises(sp.InvalidArgumentError, match="cannot have reply_tokens"):
        EpisodeStore().open(GAME, seed=1, budget=sp.Budget(reply_tokens=5))


def test_a_manual_cannot_be_pinned_where_the_host_makes_the_prompts():
    with pytest.raises(sp.InvalidArgumentError, match="results of tools only"):
        EpisodeStore().open(GAME, seed=1, manual="pinned")


HALF = {"action": "half \ud83d a character"}


class TestHalfCharacters:
    """A model may write half of a surrogate pair, which JSON can carry and UTF-8 cannot."""

    def test_over_http_they_are_answered_and_recorded(self):
        store, (episode, events) = EpisodeStore(), fresh(context="host")
        with HttpServer(store, port=0) as server:
            url = f"{server.url}/mcp/{store.add(lambda handle: HostedEpisode(episode))}"
            body = json.dumps(request("tools/call", name="act", arguments=HALF)).encode("ascii")
            headers = {**AGENT, "content-type": "application/json"}
            answer = post(url, content=body, headers=headers)
        assert answer.status_code == 200
        assert answer.json()["result"]["isError"]
        (call,) = (event for event in events if event["event"] == "call")
        assert json.loads(call["arguments"]) == HALF
