"""Servers that refuse an optional field, each in words of its own, are asked once more without it."""

from __future__ import annotations

import asyncio
import json
import logging
from typing import Any

import pytest
import smartplay_openai as so

import smartplay_tools as sp
from tests.adapters import rerouted
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import WAY, act, calling
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.test_openai_faults import Faulty, answer, assert_as_if_nothing_had_happened, play

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
    *(("openai-responses:rule", field) for field in ("include", "store")),
]


@pytest.mark.parametrize(
    ("player", "field", "server"),
    [
        pytest.param(player, field, server, marks=() if server == "by OpenAI" or field == "store" else pytest.mark.slow)
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
    faulty = Refusing(refusing(["include", "store"], SERVERS["by its name"]))
    result, _ = play(faulty, tmp_path, "openai-responses:rule")
    assert_as_if_nothing_had_happened(result, extra_requests=2)


def test_a_refusal_that_names_nothing_is_one_of_all_optional_fields_at_first(tmp_path, caplog):
    faulty = Refusing(refusing(["store"], VAGUE))
    result, _ = play(faulty, tmp_path, "openai-responses:rule")
    assert_as_if_nothing_had_happened(result, extra_requests=1)
    assert "without include, store" in caplog.text


@pytest.mark.slow
def test_requests_under_way_when_the_first_one_is_refused(tmp_path, caplog):
    faulty = Refusing(refusing(["store"], VAGUE))

    async def play_all() -> list[sp.EpisodeResult]:
        with so.LocalEndpoint(app=faulty) as endpoint:
            async with sp.get_player("openai-responses:rule", base_url=endpoint.base_url) as player:
                episodes = [sp.Episode("Hanoi3Disk-v0", seed=seed) for seed in range(3)]
                return await asyncio.gather(*(sp.aplay(episode, player) for episode in episodes))

    assert [result.score for result in asyncio.run(play_all())] == [3] * 3
    assert len(caplog.records) == 1


@pytest.mark.parametrize(
    ("player", "attempts"), [("openai:rule", "1 attempt"), ("openai-responses:rule", "2 attempts")]
)
def test_what_is_refused_all_the_same_is_asked_for_once_more_and_no_oftener(player, attempts, tmp_path):
    faulty = Refusing(refusing(["model"], VAGUE))
    result, _ = play(faulty, tmp_path, player)
    assert (result.end_reason, faulty.refused) == ("player_error", int(attempts[0]))
    assert f"in {attempts}: BadRequestError" in result.error
    assert "Your request is not valid" in result.error


def test_a_field_that_the_user_has_set_is_never_left_out(tmp_path):
    faulty = Refusing(refusing(["store"], SERVERS["by OpenAI"]))
    result, _ = play(faulty, tmp_path, "openai-responses:rule", parameters={"store": True})
    assert (result.end_reason, faulty.refused) == ("player_error", 1)
    assert "'store' is not supported with this model" in result.error
    faulty = Refusing(refusing(["max_tokens"], SERVERS["by OpenAI"]))
    (tmp_path / "again").mkdir()
    budget = sp.Budget(reply_tokens=100)
    result, _ = play(faulty, tmp_path / "again", limit_field="max_tokens", budget=budget)
    assert (result.end_reason, faulty.refused) == ("player_error", 1)


def test_a_cap_that_is_too_large_keeps_its_name(tmp_path):
    faulty = Refusing(refusing(["max_tokens"], {"message": "max_tokens is too large: 100.", "param": "max_tokens"}))
    result, _ = play(faulty, tmp_path, budget=sp.Budget(reply_tokens=100))
    assert result.end_reason == "player_error"
    assert {name for _, body in faulty.requests for name in body if "max" in name} == {"max_tokens"}


@pytest.mark.parametrize(
    ("stub", "field"),
    [
        (OpenAIStub, "prompt_cache_key"),
        (OpenAIStub, "prompt_cache_breakpoint"),
        pytest.param(AnthropicStub, "cache_control", marks=pytest.mark.slow),
    ],
)
def test_the_fields_for_a_cache(stub, field):
    refusal = refusing([field], SERVERS["by Pydantic"])

    class Server(stub):
        refused = 0

        def _answer(self, path: str, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
            said = refusal(body)
            self.refused += said is not None
            return super()._answer(path, body) if said is None else (400, said)

    with Server([calling(act(move)) for move in WAY]) as server, rerouted.clients(server.url) as clients:

        class AtOpenAI(so.OpenAIPlayer):
            def new_client(self) -> Any:
                return super().new_client().with_options(http_client=clients["http_client"])

        made = (
            AtOpenAI("gpt-5.6", base_url="https://eu.api.openai.com/v1", api_key="k")
            if stub is OpenAIStub
            else sp.get_player("anthropic:m", base_url=server.url, api_key="k")
        )
        with sp.Episode("Hanoi3Disk-v0", seed=7) as episode, made as player:
            assert sp.play(episode, player).score == 3
    assert server.refused == 1


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
