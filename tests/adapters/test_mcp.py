"""MCP: one process on stdio, many episodes on HTTP, and access control."""

from __future__ import annotations

import asyncio
import errno
import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx2
import pytest
from mcp import Client, MCPError
from mcp.client.streamable_http import streamable_http_client
from smartplay_mcp import CALL_KEY, HttpServer

import smartplay_tools as sp
from smartplay_tools.errors import TranscriptError
from smartplay_tools.files.lines import AppendedFile
from smartplay_tools.web import EpisodeStore, FullError, HostedEpisode
from tests.adapters.conformance import GAME, act, fresh

MODES = ["auto", "legacy"]


def text_of(result: Any) -> str:
    (part,) = result.content
    return part.text


@asynccontextmanager
async def http_client(url: str, headers: dict[str, str] | None = None) -> Any:
    async with (
        httpx2.AsyncClient(headers=headers or {}, trust_env=False, verify=False) as client,
        streamable_http_client(url, http_client=client) as streams,
    ):
        yield streams


@asynccontextmanager
async def client_of(episode: sp.Episode, mode: str = "auto") -> Any:
    """A client of a server that has an episode."""
    store = EpisodeStore()
    with HttpServer(store, port=0) as server:
        handle = store.add(lambda handle: HostedEpisode(episode))
        async with Client(http_client(f"{server.url}/mcp/{handle}"), mode=mode) as client:
            yield client


@pytest.mark.parametrize("mode", MODES)
class TestServer:
    async def test_the_schemas_are_ours_to_the_letter(self, mode):
        episode, _ = fresh(context="host")
        async with client_of(episode, mode) as client:
            listed = (await client.list_tools()).tools
        assert [(t.name, t.description, t.input_schema) for t in listed] == [
            (t.name, t.description, dict(t.parameters)) for t in episode.tools
        ]

    async def test_the_model_is_told_no_more_than_the_text(self, mode):
        episode, _ = fresh(context="host")
        async with client_of(episode, mode) as client:
            result = await client.call_tool(*act("A->C"))
        assert text_of(result).startswith("You tried to move")
        assert "score" not in json.dumps(result.model_dump(mode="json"))

    async def test_there_are_tools_only(self, mode):
        """Coding agents show the model tools of their own where a server has resources."""
        episode, _ = fresh(context="host")
        async with client_of(episode, mode) as client:
            assert text_of(await client.call_tool("read_manual")) == episode.game.manual
            assert client.server_capabilities.model_dump(exclude_none=True) == {"tools": {"list_changed": False}}
            with pytest.raises(MCPError, match="Method not found"):
                await client.list_resources()

    async def test_a_call_that_is_sent_again_is_not_played_again(self, mode):
        episode, _ = fresh(context="host")
        async with client_of(episode, mode) as client:
            for _ in range(3):
                await client.call_tool(*act("A->C"), meta={CALL_KEY: "k1"})
        assert episode.stats.steps == 1

    async def test_calls_at_once_are_played_one_at_a_time(self, mode):
        episode, events = fresh(sp.Budget(stalled_turns=None), context="host")
        async with client_of(episode, mode) as client:
            await asyncio.gather(*(client.call_tool("observe") for _ in range(20)))
        assert [event["turn"] for event in events if event["event"] == "call"] == list(range(20))


def test_a_window_cannot_be_kept_by_somebody_else():
    episode, _ = fresh()
    with pytest.raises(sp.InvalidArgumentError, match="MCP host manages the context"):
        HostedEpisode(episode)


@pytest.mark.parametrize("mode", MODES)
class TestHttp:
    @pytest.mark.parametrize("where", ["path", "query", "header"])
    async def test_an_episode_is_bound_to_its_handle(self, mode, where):
        """Two handles with two clients each: clients of a handle share an episode, which the others cannot see."""
        episodes = EpisodeStore()
        with HttpServer(episodes, port=0) as server:
            handles = [episodes.open(GAME, seed=seed) for seed in (1, 2)]
            for move in ("A->C", "A->B"):
                for handle in handles:
                    url = {"path": f"/mcp/{handle}", "query": f"/mcp?episode={handle}", "header": "/mcp"}[where]
                    headers = {"X-Episode": handle} if where == "header" else {}
                    async with Client(http_client(server.url + url, headers), mode=mode) as client:
                        result = await client.call_tool(*act(move))
            assert result.structured_content["step"] == 2
            assert [episodes.find(handle).episode.stats.steps for handle in handles] == [2, 2]

    async def test_a_restarted_server_goes_on_where_it_stopped(self, mode, tmp_path):
        before = EpisodeStore(folder=tmp_path / "before")
        handle = before.open(GAME, seed=7, budget=sp.Budget(history=3))
        with HttpServer(before, port=0) as server:
            async with Client(http_client(f"{server.url}/mcp/{handle}"), mode=mode) as client:
                await client.call_tool(*act("A->C"), meta={CALL_KEY: "k1"})
                first = await client.call_tool("act", {"action": "Fly"}, meta={CALL_KEY: "k2"})
        # The contents of the disk at a power failure.
        shutil.copytree(tmp_path / "before", tmp_path / "after")
        before.close(handle)
        after = EpisodeStore(folder=tmp_path / "after")
        with HttpServer(after, port=0) as server:
            async with Client(http_client(f"{server.url}/mcp/{handle}"), mode=mode) as client:
                again = await client.call_tool("act", {"action": "Fly"}, meta={CALL_KEY: "k2"})
                result = await client.call_tool(*act("A->B"))
                other = await client.call_tool(*act("B->A"), meta={CALL_KEY: "k1"})
        assert text_of(again) == text_of(first)
        assert "used for another call" in text_of(other)
        assert result.structured_content["step"] == 2
        result = after.close(handle)
        assert (result.steps, result.tool_calls, result.illegal_actions, result.end_reason) == (2, 3, 1, "closed")
        assert sp.replay(tmp_path / "after" / f"{handle}.jsonl").identical

    async def test_a_finished_episode_is_still_over_after_a_restart(self, mode, tmp_path):
        before = EpisodeStore(folder=tmp_path)
        handle = before.open(GAME, seed=7, budget=sp.Budget(tool_calls=2))
        table = before.find(handle)
        await table.call(*act("A->C"), "k1")
        last = await table.call(*act("A->B"), "k2")
        written = (tmp_path / f"{handle}.jsonl").read_text()
        after = EpisodeStore(folder=tmp_path)
        with HttpServer(after, port=0) as server:
            async with Client(http_client(f"{server.url}/mcp/{handle}"), mode=mode) as client:
                again = await client.call_tool(*act("A->B"), meta={CALL_KEY: "k2"})
                more = await client.call_tool(*act("C->B"))
            result = after.find(handle).episode.result
        assert (text_of(again), again.is_error) == (last.text, False)
        assert more.is_error
        assert "The episode is over" in text_of(more)
        assert result == table.episode.result
        assert (tmp_path / f"{handle}.jsonl").read_text() == written
        close(before, handle)


def close(episodes: EpisodeStore, *handles: str) -> None:
    """Close the files. If other episodes have taken over, nothing is read from these any more."""
    for handle in handles:
        episodes.close(handle)


def post(url: str, **options: Any) -> httpx2.Response:
    return httpx2.post(url, trust_env=False, verify=False, **options)


CALL = {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": "observe", "arguments": {}}}
ACCEPT = {"Accept": "application/json, text/event-stream"}


class TestTheDoor:
    def test_who_may_come_in(self):
        episodes = EpisodeStore()
        names = ["play.example.org"]
        with HttpServer(episodes, port=0, token="agents", hosts=names) as server:
            url = f"{server.url}/mcp/{episodes.open(GAME, seed=1)}"
            agent = {**ACCEPT, "Authorization": "Bearer agents"}

            def status(**headers: str) -> int:
                return post(url, json=CALL, headers={**agent, **headers}).status_code

            assert status() == 200
            assert status(Host="play.example.org") == 200
            assert status(Host="play.example.org:8443", Origin="https://play.example.org") == 200
            assert status(Authorization="") == 401
            assert status(Authorization="Bearer boss") == 401
            assert post(f"{server.url}/mcp/{'x' * 32}", json=CALL, headers=agent).status_code == 404
            assert post(f"{server.url}/mcp", json=CALL, headers=agent).status_code == 404
            assert post(f"{server.url}/elsewhere", json=CALL, headers=agent).status_code == 404
            assert post(url, json={**CALL, "pad": "x" * 100_000}, headers=ACCEPT).status_code == 401

    def test_the_path_that_some_clients_append_is_the_same_address(self):
        with HttpServer(episodes := EpisodeStore(), port=0) as server:
            handle = episodes.open(GAME, seed=1)
            for address in (f"mcp/{handle}/mcp", f"mcp/{handle}", f"mcp/{handle}/", f"mcp?episode={handle}"):
                assert post(f"{server.url}/{address}", json=CALL).status_code == 200
            assert post(f"{server.url}/mcp/{handle}", json={**CALL, "method": "ping"}).json()["result"] == {}
            assert post(f"{server.url}/mcp/mcp", json=CALL).status_code == 404


ACT = {**CALL, "id": 2, "params": {"name": "act", "arguments": {"action": "1"}}}


@pytest.mark.parametrize("version", ["2024-11-05", "2025-03-26", "2025-11-25", "2026-07-28"])
def test_a_list_of_messages_is_refused(version):
    with HttpServer(episodes := EpisodeStore(), port=0) as server:
        url = f"{server.url}/mcp/{(handle := episodes.open(GAME, seed=1))}"
        refused = post(url, json=[ACT], headers={"MCP-Protocol-Version": version})
        assert (refused.status_code, refused.json()["error"]["code"]) == (400, -32600)
        assert episodes.close(handle).steps == 0


class TestEpisodes:
    def test_handles_cannot_be_guessed(self):
        episodes = EpisodeStore()
        handles = {episodes.open(GAME, seed=1) for _ in range(20)}
        assert len(handles) == 20
        assert {len(handle) for handle in handles} == {32}

    def test_who_does_not_call_loses_his_place(self):
        now = [0.0]
        episodes = EpisodeStore(idle=60, clock=lambda: now[0])
        idle, busy = episodes.open(GAME, seed=1), episodes.open(GAME, seed=2)
        left = episodes.find(idle)
        now[0] = 50
        assert episodes.find(busy) is not None
        now[0] = 100
        assert episodes.find(idle) is None
        assert left.episode.end_reason == "closed"
        assert episodes.find(busy) is not None

    def test_who_has_not_begun_keeps_his_place(self):
        now = [0.0]
        episodes = EpisodeStore(idle=60, clock=lambda: now[0])
        handle = episodes.open(GAME, seed=1)
        now[0] = 1000
        assert not episodes.find(handle).episode.done

    def test_whoever_comes_too_late_is_told_why(self):
        now = [0.0]
        episodes = EpisodeStore(idle=60, clock=lambda: now[0])
        handle = episodes.open(GAME, seed=1)
        episodes.find(handle)
        now[0] = 100
        with HttpServer(episodes, port=0) as server:
            refused = post(f"{server.url}/mcp/{handle}", json=CALL, headers=ACCEPT)
        sentence = "The episode was closed after 60 seconds without a request."
        assert (refused.status_code, refused.text) == (404, sentence)
        assert episodes.gone(handle).result.end_reason == "closed"

    def test_idle_episodes_are_closed_even_if_the_record_of_one_cannot_be_written(self, tmp_path, monkeypatch):
        now = [0.0]
        episodes = EpisodeStore(folder=tmp_path, idle=60, most=2, clock=lambda: now[0])
        handles = [episodes.open(GAME, seed=seed) for seed in (1, 2)]
        idle = [episodes.find(handle).episode for handle in handles]

        def fail_once(file: AppendedFile, lines: bytes) -> None:
            monkeypatch.undo()
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(AppendedFile, "write", fail_once)
        now[0] = 100
        with pytest.raises(sp.SmartPlayError, match="No space left"):
            episodes.open(GAME, seed=3)
        assert all(episode.done for episode in idle)
        episodes.close(episodes.open(GAME, seed=3))

    def test_with_a_folder_it_is_told_that_the_episode_is_over(self, tmp_path):
        now = [0.0]
        episodes = EpisodeStore(folder=tmp_path, idle=60, clock=lambda: now[0])
        handle = episodes.open(GAME, seed=1)
        episodes.find(handle)
        now[0] = 100
        with ThreadPoolExecutor(8) as pool:
            tables = list(pool.map(episodes.find, [handle] * 8))
        assert {id(table) for table in tables} == {id(tables[0])}
        assert tables[0].episode.call("observe").text.startswith("Error: The episode is over")
        assert tables[0].episode.end_reason == "closed"

    def test_an_operator_s_end_is_the_end_after_a_restart_too(self, tmp_path: Path):
        before = EpisodeStore(folder=tmp_path)
        handle = before.open(GAME, seed=7)
        result = before.close(handle)
        episode = EpisodeStore(folder=tmp_path).find(handle).episode
        assert (episode.result, episode.end_reason) == (result, "closed")

    def test_there_is_a_limit(self, tmp_path: Path):
        before = EpisodeStore(folder=tmp_path)
        handles = [before.open(GAME, seed=seed) for seed in range(2)]
        after = EpisodeStore(folder=tmp_path, most=1)
        after.find(handles[0])
        with pytest.raises(FullError, match="1 episodes are open"):
            after.find(handles[1])
        with HttpServer(after, port=0) as server:
            refused = post(f"{server.url}/mcp/{handles[1]}", json=CALL, headers=ACCEPT)
        assert (refused.status_code, refused.text) == (503, "1 episodes are open, which is the largest number allowed.")
        close(before, *handles)
        close(after, handles[0])

    def test_a_record_that_plays_differently_is_not_continued(self, tmp_path: Path):
        before = EpisodeStore(folder=tmp_path)
        handle = before.open(GAME, seed=7)
        before.find(handle).episode.call(*act("A->C"))
        record = tmp_path / f"{handle}.jsonl"
        tampered = record.read_text().replace("You tried", "You cried")
        record.write_text(tampered)
        episodes = EpisodeStore(folder=tmp_path)
        with pytest.raises(TranscriptError, match="cannot be continued: event 2, or an event before it, was changed"):
            episodes.find(handle)
        with HttpServer(episodes, port=0) as server:
            refused = post(f"{server.url}/mcp/{handle}", json=CALL, headers=ACCEPT)
        assert (refused.status_code, refused.text) == (500, "The record of this episode cannot be continued")
        assert [path.read_text() for path in tmp_path.iterdir()] == [tampered]
        close(before, handle)

    @pytest.mark.parametrize("handle", ["", "..", "../secrets", "x" * 32])
    def test_a_handle_that_is_none_finds_nothing(self, handle, tmp_path):
        assert EpisodeStore(folder=tmp_path).find(handle) is None
