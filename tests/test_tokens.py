"""Budget tokens: exact, offline, the same in every framework."""

from __future__ import annotations

import hashlib
import inspect
import os
import subprocess
import sys

import pytest
import tiktoken
import tiktoken_ext.openai_public
from hypothesis import given
from hypothesis import strategies as st

import smartplay_tools as sp
from smartplay_tools import tokens

WORDS = sp.TokenCounter()


def test_the_vocabulary_is_the_one_that_tiktoken_pins():
    assert hashlib.sha256(tokens.vocabulary()).hexdigest() == tokens.VOCABULARY_SHA256
    assert tokens.VOCABULARY_SHA256 in inspect.getsource(tiktoken_ext.openai_public.o200k_base)


def test_the_encoding_is_tiktokens_own(tmp_path):
    """Give tiktoken our vocabulary through its cache folder, so that it builds its own encoding without a network."""
    url = "https://openaipublic.blob.core.windows.net/encodings/o200k_base.tiktoken"
    (tmp_path / hashlib.sha1(url.encode()).hexdigest()).write_bytes(tokens.vocabulary())
    script = (
        "import tiktoken; from smartplay_tools.tokens import _encoding\n"
        "theirs, ours = tiktoken.get_encoding('o200k_base'), _encoding('o200k_base')\n"
        "print(theirs._pat_str == ours._pat_str, theirs._special_tokens == ours._special_tokens,"
        " theirs._mergeable_ranks == ours._mergeable_ranks, theirs.n_vocab == ours.n_vocab)"
    )
    environment = {**os.environ, "TIKTOKEN_CACHE_DIR": str(tmp_path)}
    shown = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["True"] * 4


def test_a_message_costs_what_its_formula_says():
    n = WORDS.text
    assert WORDS.message({"role": "user", "content": "Play."}) == 3 + n("user") + n("Play.")
    assert WORDS.message({"role": "user", "content": "Play.", "name": "ann"}) == 3 + n("user") + n("Play.") + 1 + n(
        "ann"
    )
    parts = [{"type": "text", "text": "Pl"}, {"type": "text", "text": "ay."}]
    assert WORDS.message({"role": "user", "content": parts}) == WORDS.message({"role": "user", "content": "Play."})
    result = {"role": "tool", "content": "ok", "tool_call_id": "call_9f8e7d6c5b4a"}
    assert WORDS.message(result) == 3 + n("tool") + n("ok") + 8
    call = {"id": "x", "type": "function", "function": {"name": "act", "arguments": '{"action": "Rock"}'}}
    assert WORDS.message({"role": "assistant", "content": None, "tool_calls": [call]}) == (
        3 + n("assistant") + 3 + 8 + n("act") + n('{"action": "Rock"}')
    )


@pytest.mark.parametrize("sent", ['{"action":"Rock"}', '{ "action" : "Rock" }', {"action": "Rock"}])
def test_arguments_count_alike_however_they_are_spelled(sent):
    call = {"id": "x", "type": "function", "function": {"name": "act", "arguments": sent}}
    spelled = {**call, "function": {"name": "act", "arguments": '{"action": "Rock"}'}}
    message = {"role": "assistant", "content": "", "tool_calls": [call]}
    assert WORDS.message(message) == WORDS.message({**message, "tool_calls": [spelled]})


@pytest.mark.parametrize("sent", ['{"a": 1, "a": 1}', '{"a": NaN}', "[1,2]", '{"a"', '{"a": 1e999}'])
def test_arguments_that_are_no_object_count_as_sent(sent):
    call = {"id": "x", "type": "function", "function": {"name": "act", "arguments": sent}}
    message = {"role": "assistant", "content": None, "tool_calls": [call]}
    assert WORDS.message(message) == 3 + WORDS.text("assistant") + 3 + 8 + WORDS.text("act") + WORDS.text(sent)


def test_reasoning_counts_its_visible_text():
    plain = {"role": "assistant", "content": "Rock."}
    item = {"type": "reasoning", "summary": [{"type": "summary_text", "text": "Think."}], "encrypted_content": "gAAA"}
    assert WORDS.message({**plain, "provider_items": [item]}) == WORDS.message(plain) + WORDS.text("Think.")
    assert WORDS.message({**plain, "reasoning_content": "Think."}) == WORDS.message(plain) + WORDS.text("Think.")


def test_tools_cost_the_cookbooks_formula():
    with sp.Episode("RockPaperScissorBasic-v0", seed=0) as episode:
        observe, act, manual = episode.tools
        n = WORDS.text
        functions = sum(7 + n(f"{tool.name}:{tool.description.removesuffix('.')}") for tool in (observe, act, manual))
        action = act.parameters["properties"]["action"]
        expected = functions + 3 + 3 + n(f"action:string:{action['description'].removesuffix('.')}") + 12
        assert WORDS.tools(episode.tools) == expected
    assert WORDS.tools([]) == 0


def test_special_tokens_are_text():
    assert WORDS.text("<|endoftext|>") > 1


def test_images_are_refused():
    with pytest.raises(ValueError, match="text only"):
        WORDS.message({"role": "user", "content": [{"type": "image_url", "image_url": {"url": "x"}}]})


def test_long_runs_are_counted_in_pieces():
    text = "x" * 120_000
    encode = tiktoken.Encoding.encode_ordinary
    encoding = tokens._encoding(tokens.DEFAULT_TOKENIZER)
    assert WORDS.text(text) == 2 * len(encode(encoding, "x" * 50_000)) + len(encode(encoding, "x" * 20_000))


@given(st.text(st.characters(), max_size=60))
def test_any_text_can_be_counted_lone_surrogates_included(text):
    assert 0 <= WORDS.text(text) <= 4 * len(text) + 1


def test_no_text_is_tokenised_twice():
    class Counting:
        name = "counting"

        def __init__(self) -> None:
            self.texts: list[str] = []

        def count(self, text: str) -> int:
            self.texts.append(text)
            return len(text.split())

    tokenizer = Counting()
    with sp.Episode(
        "RockPaperScissorBasic-v0", seed=3, tokenizer=tokenizer, budget=sp.Budget(prompt_tokens=300)
    ) as episode:
        sp.play(episode, sp.get_player("random"))
    assert len(tokenizer.texts) == len(set(tokenizer.texts))


def test_tokenizers_by_name():
    assert sp.get_tokenizer("approximate").count("12345") == 2
    assert sp.get_tokenizer().name == "o200k_base"
    with pytest.raises(sp.UnknownNameError, match="did you mean o200k_base"):
        sp.get_tokenizer("o200k")
    with pytest.raises(sp.InvalidArgumentError, match="count"):
        sp.get_tokenizer(42)
