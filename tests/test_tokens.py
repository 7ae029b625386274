"""Budget tokens: exact, offline, the same in every framework."""

from __future__ import annotations

import hashlib
import inspect
import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
import tiktoken_ext.openai_public
from hypothesis import given, strategies as st

import smartplay_tools as sp
from smartplay_tools.context import tokens
from smartplay_tools.context.tokens import TokenCounter, get_tokenizer
from smartplay_tools.context.tokens.o200k import o200k_base
from smartplay_tools.errors import InvalidArgumentError, UnknownNameError
from smartplay_tools.types.arguments import well_formed
from tests.processes import printed_by

WORDS = TokenCounter()


def test_the_vocabulary_is_the_one_that_tiktoken_pins():
    assert hashlib.sha256(tokens.vocabulary()).hexdigest() == tokens.VOCABULARY_SHA256 == get_tokenizer().sha256
    assert tokens.VOCABULARY_SHA256 in inspect.getsource(tiktoken_ext.openai_public.o200k_base)


@pytest.mark.slow  # building both encodings takes two seconds
def test_the_encoding_is_tiktokens_own(tmp_path):
    """Give tiktoken our vocabulary through its cache folder, so that it builds its own encoding without a network."""
    url = "https://openaipublic.blob.core.windows.net/encodings/o200k_base.tiktoken"
    (tmp_path / hashlib.sha1(url.encode()).hexdigest()).write_bytes(tokens.vocabulary())
    script = (
        "import tiktoken; from smartplay_tools.context.tokens.o200k import o200k_base\n"
        "theirs, ours = tiktoken.get_encoding('o200k_base'), o200k_base()\n"
        "print(theirs._pat_str == ours._pat_str, theirs._special_tokens == ours._special_tokens,"
        " theirs._mergeable_ranks == ours._mergeable_ranks, theirs.n_vocab == ours.n_vocab)"
    )
    environment = {**os.environ, "TIKTOKEN_CACHE_DIR": str(tmp_path)}
    shown = printed_by(sys.executable, "-c", script, env=environment)
    assert shown.split() == ["True"] * 4


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


def test_special_tokens_are_text():
    assert WORDS.text("<|endoftext|>") > 1


def test_long_runs_are_counted_in_pieces():
    text = "x" * 120_000
    encode = o200k_base().encode_ordinary
    assert WORDS.text(text) == 2 * len(encode("x" * 50_000)) + len(encode("x" * 20_000))


# Invalid text: a model's JSON can contain a lone surrogate.

ANY_TEXT = st.text(st.characters() | st.characters(categories=["Cs"]), max_size=60)


@given(ANY_TEXT)
def test_surrogates_count_as_tiktoken_counts_them(text):
    assert WORDS.text(text) == len(o200k_base().encode_ordinary(text))


@given(ANY_TEXT)
def test_no_tokenizer_sees_a_surrogate(text):
    seen = []

    class Recording:
        name = "recording"

        def count(self, text: str) -> int:
            seen.append(text)
            return len(text.encode())

    counter = TokenCounter(Recording())
    call = {"id": "c", "type": "function", "function": {"name": text, "arguments": {text: text}}}
    message = {"role": "assistant", "content": text, "name": text, "reasoning_content": text, "tool_calls": [call]}
    assert counter.message(message) > 0
    assert all(text == text.encode().decode() for text in seen)


def test_a_pair_is_its_character_and_a_lone_one_the_replacement_character():
    assert well_formed("\ud83d" + "\ude00") == "\N{GRINNING FACE}"
    assert well_formed("a\ud83d") == "a\ufffd"
    assert well_formed("\ude00\ud83db") == "\ufffd\ufffdb"
    assert WORDS.text("\ud83d" + "\ude00") == WORDS.text("\N{GRINNING FACE}")


def test_the_memory_of_long_texts_is_bounded():
    counter = TokenCounter("approximate")
    tracemalloc.start()
    try:
        for number in range(3_000):
            assert counter.text(f"{number:010}" * 1_000) == 2_500
        assert tracemalloc.get_traced_memory()[0] < 8e6  # of 30 MB
    finally:
        tracemalloc.stop()


def test_tokenizers_by_name():
    assert get_tokenizer("approximate").count("12345") == 2
    assert get_tokenizer().name == "o200k_base"
    with pytest.raises(UnknownNameError, match="did you mean o200k_base"):
        get_tokenizer("o200k")
    with pytest.raises(sp.InvalidArgumentError, match="count"):
        get_tokenizer(42)


# Tokenizer objects of a user.


class Lengths:
    """Counts characters, as whatever type of number it was given."""

    def __init__(self, number: type, name: object = "lengths") -> None:
        self.number, self.name = number, name

    def count(self, text: str):
        return self.number(len(text))


@pytest.mark.parametrize("number", [int, np.int64, np.uint8, np.int16])
def test_whole_numbers_of_any_make_become_python_s(number):
    count = TokenCounter(Lengths(number)).text("four")
    assert (count, type(count)) == (4, int)


@pytest.mark.parametrize(
    "tokenizer",
    [Lengths(float), Lengths(str), Lengths(lambda n: -n), Lengths(lambda n: None), Lengths(int, name=5), Lengths],
)
def test_what_cannot_count_is_refused_when_an_episode_is_made(tokenizer):
    with pytest.raises(sp.InvalidArgumentError, match=r"(counts in whole numbers|does not have them)"):
        sp.Episode("Hanoi3Disk-v0", seed=1, tokenizer=tokenizer)


# Vocabularies that have to be downloaded.

OFFLINE = {"HTTPS_PROXY": "http://127.0.0.1:9", "HTTP_PROXY": "http://127.0.0.1:9", "HF_HUB_OFFLINE": "1"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("cl100k_base", "The vocabulary of cl100k_base could not be downloaded"),
        ("hf:gpt2", "hf:gpt2 is neither a file nor a folder here, and its tokenizer.json could not be downloaded"),
    ],
)
def test_offline_a_missing_vocabulary_is_one_sentence_before_the_episode_begins(name, sentence, tmp_path):
    script = f"import smartplay_tools as sp; sp.Episode('Hanoi3Disk-v0', seed=1, tokenizer={name!r})"
    folders = {"TIKTOKEN_CACHE_DIR": str(tmp_path / "tiktoken"), "HF_HOME": str(tmp_path / "hf")}
    environment = {**os.environ, **OFFLINE, **folders}
    shown = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert shown.stderr.splitlines()[-1].startswith(f"smartplay_tools.errors.InvalidArgumentError: {sentence}")


SCHEMAS = st.recursive(
    st.booleans()
    | st.fixed_dictionaries(
        {},
        optional={
            "type": st.sampled_from(["string", "integer", ["string", "null"]]),
            "description": st.none() | st.text(max_size=20),
            "enum": st.lists(st.none() | st.integers() | st.text(max_size=5), min_size=1, max_size=3),
            "$ref": st.just("#"),
        },
    ),
    lambda inner: st.fixed_dictionaries(
        {"type": st.just("object")},
        optional={"properties": st.dictionaries(st.text(max_size=5), inner, max_size=3), "items": inner, "not": inner},
    ),
    max_leaves=6,
)
"""JSON Schemas as tools of other people have them: nested, recursive, true and false."""


@given(st.dictionaries(st.text(max_size=5), SCHEMAS, max_size=4), st.text(max_size=20))
def test_any_json_schema_is_counted(properties, description):
    plain = sp.ToolSpec("tool", description, {"type": "object"})
    tool = sp.ToolSpec("tool", description, {"type": "object", "properties": properties})
    assert WORDS.tools([tool]) >= WORDS.tools([plain]) + (3 + 3 * len(properties) if properties else 0)


@pytest.mark.parametrize(
    "parameters",
    [
        {"properties": ["x"]},
        {"properties": {"x": "string"}},
        {"properties": {"x": {"description": 5}}},
        {"properties": {"x": {"enum": "abc"}}},
        ["x"],
    ],
)
def test_what_is_not_a_schema_is_refused_in_a_sentence(parameters):
    with pytest.raises(InvalidArgumentError, match=r"the tool 'tool' (is|are) not a JSON Schema"):
        WORDS.tools([sp.ToolSpec("tool", "", parameters)])
