"""What a host's agent may do beside playing, and what every adapter makes of it.

Each of these has ended a game, misled a model or misinformed a host. An adapter's row plays all of them, or says why
its host cannot get there (`Window.lacks`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable

import pytest

import smartplay_tools as sp
from smartplay_tools.context.prompts.wording import VERSION, Wording
from tests.adapters.conformance import (
    EACH,
    PLACE,
    WAY,
    WEATHER,
    Held,
    Script,
    Window,
    act,
    calling,
    fresh,
)

SCHEMA = {
    "type": "object",
    "properties": {"count": {"type": "integer"}, "title": {"type": "string"}},
    "required": ["count", "title"],
}
"""What a host wants an answer to be."""

MOVES: Script = [calling(act(short)) for short in WAY]


def played(row: Window, script: Script, situation: str) -> tuple[sp.EpisodeResult, Held]:
    """Play a game to its end in a situation; each reply of the model is one turn, and the record replays."""
    episode, events = fresh()
    with episode:
        held = row.hold(episode, script, situation=situation)
    result = episode.result
    assert result is not None
    assert (result.score, result.end_reason, result.turns) == (3.0, "terminated", len(script))
    assert len(held.sent) == len(script), "the model is asked once for each of its replies"
    assert sp.replay(events).identical
    return result, held


def result_of(held: Held) -> str:
    """The results of the first reply's calls, as the model sees them."""
    return "\n".join(str(message["content"]) for message in held.sent[1].messages if message["role"] == "tool")


def broken_call(row: Window, log: pytest.LogCaptureFixture) -> None:
    """A tool of the agent's own reaches the model as it is; broken calls of it are answered, by its framework or us."""
    script = [calling(*((WEATHER.name, broken) for broken in ('{"city":', '"Bern"', "[1]"))), *MOVES]
    _, held = played(row, script, "broken call")
    for prompt in held.sent:  # LangChain puts what a schema refers to in its place, as far as that goes
        ((description, parameters),) = [tool[1:] for tool in prompt.tools if tool[0] == WEATHER.name]
        assert description == WEATHER.description
        assert parameters["properties"]["when"] is True
        assert parameters["required"] == PLACE["required"]
    assert result_of(held).lower().count("error") >= 3


def broken_calls(row: Window, log: pytest.LogCaptureFixture) -> None:
    """A model that repeats a broken call of the agent's own tool is asked until its turns have stalled, or its calls
    are spent, although the host may never be asked in between."""
    broken, half = (WEATHER.name, '{"city": "Be'), ("act", '{"act')
    for calls, budget, end, turns in (
        ([broken], sp.Budget(), "stalled_turns", 10),
        ([broken, half] if row.broken_json else [broken], sp.Budget(), "stalled_turns", 10),
        ([broken], sp.Budget(tool_calls=4, stalled_turns=None), "tool_calls", 4),
    ):
        episode, events = fresh(budget)
        with episode:
            held = row.hold(episode, [calling(*calls)] * 99, situation="broken call")
        result = episode.result
        assert result is not None
        assert (result.end_reason, result.turns, len(held.sent)) == (end, turns, turns)
        assert result.tool_calls == result.malformed_calls == turns * len(calls)
        assert sp.replay(events).identical


def withdrawn(row: Window, log: pytest.LogCaptureFixture) -> None:
    """A tool of the agent's own is offered for the first reply only: calling it later is a mistake, and stalls."""
    withdrawn = calling((WEATHER.name, {"city": "Bern"}))
    result, held = played(row, [MOVES[0], withdrawn, *MOVES[1:]], "withdrawn")
    assert (result.malformed_calls, result.refused_calls) == (1, 0)
    assert WEATHER.name in [tool[0] for tool in held.sent[0].tools]
    episode, events = fresh()
    with episode:
        held = row.hold(episode, [MOVES[0], *[withdrawn] * 99], situation="withdrawn")
    assert episode.result is not None
    assert (episode.result.end_reason, episode.result.malformed_calls) == ("stalled_turns", 10)
    assert len(held.sent) == 11
    assert sp.replay(events).identical


def picture(row: Window, log: pytest.LogCaptureFixture) -> None:
    """A tool of the agent's own gives a picture, which cannot be counted: it is named, and that is logged once."""
    _, held = played(row, [calling(("camera", {})), calling(("camera", {})), *MOVES], "picture")
    assert re.search(r"Here\..*\[\S+ that is not shown\]", result_of(held))
    assert len([record for record in log.records if "parts that the model is not shown" in record.message]) == 1


def sub_agent(row: Window, log: pytest.LogCaptureFixture) -> None:
    """An agent in a tool of the agent's own, with the same model and tools, gets words, and plays nothing."""
    _, held = played(row, [calling(("helper", {})), *MOVES], "sub-agent")
    assert Wording.of(VERSION)("sub_agent") in result_of(held)


def another_purpose(situation: str) -> Callable[[Window, pytest.LogCaptureFixture], None]:
    """A request that is not for a move: it is answered in words, or refused in a sentence before the model is asked."""

    def judge(row: Window, log: pytest.LogCaptureFixture) -> None:
        if row.refuses is None:
            _, held = played(row, MOVES, situation)
            if situation == "schema":
                assert json.loads(held.words) == {"count": 0, "title": "The game is over."}
            else:
                assert "plays a game" in held.words
                assert len([record for record in log.records if "answered here" in record.message]) == 1
            return
        episode, events = fresh()
        with episode, pytest.raises(sp.InvalidArgumentError, match=row.refuses[situation]):
            row.hold(episode, MOVES, situation=situation)
        assert not [event for event in events if event["event"] == "usage"]

    return judge


OTHERS = "Two tools (have the name act|are the game's)|name conflicts with existing tool"
"""How tools of another episode are refused, in the last case by Pydantic AI itself."""


def another_episode(situation: str) -> Callable[[Window, pytest.LogCaptureFixture], None]:
    """The tools of another episode, beside this one's or in their place, look the same and play another world: they are
    refused in a sentence, and nothing is played."""

    def judge(row: Window, log: pytest.LogCaptureFixture) -> None:
        episode, _ = fresh()
        with episode, pytest.raises(Exception, match=OTHERS):
            row.hold(episode, MOVES, situation=situation)
        assert episode.stats.tool_calls == 0

    return judge


def again(row: Window, log: pytest.LogCaptureFixture) -> None:
    """A finished game is run a second time, as the cell of a notebook is: the truth is said, and no model is asked."""
    _, held = played(row, MOVES, "again")
    assert re.search(r"(game|episode) is over", held.words)


def forgets(row: Window, log: pytest.LogCaptureFixture) -> None:
    """A host that shortens its own messages changes no prompt, and is told once what it pays for."""
    _, held = played(row, MOVES, "forgets")
    _, plain = played(row, MOVES, "")
    assert [prompt.messages for prompt in held.sent] == [prompt.messages for prompt in plain.sent]
    gone = [record.getMessage() for record in log.records if "have left the agent's own list" in record.message]
    (tokens,) = [re.match(r"[1-9]\d* messages with (\d+) tokens of text .* pay for", text) for text in gone]
    assert tokens


def usage(row: Window, log: pytest.LogCaptureFixture) -> None:
    """The host is told of every call of the model: of replies in words, broken calls, summaries, and at the end."""
    budget = sp.Budget(prompt_tokens=1100, summary_tokens=60, slack=0.5, tool_calls=8, stalled_turns=None)
    broken = [calling(("act", '{"action":'))] if row.broken_json else []
    script = [calling(say="Hm."), *broken, *[calling(("observe", {}), say="I have looked.")] * 20]
    for given, end, replies in (
        (budget, "tool_calls", script),
        (sp.Budget(), "no_tool_call", [calling(say="Hm.")] * 3),
    ):
        episode, _ = fresh(given)
        with episode:
            held = row.hold(episode, replies, situation="usage")
        assert episode.result is not None
        assert episode.result.end_reason == end
        billed = len(held.sent)
        assert held.usage is not None
        assert (held.usage.prompt, held.usage.reply) == (billed * EACH.prompt, billed * EACH.reply)
        on_record = episode.result.tokens.provider
        assert on_record is not None
        assert (on_record.requests, on_record.prompt) == (billed, billed * EACH.prompt)


SITUATIONS: dict[str, Callable[[Window, pytest.LogCaptureFixture], None]] = {
    "again": again,
    "another episode": another_episode("another episode"),
    "another episode instead": another_episode("another episode instead"),
    "broken call": broken_call,
    "broken calls": broken_calls,
    "forgets": forgets,
    "no calls": another_purpose("no calls"),
    "no tools": another_purpose("no tools"),
    "picture": picture,
    "schema": another_purpose("schema"),
    "sub-agent": sub_agent,
    "usage": usage,
    "withdrawn": withdrawn,
}


def of(row: Window) -> list[str]:
    """The situations that a row's host can get into; of the others it says why it cannot."""
    assert row.lacks.keys() <= SITUATIONS.keys()
    assert all(row.lacks.values())
    return [name for name in SITUATIONS if name not in row.lacks]


def lacking(reason: str, *also: str) -> dict[str, str]:
    """Say for all situations, or for these, why a host cannot get there."""
    return dict.fromkeys(also or SITUATIONS, reason)


LOOP = lacking("a loop of ours or yours: there is no agent of a host's that could do anything beside playing")
AWAITED = lacking(
    "the other row of its framework gets there, and this one differs in how replies are awaited",
    *("again", "another episode", "another episode instead", "forgets", "no calls", "no tools", "picture", "schema"),
)
REFUSED = {
    "no calls": "tool choice `none`",
    "no tools": "has the game's tools|has removed act, observe, read_manual",
    "schema": "cannot have a",
}
"""How an adapter in a framework's agent refuses what is not for a move (`Window.refuses`)."""


def weather(city: str = "") -> str:
    """Tell the weather."""
    raise AssertionError("its arguments are not JSON")


class SituationConformance:
    """The situations for a framework that has an environment of its own: its test file has a class of this."""

    row: Window

    @pytest.mark.parametrize("situation", SITUATIONS)
    def test_what_hosts_do(self, situation, caplog):
        if situation not in of(self.row):
            pytest.skip(self.row.lacks[situation])
        SITUATIONS[situation](self.row, caplog)
