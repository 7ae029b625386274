"""Faults between a model and a game, with the real client and a real server: none of them loses an episode.

Each fault is one answer of a server; before and after it the rule player answers. An episode must then either go on as
if nothing had happened, the extra requests counted, or end with a sentence that says why - and its record must replay.
"""

from __future__ import annotations

import asyncio
import json
import random
import time
from email.utils import formatdate

import pytest

import smartplay_tools as sp

pytest.importorskip("openai")

import httpx2
import openai
import smartplay_gateway as sg
import smartplay_openai as so

from smartplay_tools.players.attempts import Attempts
from smartplay_tools.players.cut_prompts import CutPrompts

GAME = "Hanoi3Disk-v0"
STEPS = 7


class Faulty:
    """The endpoint of the rule player, with faults in the way of its first requests, or of all of them."""

    def __init__(self, *faults, always=None):
        self.endpoint = sg.endpoint_app(sp.get_player("rule"))
        self.faults, self.always = list(faults), always
        self.requests = []

    def fault(self, body):
        """What is in the way of a request; None if nothing is."""
        return self.faults.pop(0) if self.faults else self.always

    async def __call__(self, scope, receive, send):
        body = json.loads((await receive())["body"])
        self.requests.append((scope["path"], body))
        if (fault := self.fault(body)) is not None:
            return await fault(send, body)
        sent = False

        async def again():
            nonlocal sent
            if sent:
                return await receive()
            sent = True
            return {"type": "http.request", "body": json.dumps(body).encode(), "more_body": False}

        return await self.endpoint(scope, again, send)


def answer(body, status=200, kind="application/json", **headers):
    sent = body if isinstance(body, bytes) else (body if isinstance(body, str) else json.dumps(body)).encode()
    fields = {"content-type": kind, **{name.replace("_", "-"): value for name, value in headers.items()}}

    async def fault(send, request):
        encoded = [(name.encode(), value.encode()) for name, value in fields.items()]
        await send({"type": "http.response.start", "status": status, "headers": encoded})
        await send({"type": "http.response.body", "body": sent})

    return fault


def problem(status, code=None, **headers):
    return answer({"error": {"message": "No.", "type": "error", "code": code}}, status, **headers)


async def silence(send, request):
    await asyncio.sleep(1)


def cut(*parts, kind="text/event-stream"):
    """An answer that ends early: it is shorter than its announced length."""

    async def fault(send, request):
        headers = [(b"content-type", kind.encode()), (b"content-length", b"99999")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        for part in parts:
            await send({"type": "http.response.body", "body": part.encode(), "more_body": True})

    return fault


def chunk(**delta):
    return f"data: {json.dumps({'choices': [{'index': 0, 'delta': delta, 'finish_reason': None}]})}\n\n"


def play(faulty, tmp_path, player="openai:rule", **options):
    """Play Hanoi through a faulty server; return the result, the server's requests and the events of the record."""
    path = tmp_path / "run.jsonl"
    settings = {"pause": 0.01, **options}
    budget = settings.pop("budget", sp.Budget())
    with (
        sg.LocalEndpoint(app=faulty) as endpoint,
        sp.get_player(player, base_url=endpoint.base_url, **settings) as model,
        sp.Episode(GAME, seed=7, transcript=path, budget=budget) as episode,
    ):
        result = sp.play(episode, model)
    events = sp.read_transcript(path)
    assert events[-1]["event"] == "end"
    assert events[-1]["result"]["end_reason"] == result.end_reason
    assert sp.replay(path).identical
    return result, events


def assert_as_if_nothing_had_happened(result, extra_requests):
    assert (result.end_reason, result.score, result.steps, result.error) == ("terminated", 3, STEPS, None)
    assert (result.illegal_actions, result.malformed_calls, result.idle_replies) == (0, 0, 0)
    assert result.tokens.provider.requests == result.turns + extra_requests


def assert_given_up(result, *words):
    assert result.end_reason == "player_error"
    assert (result.steps, result.illegal_actions, result.malformed_calls) == (0, 0, 0)
    for word in words:
        assert word in result.error


# Temporary faults.


TROUBLE = {
    "retry wanted": problem(400, x_should_retry="true"),
    "a page": answer("<html>Bad gateway</html>", kind="text/html"),
    "half a body": answer("{", kind="application/json"),
    "not UTF-8": answer('{"é": 1}'.encode("latin-1")),
    "a body that breaks off": cut('{"id": "c", "choi', kind="application/json"),
}


@pytest.mark.parametrize(
    ("fault", "player", "stream"),
    [
        *((fault, "openai:rule", False) for fault in TROUBLE),
        *(
            pytest.param(fault, f"{player}:rule", stream, marks=pytest.mark.slow)
            for player, stream in (("openai-responses", True), ("openai", True), ("openai-responses", False))
            for fault in ("a page", "a body that breaks off")
        ),
    ],
)
def test_a_server_in_trouble_is_asked_again_and_every_request_counted(fault, player, stream, tmp_path):
    faulty = Faulty(TROUBLE[fault], TROUBLE[fault])
    result, _ = play(faulty, tmp_path, player, stream=stream)
    assert_as_if_nothing_had_happened(result, extra_requests=2)
    assert len(faulty.requests) == result.tokens.provider.requests


@pytest.mark.parametrize("player", ["openai:rule", "openai-responses:rule"])
def test_a_request_that_times_out_is_sent_again(player, tmp_path):
    result, _ = play(Faulty(silence), tmp_path, player, timeout=0.3)
    assert_as_if_nothing_had_happened(result, extra_requests=1)


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(cut(chunk(role="assistant", content="I thi")), id="line breaks"),
        pytest.param(
            answer(chunk(role="assistant", content="I thi"), kind="text/event-stream"),
            id="ends early",
            marks=pytest.mark.slow,
        ),
        pytest.param(answer("data: [DONE]\n\n", kind="text/event-stream"), id="nothing", marks=pytest.mark.slow),
        pytest.param(answer('data: {"error": {"message": "Overloaded."}}\n\n', kind="text/event-stream"), id="error"),
        pytest.param(answer("data: {half\n\n", kind="text/event-stream"), id="not json"),
        pytest.param(
            answer("data: é\n\n".encode("latin-1"), kind="text/event-stream"), id="not UTF-8", marks=pytest.mark.slow
        ),
    ],
)
@pytest.mark.parametrize("player", [pytest.param("openai:rule", marks=pytest.mark.slow), "openai-responses:rule"])
def test_a_cut_stream_is_asked_for_again(fault, player, tmp_path):
    result, _ = play(Faulty(fault), tmp_path, player, stream=True)
    assert_as_if_nothing_had_happened(result, extra_requests=1)


@pytest.mark.parametrize("contents", [[[{"type": "thinking", "thinking": "Hm"}], 7], ["I thi", {"text": "nk"}]])
def test_a_stream_whose_content_is_neither_text_nor_parts_is_asked_for_again(contents, tmp_path):
    chunks = [*(chunk(content=content) for content in contents), chunk(finish_reason="stop")]
    result, _ = play(Faulty(answer("".join(chunks), kind="text/event-stream")), tmp_path, stream=True)
    assert_as_if_nothing_had_happened(result, extra_requests=1)


ENDED = {"message": {"role": "assistant", "content": "I thi"}}


@pytest.mark.parametrize(
    "body",
    [
        *({"choices": choices} for choices in ([], None, [{"message": None}], [None])),
        *([], "text", {"choices": [{**ENDED, "finish_reason": "error"}]}),
    ],
    ids=repr,
)
def test_a_completion_without_a_reply_is_asked_for_again(body, tmp_path):
    result, _ = play(Faulty(answer(json.dumps(body))), tmp_path)
    assert_as_if_nothing_had_happened(result, extra_requests=1)


@pytest.mark.parametrize(
    ("player", "body"),
    [
        ("openai:rule", {"error": {"message": "The provider is down.", "code": 502}}),
        ("openai:rule", {"error": "The provider is down."}),
        (
            "openai:rule",
            {"choices": [{**ENDED, "finish_reason": "error", "error": {"message": "The provider is down."}}]},
        ),
        ("openai-responses:rule", {"status": "failed", "error": {"message": "The provider is down."}}),
        ("openai-responses:rule", {"error": "The provider is down."}),
    ],
)
def test_what_a_server_says_went_wrong_is_told(player, body, tmp_path):
    result, _ = play(Faulty(always=answer(body)), tmp_path, player, retries=0)
    assert_given_up(result, "in 1 attempt: BrokenAnswerError: ", "The provider is down")


@pytest.mark.parametrize(
    ("player", "body"),
    [
        (
            "openai:rule",
            {"choices": [{"message": {"role": "assistant", "content": [7]}, "finish_reason": "length"}]},
        ),
        ("openai:rule", {"choices": [{"message": {"role": "assistant", "tool_calls": ["act"]}}]}),
        ("openai:rule", {"choices": []}),
        (
            "openai-responses:rule",
            {"status": "completed", "output": [{"type": "message", "content": [7]}]},
        ),
    ],
)
def test_what_a_reply_cost_that_cannot_be_one_is_counted(player, body, tmp_path):
    usage = {"prompt_tokens": 5000, "input_tokens": 5000, "completion_tokens": 1, "output_tokens": 1}
    result, _ = play(Faulty(answer({**body, "usage": usage})), tmp_path, player)
    assert_as_if_nothing_had_happened(result, extra_requests=1)
    assert result.tokens.provider.prompt == result.tokens.prompt + 5000
    assert result.tokens.provider.cut == 0


def as_stream(body):
    """A completion as the chunks of a stream, and as the text of an answer."""
    (choice,) = body["choices"]
    calls = [{**call, "index": at} for at, call in enumerate(choice["message"].get("tool_calls", ()))]
    delta = {**choice["message"], **({"tool_calls": calls} if calls else {})}
    chunks = [
        {"choices": [{"index": 0, "delta": delta, "finish_reason": choice["finish_reason"]}]},
        {"choices": [], "usage": body["usage"]},
    ]
    return "".join(f"data: {json.dumps(chunk)}\n\n" for chunk in chunks) + "data: [DONE]\n\n"


class Changing(Faulty):
    """The endpoint of the rule player behind a server that changes its answers."""

    kind = "application/json"

    def changed(self, body):
        """What is answered in place of a body."""
        raise NotImplementedError

    async def __call__(self, scope, receive, send):
        sent = []

        async def keep(event):
            sent.append(event)

        await super().__call__(scope, receive, keep)
        body = json.loads(b"".join(event.get("body", b"") for event in sent))
        await answer(self.changed(body), sent[0]["status"], kind=self.kind)(send, None)


class Deaf(Changing):
    """The endpoint of the rule player behind a server that does not look at `stream`."""

    def __init__(self, streams, kind):
        super().__init__()
        self.streams, self.kind = streams, kind

    async def __call__(self, scope, receive, send):
        asked = json.loads((await receive())["body"])

        async def whole():
            return {"type": "http.request", "body": json.dumps({**asked, "stream": False}).encode()}

        await super().__call__(scope, whole, send)

    def changed(self, body):
        return as_stream(body) if self.streams else body


@pytest.mark.parametrize(
    ("player", "stream", "streams", "kind"),
    [
        ("openai:rule", False, True, "text/event-stream"),
        ("openai:rule", False, True, "application/json"),
        ("openai:rule", True, False, "application/json"),
        ("openai-responses:rule", True, False, "application/json"),
    ],
)
def test_a_stream_that_was_not_asked_for_is_read_and_so_is_the_reverse(player, stream, streams, kind, tmp_path):
    result, _ = play(Deaf(streams, kind), tmp_path, player, stream=stream)
    assert_as_if_nothing_had_happened(result, extra_requests=0)


def test_a_server_that_cuts_prompts_is_said_once(caplog):
    class Cutting(Changing):
        def changed(self, body):
            count = min(300, body["usage"]["prompt_tokens"])
            return {**body, "usage": {**body["usage"], "prompt_tokens": count, "total_tokens": 0}}

    with sg.LocalEndpoint(app=Cutting()) as endpoint, sp.get_player("openai:rule", base_url=endpoint.base_url) as model:
        for seed in (7, 8):
            with sp.Episode(GAME, seed=seed) as episode:
                sp.play(episode, model)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "300 tokens" in caplog.text
    assert "num_ctx" in caplog.text


def test_prompts_of_one_size_are_no_cut_prompts(caplog):
    counts = CutPrompts("openai:m")
    for size in (752, 700, 755, 720):
        counts.note(size, sp.Usage(prompt=450))  # the model's server is sent no schemas of tools
    assert not caplog.records
    counts.note(900, sp.Usage(prompt=450))
    assert caplog.messages[0].startswith("The server of openai:m has counted 450 tokens in prompts of about 752")


@pytest.mark.parametrize(
    "url", ["localhost:11434/v1", "gpu7/v1", "ftp://x/v1", "http:/x", "http://[x/v1", "http://x:y/v1"]
)
@pytest.mark.parametrize("player", ["openai:m", "openai-responses:m", "anthropic:m"])
def test_an_address_that_is_none_is_said(player, url, monkeypatch):
    with pytest.raises(sp.InvalidArgumentError, match=r"^--base-url .* begin with http:// or https://, as in http"):
        sp.get_player(player, base_url=url, api_key="k")
    name = "ANTHROPIC_BASE_URL" if player == "anthropic:m" else "OPENAI_BASE_URL"
    monkeypatch.setenv(name, url)
    with pytest.raises(sp.InvalidArgumentError, match=f"^{name} "):
        sp.get_player(player, api_key="k")


# Permanent faults.


@pytest.mark.parametrize(
    ("fault", "attempts", "words"),
    [
        pytest.param(problem(429, retry_after="0"), "3 attempts", "RateLimitError", id="429"),
        pytest.param(answer({"choices": []}), "2 attempts", "no choice with a message", id="empty choices"),
        pytest.param(problem(429, "insufficient_quota"), "1 attempt", "RateLimitError", id="no quota"),
        pytest.param(problem(429, retry_after="3600"), "1 attempt", "RateLimitError", id="an hour"),
        pytest.param(problem(503, x_should_retry="false"), "1 attempt", "InternalServerError", id="not wanted"),
        pytest.param(problem(401), "1 attempt", "AuthenticationError", id="401"),
        pytest.param(problem(400), "1 attempt", "BadRequestError", id="400"),
    ],
)
def test_a_model_that_never_answers_ends_the_episode_with_a_sentence(fault, attempts, words, tmp_path):
    faulty = Faulty(always=fault)
    result, _ = play(faulty, tmp_path, retries=2)
    assert_given_up(result, f"in {attempts}: ", words)
    assert f"{len(faulty.requests)} attempt" in attempts
    assert result.tokens.provider.requests == len(faulty.requests)


# Pauses.


def refusal(**headers):
    fields = {name.replace("_", "-"): value for name, value in headers.items()}
    request = httpx2.Request("POST", "http://localhost")
    response = httpx2.Response(429, headers=fields, request=request)
    return openai.RateLimitError("No.", response=response, body=None)


def test_the_server_says_how_long_to_wait():
    def pause(**headers):
        attempts = Attempts(4, 0.5, random.Random(0))
        attempts.begin()
        return attempts.pause(refusal(**headers))

    assert pause(retry_after="7") == 7
    assert pause(retry_after="0.5") == 0.5
    assert pause(retry_after_ms="250", retry_after="1") == 0.25
    assert 25 < pause(retry_after=formatdate(time.time() + 30, usegmt=True)) <= 30
    assert pause(retry_after=formatdate(time.time() - 30, usegmt=True)) == 0
    for nonsense in ("soon", "nan", "", "Mon, 99999999999999999999 Jan 2020 00:00:00 GMT"):
        assert 0.375 <= pause(retry_after=nonsense) <= 0.5
    assert pause(retry_after_ms="nan", retry_after="7") == 7


def test_pauses_double_up_to_a_limit():
    attempts, pauses = Attempts(9, 0.5, random.Random(0)), []
    for _ in range(8):
        attempts.begin()
        pauses.append(attempts.pause(refusal()))
    for pause, longest in zip(pauses, [0.5, 1, 2, 4, 8, 8, 8, 8], strict=True):
        assert 0.75 * longest <= pause <= longest


# What a model may say.


def test_of_several_choices_in_a_stream_the_first_is_the_reply():
    chunks = [
        {"choices": [{"index": number, "delta": {"content": text}, "finish_reason": why}]}
        for number, text, why in [(0, "One", None), (1, "Two", None), (0, ".", "stop"), (1, "...", "length")]
    ]
    reply = so.chat_reply(so.CHAT.assemble(chunks))
    assert reply == sp.Reply({"role": "assistant", "content": "One."}, None)


# Proxies.


def test_a_proxy_in_the_environment_is_not_asked_for_this_machine(monkeypatch, tmp_path):
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    result, _ = play(Faulty(), tmp_path)
    assert_as_if_nothing_had_happened(result, extra_requests=0)


def test_a_proxy_in_the_environment_is_asked_for_any_other(monkeypatch):
    class Proxy(Faulty):
        async def __call__(self, scope, receive, send):
            hosts.append(dict(scope["headers"])[b"host"])
            here = {"path": "/v1/chat/completions", "headers": [(b"host", b"localhost")]}
            await super().__call__({**scope, **here}, receive, send)

    hosts = []
    with sg.LocalEndpoint(app=Proxy()) as proxy:
        monkeypatch.setenv("HTTP_PROXY", proxy.base_url.removesuffix("/v1"))
        monkeypatch.delenv("NO_PROXY", raising=False)
        url = "http://models.example/v1"
        with sp.get_player("openai:rule", base_url=url, api_key="none") as player, sp.Episode(GAME, seed=7) as episode:
            assert sp.play(episode, player).completed
    assert set(hosts) == {b"models.example"}
