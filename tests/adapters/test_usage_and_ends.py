"""What servers report beside a reply: tokens under every provider's name, and why the reply ended."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import smartplay_openai as so
from smartplay_anthropic.codec import reply as anthropic_reply
from smartplay_gateway import LocalEndpoint

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.conversation.base import checked_usage
from smartplay_tools.players import asks_management
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.rows import warnings
from smartplay_tools.types.messages import text_of
from tests.evaluation.command import refused, shown_by
from tests.evaluation.runs import play_row


def chat(usage: Any = None, finish: str = "stop", **message: Any) -> sp.Reply:
    said = {"role": "assistant", "content": None, **message}
    return so.chat_reply({"choices": [{"message": said, "finish_reason": finish}], "usage": usage})


COUNTS = {"prompt_tokens": 100, "completion_tokens": 5}


@pytest.mark.parametrize(
    ("reported", "cached", "written"),
    [
        ({}, None, 0),
        ({"prompt_tokens_details": None}, None, 0),
        ({"prompt_tokens_details": {"cached_tokens": None}}, None, 0),
        ({"prompt_tokens_details": {"cached_tokens": 0}}, 0, 0),
        ({"prompt_tokens_details": {"cached_tokens": "80"}}, 80, 0),
        ({"prompt_cache_hit_tokens": 80, "prompt_cache_miss_tokens": 20}, 80, 0),
        ({"cached_tokens": 80}, 80, 0),
        ({"num_cached_tokens": 80}, 80, 0),
        ({"cache_read_input_tokens": 80, "cache_creation_input_tokens": 10}, 80, 10),
        ({"prompt_tokens_details": {"cached_tokens": 80, "cache_creation_tokens": 10}}, 80, 10),
        ({"prompt_tokens_details": {"cached_tokens": "many"}}, None, 0),
        ({"prompt_tokens": "100", "completion_tokens": "5", "total_tokens": "105"}, None, 0),
    ],
)
def test_cached_tokens_are_read_under_every_name_and_unknown_is_not_nothing(reported, cached, written):
    usage = chat({**COUNTS, **reported}).usage
    assert (usage.prompt, usage.reply, usage.cached, usage.written) == (100, 5, cached, written)


BESIDE = {"completion_tokens": 10, "completion_tokens_details": {"reasoning_tokens": 400}}


@pytest.mark.parametrize(
    ("reported", "counted"),
    [
        ({**BESIDE, "prompt_tokens": 90, "total_tokens": 500}, (90, 410, 400)),  # xAI
        ({**BESIDE, "prompt_tokens": 90, "total_tokens": 100}, (90, 410, 400)),  # thoughts are in no sum
        ({**BESIDE, "prompt_tokens": 90}, (90, 410, 400)),
        ({"prompt_tokens": 90, "completion_tokens": 0, "total_tokens": 590}, (90, 500, 500)),  # Gemini
        ({**BESIDE, "completion_tokens": 500, "prompt_tokens": 90, "total_tokens": 590}, (90, 500, 400)),  # OpenAI
        ({**BESIDE, "completion_tokens": 500, "prompt_tokens": 90, "total_tokens": 990}, (90, 900, 400)),
        ({"prompt_tokens": 20, "completion_tokens": 5, "total_tokens": 105, "cached_tokens": 80}, (100, 5, 0)),
        ({"prompt_tokens": 90, "completion_tokens": 10, "total_tokens": 7}, (90, 10, 0)),
        ({"prompt_tokens": 90, "completion_tokens": 10, "total_tokens": "many"}, (90, 10, 0)),
    ],
)
def test_the_total_says_whether_thoughts_are_a_part_of_the_reply(reported, counted):
    usage = chat(reported).usage
    assert (usage.prompt, usage.reply, usage.reasoning) == counted
    assert usage.is_possible
    names = {"prompt_tokens": "input_tokens", "completion_tokens": "output_tokens"}
    renamed = {names.get(name, name): value for name, value in reported.items()}
    renamed["output_tokens_details"] = renamed.pop("completion_tokens_details", None)
    assert so.responses_reply({"output": [], "usage": renamed}).usage == usage


def test_a_compaction_is_billed_beside_the_reply_of_which_it_is_no_part():
    own = {"input_tokens": 90, "output_tokens": 10, "cache_read_input_tokens": 0}
    asked = {"type": "compaction", "input_tokens": 400, "output_tokens": 30, "cache_read_input_tokens": 70}
    iterations = [asked, {"type": "message", **own}, None]
    block = {"type": "compaction", "content": "Short."}
    usage = anthropic_reply({"content": [block], "usage": {**own, "iterations": iterations}}).usage
    assert usage is not None
    assert (usage.prompt, usage.reply, usage.cached, usage.requests, usage.managed) == (560, 40, 70, 1, 1)


def test_thoughts_that_are_more_than_their_reply_are_no_count():
    assert not sp.Usage(prompt=9, reply=10, reasoning=400).is_possible


def test_a_sum_with_an_unknown_part_is_unknown_and_costs_as_if_nothing_was_cached():
    known, unknown = sp.Usage(prompt=100, cached=80), sp.Usage(prompt=100, cached=None)
    assert (known + known).cached == 160
    assert (known + unknown).cached is (unknown + known).cached is None
    assert (sp.Usage(requests=1) + unknown + sp.Usage(requests=1)).cached is None
    assert (sp.Usage(requests=1) + known).cached == 80
    price = Price.per_million(2, 8, cached=0.2)
    assert price.cost(unknown) == price.cost(sp.Usage(prompt=100)) > price.cost(known)
    assert sp.Usage(**unknown.model_dump()) == unknown


def blocks(reason: str) -> sp.Reply:
    text = [{"type": "text", "text": "No."}]
    return anthropic_reply({"content": text, "stop_reason": reason, "usage": {"input_tokens": 9, "output_tokens": 4}})


def items(status: str = "completed", reason: str | None = None, kind: str = "output_text") -> sp.Reply:
    part = {"type": kind, "refusal" if kind == "refusal" else "text": "No."}
    output = [{"type": "message", "role": "assistant", "content": [part]}]
    return so.responses_reply({"status": status, "incomplete_details": reason and {"reason": reason}, "output": output})


@pytest.mark.parametrize(
    ("reply", "count"),
    [
        (chat(finish="length"), "cut"),
        (chat(finish="model_length"), "cut"),
        (chat(finish="content_filter"), "refused"),
        (chat(refusal="No."), "refused"),
        (chat(finish="content_filter: SAFETY"), "refused"),
        (chat(finish="function_call_filter: MALFORMED_FUNCTION_CALL"), "broken_calls"),
        (chat(finish="MALFORMED_FUNCTION_CALL"), "broken_calls"),
        (blocks("refusal"), "refused"),
        (blocks("pause_turn"), "paused"),
        (blocks("max_tokens"), "cut"),
        (blocks("model_context_window_exceeded"), "cut"),
        (anthropic_reply({"content": [], "stop_reason": "max_tokens"}), "cut"),
        (items(kind="refusal"), "refused"),
        (items("incomplete", "content_filter"), "refused"),
        (items("incomplete", "max_output_tokens"), "cut"),
    ],
)
def test_why_a_reply_ended_is_counted(reply, count):
    ends = ("cut", "refused", "broken_calls", "paused")
    assert {name: getattr(reply.usage, name) for name in ends} == dict.fromkeys(ends, 0) | {count: 1}


@pytest.mark.parametrize("reply", [chat(refusal="No."), items(kind="refusal"), blocks("refusal")])
def test_the_words_of_a_refusal_are_the_text_of_the_reply(reply):
    """Interfaces have them in a field or a part of their own, and they are counted as words."""
    assert text_of(reply.message) == "No."
    assert TokenCounter().message(reply.message) >= TokenCounter().message({"role": "assistant", "content": "No."})


class Refusing:
    """A player whose model refuses to play."""

    name = "refusing"

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        return chat(COUNTS, refusal="No.")


def test_an_episode_that_ends_in_refusals_says_so():
    """In its result, in the warnings of its row, and again in a replay."""
    events: list[Any] = []
    with sp.Episode("RockPaperScissorBasic-v0", seed=1, transcript=events) as episode:
        result = sp.play(episode, Refusing())
    assert (result.end_reason, result.tokens.provider.refused) == ("no_tool_call", 3)
    assert result.detail == "The last reply was refused by the model or a filter of its provider."
    assert sp.replay(events).identical


def test_the_table_names_the_refusals():
    unplayed, count = warnings(play_row("RockPaperScissorBasic-v0", Refusing()))
    assert "its replies were refused by the model or a filter of its provider" in unplayed
    assert count == "3 of 3 replies were refused by the model or a filter of its provider."


CLEARED = {"type": "clear_tool_uses_20250919", "cleared_tool_uses": 3, "cleared_input_tokens": 500}


def test_a_models_own_arguments_are_no_compaction():
    call = {"type": "tool_use", "id": "c1", "name": "act", "input": {"type": "compaction"}}
    assert checked_usage(None, {"role": "assistant", "content": "", "provider_items": [call]}) is None


@pytest.mark.parametrize(
    ("answer", "managed"),
    [
        ({"content": [{"type": "text", "text": "So."}]}, (0, 0, 0)),
        ({"content": [], "context_management": {"applied_edits": []}}, (0, 0, 0)),
        ({"content": [], "context_management": {"applied_edits": [CLEARED, CLEARED]}}, (1, 2, 1_000)),
        ({"content": [{"type": "compaction", "content": "Short."}]}, (1, 1, 0)),
        ({"content": [], "context_management": {"applied_edits": [3, {"cleared_input_tokens": -9}]}}, (1, 1, 0)),
        ({"output": [{"type": "compaction", "encrypted_content": "g"}]}, (1, 1, 0)),
    ],
)
def test_what_a_provider_did_to_the_context_is_read(answer: Any, managed: tuple[int, int, int]):
    told = {"stop_reason": "end_turn", "usage": {"input_tokens": 9, "output_tokens": 1}, **answer}
    usage = (so.responses_reply if "output" in answer else anthropic_reply)(told).usage
    assert usage is not None
    assert (usage.managed, usage.edits, usage.cleared) == managed


@pytest.mark.parametrize(
    ("options", "asks"),
    [
        ({"logit_bias": {50256: -100}}, False),
        ({"logit_bias": {50256: -100}, "extra_body": {"context_management": {"edits": []}}}, True),
        ({"logit_bias": {50256: -100}, "openai_context_management": [{"type": "compaction"}]}, True),
        ({"context_management": None}, False),
    ],
)
def test_whether_options_ask_a_provider_to_manage_the_context(options: dict[str, Any], asks: bool):
    assert asks_management(options) is asks


@pytest.mark.parametrize("kind", ["type", "part_kind"])
def test_a_compaction_in_a_reply_is_told_whoever_has_sent_it(kind: str):
    """As a provider's item, or deep in the reply as a framework keeps it."""
    item = {"type": "pydantic-ai", "response": {"parts": [{kind: "compaction", "content": "Short."}]}}
    with sp.Episode("RockPaperScissorBasic-v0", seed=1) as episode:
        conversation = sp.Conversation(episode)
        assert conversation.prompt() is not None
        conversation.receive({**sp.call("act", action="Rock"), "provider_items": [item]})
    assert episode.result.tokens.provider is not None
    assert (episode.result.tokens.provider.managed, episode.result.tokens.provider.edits) == (1, 1)


@pytest.mark.parametrize(
    ("player", "parameters"),
    [
        ("openai-responses:rule", {"context_management": [{"type": "compaction", "compact_threshold": 10**6}]}),
        ("openai:rule", {"extra_body": {"context_management": {"edits": []}}, "compaction": {"type": "summarize"}}),
    ],
)
def test_an_episode_whose_provider_was_asked_to_manage_it_says_so(
    tmp_path: Path, player: str, parameters: dict[str, Any]
):
    """In its row, in the tables and in what it would have cost, of which nothing is said."""
    served = LocalEndpoint(sp.get_player("rule"))
    with served, sp.get_player(player, base_url=served.base_url, parameters=parameters) as asked:
        row = play_row("RockPaperScissorBasic-v0", asked)
        told = f"parameters={json.dumps(parameters)}"
        command = ["eval", "--games", "RockPaperScissorBasic-v0", "--players", player, "--trials", "1"]
        command += ["--base-url", served.base_url, "--player-option", told, "--out", tmp_path / "a"]
        shown_by(*command, "--executor", "inline")
    assert row["tokens"]["provider"]["managed"] == row["turns"] > 0
    assert any("left to the provider's context management, which reports 0 edits" in each for each in warnings(row))
    shown = shown_by("results", tmp_path / "a")
    assert f"{player}~" in shown
    assert "no count is exact" in " ".join(shown.split())
    refused("cost", tmp_path / "a", "--cache", "anthropic-512")
