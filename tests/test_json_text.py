"""JSON text: NaN is refused where it has to be, and the fast parser reads what `json.loads` reads."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, strategies as st

from smartplay_tools.files.lines import parse_json
from smartplay_tools.types.arguments import encoder, object_in, value_in

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(st.characters(codec=None)),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(st.characters(codec=None)), inner, max_size=4),
    max_leaves=12,
)
"""Lone surrogates included, which models write."""


def test_an_encoder_without_nan_refuses_it():
    for value in (math.nan, [math.inf], {"a": -math.inf}):
        assert encoder()(value) == json.dumps(value)
        with pytest.raises(ValueError, match="JSON compliant"):
            encoder(nan=False)(value)


@given(value=VALUES, in_ascii=st.booleans())
def test_the_parser_reads_what_json_reads(value, in_ascii):
    text = json.dumps(value, ensure_ascii=in_ascii)
    assert same(parse_json(text), json.loads(text))


def test_the_parser_reads_half_a_surrogate_pair_that_is_not_escaped():
    assert parse_json('["\ud800"]') == json.loads('["\ud800"]') == ["\ud800"]


def same(one: object, other: object) -> bool:
    """Equal in types, in the order of keys and in the sign of zero."""
    return repr(one) == repr(other)


BARELY = (
    "NaN",
    "-Infinity",
    "1e400",
    "-0",
    "-0.0",
    "1E5",
    "9" * 400,
    '{"a": 1, "b": 2, "a": 3}',
    '"\\ud800"',
    " [1 ] ",
)
TOO_DEEP_FOR_ONE = "[" * 300 + "]" * 300
REFUSED = ("", "[1,]", "01", "+1", ".5", "1.", '"\t"', "{'a': 1}", "[1] [2]", "9" * 5000, "nul")


@pytest.mark.parametrize("text", [*BARELY, TOO_DEEP_FOR_ONE])
def test_the_parser_reads_what_is_barely_json(text):
    assert same(parse_json(text), json.loads(text))
    assert same(parse_json(text.encode()), json.loads(text.encode()))


@pytest.mark.parametrize("text", REFUSED)
def test_the_parser_refuses_what_json_refuses(text):
    for read in (json.loads, parse_json):
        for sent in (text, text.encode()):
            with pytest.raises(ValueError, match=r"line 1|4300 digits"):
                read(sent)


@pytest.mark.parametrize("text", ["", "[1]", "nonsense", "[" * 100_000, b"\xff", "1e999"])
def test_what_is_no_object_is_none(text: str | bytes):
    assert object_in(text) is None


def test_what_is_no_json_is_text():
    assert object_in(bytearray(b'{"a": [1]}')) == {"a": [1]}
    assert [value_in(text) for text in ("1", "one", "[" * 100_000)] == [1, "one", "[" * 100_000]
