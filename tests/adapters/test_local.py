"""A model file as a player. `.ci/framework local` has an environment with llama.cpp and the model."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("xllamacpp", reason="needs smartplay-tools[local]; `.ci/run` has an environment with it")

from smartplay_local import LocalPlayer, LocalServer, measure
from smartplay_local.engine import shared_server
from smartplay_local.model_files import KNOWN_MODELS, find_model, read_gguf
from smartplay_local.text import as_text, call_in, grammar_of
from smartplay_openai import LocalEndpoint, chat_reply

import smartplay_tools as sp
from smartplay_tools.context.tokens import get_tokenizer
from smartplay_tools.players import get_player
from tests.dialects.rules import DIALECTS
from tests.dialects.scripts import HOSTILE, ODD, SOLVED
from tests.dialects.server import whole_answer

MODEL = KNOWN_MODELS["smollm2-135m"]
GAME = "RockPaperScissorBasic-v0"

needs_model = pytest.mark.skipif(not MODEL.is_here, reason="needs `smartplay-tools model get`")


@pytest.fixture(scope="module")
def server() -> LocalServer:
    return shared_server(find_model(), None, 1)


@needs_model
def test_the_model_is_the_one_that_was_published():
    assert MODEL.is_intact
    assert MODEL.path.stat().st_size == MODEL.bytes
    assert read_gguf(MODEL.path).context_length == 8192


@needs_model
def test_it_plays_a_short_episode_whose_calls_are_well_formed(tmp_path):
    record = tmp_path / "one.jsonl"
    budget = sp.Budget(prompt_tokens=900, tool_calls=6)
    with sp.Episode(GAME, seed=3, budget=budget, transcript=record) as episode:
        result = sp.play(episode, get_player("local", threads=1))
    assert (result.error, result.end_reason) == (None, "tool_calls")
    assert (result.malformed_calls, result.idle_replies) == (0, 0)
    provider = result.tokens.provider
    assert provider is not None
    assert provider.requests == result.turns
    assert provider.cached > 0, "the engine reads the beginning of a prompt once"
    assert sp.read_transcript(record)[0]["config"]["player"] == "local:smollm2-135m"
    assert sp.replay(record).identical


@needs_model
def test_a_draw_depends_on_the_seed_only():
    with sp.Episode(GAME, seed=3) as episode:
        prompt = sp.Conversation(episode).prompt()
    assert prompt is not None
    replies = [LocalPlayer(threads=1, temperature=1.5, seed=seed).reply(prompt).message for seed in (1, 1, 2, 3, 4)]
    calls = [json.dumps(reply["tool_calls"][0]["function"]) for reply in replies]
    assert calls[0] == calls[1]
    assert len(set(calls)) > 1


@needs_model
def test_the_vocabulary_counts_what_the_engine_counts(server):
    tokenizer = get_tokenizer("gguf:smollm2-135m")
    texts = ["Hello  world\n\n12 things", "  a\tb\r\n\r\n  c ", "naïve ½ ² ٣ 漢字 🙂", "<|im_start|>user WE'RE"]
    for game in ("RockPaperScissorBasic-v0", "MessengerL2-v0", "Hanoi3Disk-v0", "Crafter-v0"):
        with sp.Episode(game, seed=1) as episode:
            texts += [episode.manual_text, episode.call("observe").text]
    assert [tokenizer.count(text) for text in texts] == [server.tokens(text) for text in texts]


@needs_model
def test_an_episode_is_counted_with_the_models_vocabulary():
    with sp.Episode(GAME, seed=1, tokenizer="gguf:smollm2-135m", budget=sp.Budget(prompt_tokens=900)) as episode:
        assert sp.play(episode, get_player("rule")).end_reason == "rollout"
        assert episode.config.tokenizer_sha256 == get_tokenizer("gguf:smollm2-135m").sha256


@needs_model
def test_it_is_a_model_for_programs_that_take_a_base_url():
    with (
        LocalEndpoint(LocalPlayer(threads=1)) as endpoint,
        sp.Episode(GAME, seed=3, budget=sp.Budget(tool_calls=2)) as e,
    ):
        result = sp.play(e, get_player("openai:local:smollm2-135m", base_url=endpoint.base_url))
    assert (result.error, result.tool_calls, result.malformed_calls) == (None, 2, 0)


@needs_model
@pytest.mark.slow
@pytest.mark.parametrize("stream", [False, True], ids=["whole", "streamed"])
def test_the_engine_takes_every_prompt_whatever_its_model_has_said(server, stream):
    """A real llama.cpp as a server: after each hostile reply it gets the next prompt, and replies."""
    said = [*map(HOSTILE.get, ("broken JSON", "NaN", "another tool", "nothing")), SOLVED[0], ODD["empty arguments"]]
    budget = sp.Budget(prompt_tokens=900, reply_tokens=4)
    asks = sp.get_player("openai:smollm2", base_url=server.base_url, stream=stream, retries=0)
    with asks, sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget) as episode:
        conversation = sp.Conversation(episode)
        for number, reply in enumerate(said):
            assert asks.reply(conversation.prompt()).usage.prompt > 0
            conversation.receive(chat_reply(whole_answer(DIALECTS["llama.cpp"], reply, number)).message)
        assert asks.reply(conversation.prompt()).usage.prompt > 0
        assert episode.stats.steps == 1


@needs_model
def test_speed_is_measured():
    assert min(measure(MODEL.path, tokens=4).values()) > 0


@needs_model
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"context": 10_000}, "between 1 and 8,192"),
        ({"threads": 0}, "threads is at least 1"),
        ({"base_url": "http://127.0.0.1"}, "takes no base_url"),
    ],
    ids=str,
)
def test_options_that_cannot_be_are_refused(options, message):
    with pytest.raises(sp.InvalidArgumentError, match=message):
        get_player("local", **options)


@needs_model
def test_a_model_that_does_not_fit_is_refused_before_it_is_loaded(monkeypatch):
    monkeypatch.setattr("smartplay_local.engine.free_memory", lambda: 200_000_000)
    with pytest.raises(sp.InvalidArgumentError, match=r"0\.2 GB are free: choose a smaller context"):
        get_player("local")


@needs_model
def test_a_file_that_the_engine_cannot_load_is_refused(tmp_path):
    damaged = tmp_path / "damaged.gguf"
    content = bytearray(MODEL.path.read_bytes())
    at = content.index(b"token_embd.weight")
    content[at : at + 5] = b"other"
    damaged.write_bytes(content)
    with pytest.raises(sp.InvalidArgumentError, match=r"llama\.cpp could not load damaged\.gguf"):
        LocalServer(damaged, threads=1)


def test_messages_become_text_that_any_template_can_write():
    with sp.Episode(GAME, seed=1) as episode:
        tools = episode.tools
    call = {"id": "1", "type": "function", "function": {"name": "act", "arguments": '{"action": "Rock"}'}}
    messages = [
        {"role": "system", "content": "S"},
        {"role": "user", "content": "U"},
        {"role": "assistant", "content": None, "tool_calls": [call]},
        {"role": "tool", "content": "R", "tool_call_id": "1"},
        {"role": "user", "content": "Go on."},
    ]
    written = as_text(messages, tools)
    assert [message["role"] for message in written] == ["system", "user", "assistant", "user"]
    assert all(tool.description in written[0]["content"] for tool in tools)
    assert written[2]["content"] == '{"name": "act", "arguments": {"action": "Rock"}}'
    assert written[3]["content"] == "R\n\nGo on."
    assert as_text(messages[:2], ()) == messages[:2]
    assert messages[0]["content"] == "S", "the prompt itself is unchanged"


def test_a_reply_that_was_cut_is_no_call():
    assert call_in('{"name":"act","arguments":{"action":"Rock"}}') == {"name": "act", "arguments": '{"action": "Rock"}'}
    assert call_in('{"name":"act","argum') is None
    assert call_in("[1]") is None


def test_the_grammar_names_every_tool_and_bounds_its_texts():
    with sp.Episode(GAME, seed=1, budget=sp.Budget(history=3, notes_tokens=100)) as episode:
        grammar = grammar_of(episode.tools)
        assert all(tool.name in grammar for tool in episode.tools)
    assert '"maxLength":64' in grammar
    assert '"maxLength":2000' in grammar


def test_a_text_that_may_be_null_has_an_end_too():
    with sp.Episode(GAME, seed=1, budget=sp.Budget(memory_tokens=50)) as episode:
        grammar = grammar_of(episode.tools[-1:])
    assert (
        grammar.count('"maxLength":2000') == grammar.count('"type":"string"') - 1
    )  # the command is one of a few words


def test_a_missing_file_is_said_before_anything_is_played(tmp_path, monkeypatch):
    monkeypatch.setenv("SMARTPLAY_MODELS", str(tmp_path))
    with pytest.raises(sp.InvalidArgumentError, match=r"model get smollm2-135m` downloads it \(98 MB\)"):
        get_player("local")
    with pytest.raises(sp.InvalidArgumentError, match="There is no model file"):
        get_player(f"local:{Path('nowhere.gguf')}")
