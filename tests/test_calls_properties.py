"""`Episode.call` answers everything that JSON or text can express, counts it once, and never steps the game wrongly."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import example, given, settings, strategies as st

import smartplay_tools as sp
from smartplay_tools.types import TOOL_NAMES
from tests import scripts

CASES = settings(deadline=None, derandomize=True, database=None)

texts = st.one_of(
    st.text(max_size=30),
    st.text(st.characters(categories=["Cs", "Cc", "Lu", "Nd"]), max_size=8),
    st.sampled_from(["1", "2.", "3. Move", "1\n", "٣", "०", "１", "0001", "-1", "act", "Action", "x" * 10_001]),
)
values = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), texts, st.just(float("nan"))),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(texts, inner, max_size=3)),
    max_leaves=6,
)


def nested(depth: int, opening: str, closing: str) -> str:
    return opening * depth + closing * depth


class Unprintable:
    """Represents an object that hypothesis cannot print: nested too deep, or a number too long."""

    def __init__(self, what: str) -> None:
        self.what = what

    def __repr__(self) -> str:
        return self.what

    def build(self) -> Any:
        if self.what == "long":
            return {"action": 10**5000}
        value: Any = {}
        for _ in range(100_000):
            value = {"action": value}
        return value


raw = st.one_of(
    texts,
    st.dictionaries(st.sampled_from(["action", "why", ""]), values, max_size=3),
    st.builds(lambda action: {"action": action}, texts),
    values,
    st.builds(lambda action: json.dumps({"action": action}), texts),
    st.builds(
        lambda pad, action: f'{{{pad}"action":{pad}"{action}"}}', st.sampled_from(["", " ", "\n\t", "\v"]), texts
    ),
    st.sampled_from(
        [
            '{"action": "1", "action": "1"}',
            '{"action": NaN}',
            '{"action": -Infinity}',
            '{"action": ' + "9" * 5000 + "}",
            '{"action": 1e999}',
            '{"action": "\\ud800"}',
            '{"action": "' + "1" * 20_000 + '"}',
            nested(4_000, "[", "]"),
            nested(9_990, "[", ""),
            nested(1_600, '{"a":', "}"),
            Unprintable("deep"),
            Unprintable("long"),
            "\ufeff{}",
            "{}{}",
            "null",
            "\x00",
        ]
    ),
)
names = st.one_of(st.sampled_from(TOOL_NAMES), st.sampled_from(["act", "Act", "act ", "", "functions.act"]), texts)
calls = st.tuples(names, raw)
legal = st.tuples(st.just("act"), st.sampled_from([{"action": "1"}, '{"action": "2."}', {"action": "2"}]))


@CASES
@given(
    st.sampled_from(scripts.GAMES),
    st.lists(st.one_of(calls, legal), max_size=10),
    st.sampled_from([sp.Budget(), sp.Budget(tool_calls=4), sp.Budget(result_tokens=9)]),
    st.sampled_from(["window", "host"]),
)
@example("Hanoi3Disk-v0", [(name, Unprintable("deep")) for name in TOOL_NAMES], sp.Budget(), "window")
@example("Hanoi3Disk-v0", [("\ud800", "\udfff"), ("act", {"\ud800": "\udfff"})], sp.Budget(result_tokens=9), "host")
def test_every_call_is_answered_and_counted_once(
    game: str, sent: list[tuple[str, Any]], budget: sp.Budget, context: Any
) -> None:
    events: list[dict[str, Any]] = []
    episode = sp.Episode(game, seed=1, budget=budget, context=context, tokenizer=scripts.Words(), transcript=events)
    steps = legal_calls = illegal = malformed = late = 0
    for name, arguments in sent:
        if isinstance(arguments, Unprintable):
            arguments = arguments.build()
        before, over = episode.game.state_hash(), episode.done
        result = episode.call(name, arguments)
        assert isinstance(result, sp.ToolResult)
        json.dumps(dict(result.data))
        assert (
            episode.budget.result_tokens is None or scripts.Words().count(result.text) <= episode.budget.result_tokens
        )
        assert result.done == episode.done
        if over:
            assert result.is_error
            late += 1
        elif result.is_error:
            illegal += result.data["mistake"] == "illegal"
            malformed += result.data["mistake"] == "malformed"
        else:
            legal_calls += 1
            assert name in TOOL_NAMES
            steps += name == "act"
        if result.is_error or name != "act":
            assert episode.game.state_hash() == before
        assert episode.stats.steps == steps
    count = episode.stats
    assert (count.illegal_actions, count.malformed_calls, count.refused_calls) == (illegal, malformed, 0)
    assert count.tool_calls == legal_calls + illegal + malformed
    assert count.tool_calls == count.turns == len(sent) - late, "calls after the end are answered, not counted"
    assert sum(event["event"] == "call" for event in events) == len(sent) - late


@CASES
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["k1", "k2", "k3", "", None]),
            st.sampled_from(["act", "observe", "fly"]),
            st.sampled_from(['{"action": "1"}', {"action": "1"}, '{ "action":"1" }', '{"action": "2"}', "", None]),
        ),
        max_size=12,
    )
)
def test_a_key_answers_the_same_call_again_and_no_other(
    sent: list[tuple[str | None, str, Any]],
) -> None:
    """The model of a transport's retries: a dictionary from key to the first call under it and its result."""
    budget = sp.Budget(result_tokens=3)
    episode = sp.Episode("BanditTwoArmedHighLowFixed-v0", seed=1, budget=budget, tokenizer=scripts.Words())
    seen: dict[str, tuple[Any, sp.ToolResult]] = {}
    for key, name, arguments in sent:
        same = json.loads(arguments) if isinstance(arguments, str) and arguments else arguments or ""
        counted = episode.stats.counts()
        result = episode.call(name, arguments, key)
        if key and key in seen:
            call, first = seen[key]
            assert episode.stats.counts() == counted
            if call == (name, same):
                assert (result.text, result.is_error, result.done) == (first.text, first.is_error, first.done)
                assert result.data == {**first.data, "replayed": True}
            else:
                assert result.is_error
        else:
            assert episode.stats.tool_calls == counted["tool_calls"] + 1
            assert "replayed" not in result.data
            if key:
                seen[key] = (name, same), result
