"""Calls that models write as text, in three formats; what cannot be read stays text."""

from __future__ import annotations

import pytest

pytest.importorskip("openai")
from smartplay_openai.text_calls import PARSERS, check_parser, with_calls

import smartplay_tools as sp

ACT = '{"name": "act", "arguments": {"action": "1"}}'

READ = [
    ("hermes", f"<tool_call>{ACT}</tool_call>", None, [("act", '{"action": "1"}')]),
    ("hermes", f"<think>act?</think>I go.\n<tool_call>\n{ACT}\n</tool_call>\n", "<think>act?</think>I go.", 1),
    ("hermes", f"<tool_call>{ACT}</tool_call>\n<tool_call>{ACT}", None, 2),
    (
        "hermes",
        f"<think><tool_call>{ACT}</tool_call>?</think>I go.<tool_call>{ACT}",
        f"<think><tool_call>{ACT}</tool_call>?</think>I go.",
        1,
    ),
    ("llama", '{"name": "act", "parameters": {"action": "1"}}', None, [("act", '{"action": "1"}')]),
    ("llama", f"<|python_tag|>{ACT}; {ACT}", None, 2),
    ("mistral", f"[TOOL_CALLS][{ACT}, {ACT}]", None, 2),
    (
        "mistral",
        'So. [TOOL_CALLS]act[ARGS]{"action": "1"}[TOOL_CALLS]observe[ARGS]{}',
        "So.",
        [
            ("act", '{"action": "1"}'),
            ("observe", "{}"),
        ],
    ),
]

TEXT = [
    ("hermes", "I call act."),
    ("hermes", '<tool_call>{"name": "act", "arguments": {"action": }</tool_call>'),
    ("hermes", f"<think><tool_call>{ACT}</tool_call></think> I wait."),
    ("llama", "Let me act: 1"),
    ("llama", f"{ACT} and then"),
    ("mistral", f"[{ACT}]"),
    ("mistral", "[TOOL_CALLS]act[ARGS]{broken"),
    pytest.param("mistral", "[TOOL_CALLS]act[ARGS]" + "[" * 100_000, id="mistral, nested too deeply"),
]


@pytest.mark.parametrize(("parser", "text", "words", "calls"), READ)
def test_calls_are_read(parser, text, words, calls):
    message = with_calls({"role": "assistant", "content": text}, parser)
    assert message["content"] == words
    read = [(call["function"]["name"], call["function"]["arguments"]) for call in message["tool_calls"]]
    assert len(read) == calls if isinstance(calls, int) else read == calls
    assert len({call["id"] for call in message["tool_calls"]}) == len(read)


@pytest.mark.parametrize(("parser", "text"), TEXT)
def test_what_cannot_be_read_stays_text(parser, text):
    message = {"role": "assistant", "content": text}
    assert with_calls(message, parser) is message


def test_calls_of_the_server_are_left_alone():
    message = sp.call("act", say=f"<tool_call>{ACT}</tool_call>")
    for parser in PARSERS:
        assert with_calls(message, parser) is message


def test_an_unknown_format_is_named():
    with pytest.raises(sp.InvalidArgumentError, match="hermes, llama, mistral"):
        check_parser("qwen")
