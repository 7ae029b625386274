"""Servers that refuse an optional field, each in words of its own, are asked once more without it."""

from __future__ import annotations

import asyncio
import json
import logging
from dataclasses import replace
from typing import Any

import pytest
import smartplay_gateway as sg

import smartplay_tools as sp
from tests.adapters.test_openai_faults import Changing, Faulty, answer, assert_as_if_nothing_had_happened, play
from tests.dialects.rules import DIALECTS
from tests.dialects.scripts import SOLVED
from tests.dialects.server import DialectServer
from tests.dialects.ways import WAYS, reached

SERVERS = {
    "by OpenAI": {"message": "Unsupported parameter: '{field}' is not supported with this model.", "param": "{field}"},
    "by its name": {"message": "Unrecognized request argument supplied: {field}", "param": None},
    "by Pydantic": {"message": "[{{'loc': ('body', '{field}'), 'msg': 'Extra inputs are not permitted'}}]"},
    "in an index": {"message": "Invalid value.", "param": "{field}[0]"},
}
"""Ways of refusing a field that are taken from reports; see `smartplay_tools.players.optional_fields`."""
VAGUE = {"message": "Your request is not valid."}


def refusing(fields: list[str], error: dict[str, Any]) -> Any:
    """Return what a server says to a request: a refusal that names the first of the fields it has; None if none."""

    def refusal(body: dict[str, Any]) -> dict[str, Any] | None:
        sent = json.dumps(body)
        field = next((name for name in fields if f'"{name}": ' in sent), None)
        filled = {name: text and text.format(field=field) for name, text in error.items()}
        return None if field is None else {"error": {"type": "invalid_request_error", **filled}}

    return refusal


class Refusing(Faulty):
    """The endpoint of the rule player, which refuses requests with one of some fields."""

    def __init__(self, refusal: Any) -> None:
        super().__init__()
        self.refusal, self.refused = refusal, 0

    def fault(self, body: dict[str, Any]) -> Any:
        if (said := self.refusal(body)) is None:
            return None
        self.refused += 1
        return answer(said, 400)


FIELDS = [
    *(("openai:rule", field) for field in ("stream_options", "max_tokens")),
    ("openai-responses:rule", "include"),
]


@pytest.mark.parametrize(
    ("player", "field", "server"),
    [
        pytest.param(player, field, server, marks=() if server == "by OpenAI" else pytest.mark.slow)
        for player, field in FIELDS
        for server in SERVERS
    ],
)
def test_a_refused_field_is_left_out_and_said_once(player, field, server, tmp_path, caplog):
    if field == "max_tokens" and server == "in an index":
        pytest.skip("its words are about the value, not the name")
    faulty = Refusing(refusing([field], SERVERS[server]))
    with caplog.at_level(logging.WARNING, "smartplay_tools.players"):
        result, _ = play(faulty, tmp_path, player, budget=sp.Budget(reply_tokens=100), stream=field == "stream_options")
    assert_as_if_nothing_had_happened(result, extra_requests=1) if field != "stream_options" else None
    assert (result.end_reason, faulty.refused, len(caplog.records)) == ("terminated", 1, 1)
    assert field in caplog.text


def test_several_fields_are_refused_one_after_the_other(tmp_path):
    faulty = Refusing(refusing(["stream_options", "max_tokens"], SERVERS["by its name"]))
    result, _ = play(faulty, tmp_path, budget=sp.Budget(reply_tokens=100), stream=True)
    assert (result.end_reason, result.score, faulty.refused) == ("terminated", 3, 2)


@pytest.mark.slow
def test_requests_under_way_when_the_first_one_is_refused(tmp_path, caplog):
    faulty = Refusing(refusing(["include"], SERVERS["by its name"]))

    async def play_all() -> list[sp.EpisodeResult]:
        with sg.LocalEndpoint(app=faulty) as endpoint:
            async with sp.get_player("openai-responses:rule", base_url=endpoint.base_url) as player:
                episodes = [sp.Episode("Hanoi3Disk-v0", seed=seed) for seed in range(3)]
                return await asyncio.gather(*(sp.aplay(episode, player) for episode in episodes))

    assert [result.score for result in asyncio.run(play_all())] == [3] * 3
    assert len(caplog.records) == 1


@pytest.mark.parametrize(
    "error",
    [
        VAGUE,
        SERVERS["by OpenAI"],
        {"message": "Items are not persisted when `store` is set to false. Try again with `store` set to true."},
    ],
)
def test_a_provider_is_never_allowed_to_keep_prompts(error, tmp_path):
    faulty = Refusing(refusing(["store"], error))
    result, _ = play(faulty, tmp_path, "openai-responses:rule")
    assert (result.end_reason, faulty.refused) == ("player_error", 1)
    assert {body["store"] for _, body in faulty.requests} == {False}


def test_a_field_that_the_user_has_set_is_never_left_out(tmp_path):
    faulty = Refusing(refusing(["include"], SERVERS["by OpenAI"]))
    result, _ = play(faulty, tmp_path, "openai-responses:rule", parameters={"include": []})
    assert (result.end_reason, faulty.refused) == ("player_error", 1)
    assert "'include' is not supported with this model" in result.error
    faulty = Refusing(refusing(["max_tokens"], SERVERS["by OpenAI"]))
    (tmp_path / "again").mkdir()
    budget = sp.Budget(reply_tokens=100)
    result, _ = play(faulty, tmp_path / "again", limit_field="max_tokens", budget=budget)
    assert (result.end_reason, faulty.refused) == ("player_error", 1)


TOO_LARGE = [
    "max_tokens is too large: 100.",
    "Invalid 'max_tokens': integer above maximum value. Expected a value <= 50, but got 100 instead.",
    "max_tokens: 100 is not supported, the maximum is 50",
    "Unsupported value: 'max_tokens' does not support 100 with this model.",
]


@pytest.mark.parametrize("words", TOO_LARGE)
def test_a_cap_that_is_too_large_keeps_its_name(words, tmp_path):
    faulty = Refusing(refusing(["max_tokens"], {"message": words, "param": "max_tokens"}))
    result, _ = play(faulty, tmp_path, budget=sp.Budget(reply_tokens=100))
    assert (result.end_reason, faulty.refused) == ("player_error", 1)
    assert {name for _, body in faulty.requests for name in body if "max" in name} == {"max_tokens"}


class Adding(Refusing, Changing):
    """The endpoint of the rule player behind a server that adds a field to its replies and refuses it in requests."""

    def __init__(self, refusal: Any, **added: Any) -> None:
        super().__init__(refusal)
        self.added = added

    def changed(self, body: dict[str, Any]) -> dict[str, Any]:
        for choice in body.get("choices", ()):
            choice["message"] |= self.added
        for item in body.get("output", ()):
            item |= self.added
        return body


GROQ = {"message": "for 'role:assistant' the following must be satisfied[(property '{field}' is unsupported)]"}
PYDANTIC = {"message": "messages.2.assistant.{field}: Extra inputs are not permitted"}


@pytest.mark.parametrize(
    ("player", "added", "error"),
    [
        ("openai:rule", {"reasoning": "Hm."}, GROQ),
        ("openai:rule", {"reasoning": "Hm."}, PYDANTIC),
        ("openai:rule", {"reasoning_content": "Hm."}, PYDANTIC),
        ("openai:rule", {"provider_specific_fields": {"x": "y"}}, PYDANTIC),
        ("openai-responses:rule", {"phase": "commentary"}, {"message": "Unknown parameter: 'input[2].{field}'."}),
    ],
)
def test_a_field_of_a_reply_that_its_server_refuses_stays_away_from_then_on(player, added, error, tmp_path):
    faulty = Adding(refusing([*added], error), **added)
    result, _ = play(faulty, tmp_path, player)
    assert_as_if_nothing_had_happened(result, extra_requests=1)
    assert faulty.refused == 1


def test_thoughts_that_a_server_wants_back_are_empty_where_they_were_left_out(tmp_path):
    def refusal(body: dict[str, Any]) -> dict[str, Any] | None:
        replies = [message for message in body["messages"] if message["role"] == "assistant"]
        words = "The `reasoning_content` in the thinking mode must be passed back to the API."
        return None if all("reasoning_content" in reply for reply in replies) else {"error": {"message": words}}

    faulty = Adding(refusal, reasoning_content="Hm.")
    result, _ = play(faulty, tmp_path, budget=sp.Budget(own_words=2))
    assert_as_if_nothing_had_happened(result, extra_requests=1)
    replies = [message for message in faulty.requests[-1][1]["messages"] if message["role"] == "assistant"]
    assert (replies[0]["reasoning_content"], replies[-1]["reasoning_content"]) == ("", "Hm.")


@pytest.mark.parametrize(
    ("way", "dialect", "field"),
    [
        ("openai:", "OpenAI", "prompt_cache_key"),
        ("openai:", "OpenAI", "prompt_cache_breakpoint"),
        pytest.param("anthropic:", "Anthropic", "cache_control", marks=pytest.mark.slow),
    ],
)
def test_the_fields_for_a_cache(way, dialect, field):
    refusal, refused = refusing([field], SERVERS["by Pydantic"]), []

    class Server(DialectServer):
        def answer(self, path: str, body: dict[str, Any]) -> tuple[int, str, bytes]:
            if (said := refusal(body)) is None:
                return super().answer(path, body)
            refused.append(said)
            return 400, "application/json", json.dumps(said).encode()

    server, episode = Server(replace(DIALECTS[dialect], model="gpt-5.6"), SOLVED), sp.Episode("Hanoi3Disk-v0", seed=7)
    with reached(server), episode:
        WAYS[way].play(server, episode, False)
    assert (episode.result.score, len(refused)) == (3, 1)


@pytest.mark.parametrize(
    ("host", "name"),
    [
        ("api.openai.com", "max_completion_tokens"),
        *((f"{region}.api.openai.com", "max_completion_tokens") for region in ("us", "eu", "au", "in", "jp", "ae")),
        ("mine.openai.azure.com", "max_completion_tokens"),
        ("mine.services.ai.azure.com", "max_completion_tokens"),
        ("mine.cognitiveservices.azure.com", "max_completion_tokens"),
        ("api.openai.com.example.org", "max_tokens"),
        ("fakeapi.openai.com", "max_tokens"),
        ("openrouter.ai", "max_tokens"),
    ],
)
def test_the_hosts_of_openai_and_azure(host, name):
    player = sp.get_player("openai:gpt-5.6", base_url=f"https://{host}/v1", api_key="k")
    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(reply_tokens=500)) as episode:
        request = player.request(sp.Conversation(episode).prompt())
    assert request[name] == 500
    assert ("prompt_cache_key" in request) == (host == "api.openai.com" or host.endswith(".api.openai.com"))
