"""One conversation, to be held through every adapter: the script, a model that reads it out, and what must come of it.

An adapter joins `test_conformance.py` with one row. A row that owns its context is a function `(episode, script)` that
has the framework's own runner play the script, and returns what its model was sent: a list of messages a prompt, in
canonical form. A row whose host owns the context is a function `(episode, calls)` that sends the calls one by one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import smartplay_tools as sp
from smartplay_tools.transcript import comparable
from tests import checker

GAME, SEED = "Hanoi3Disk-v0", 7
WAY = ["A->C", "A->B", "C->B", "A->C", "B->A", "B->C", "A->C"]
"""The seven moves that solve it."""

Script = list[sp.Message]
Sent = list[list[dict[str, Any]]]


def move(short: str) -> str:
    return f"Move the top disk of rod {short[0]} to the top of rod {short[-1]}"


def calling(*calls: tuple[str, Any], say: str = "") -> sp.Message:
    """An assistant message; its calls have the ids c0, c1, ... in every message, as some models send them."""
    tool_calls = [
        {
            "id": f"c{at}",
            "type": "function",
            "function": {
                "name": name,
                "arguments": sent if isinstance(sent, str) else json.dumps(sent, ensure_ascii=False),
            },
        }
        for at, (name, sent) in enumerate(calls)
    ]
    message: dict[str, Any] = {"role": "assistant", "content": say}
    return {**message, "tool_calls": tool_calls} if calls else message  # type: ignore[return-value]


def act(short: str) -> tuple[str, Any]:
    return "act", {"action": move(short)}


BASIC: Script = [
    calling(("read_manual", {}), say="First the rules."),
    calling(("observe", {})),
    calling(act(WAY[0]), ("observe", {}), act(WAY[1]), act(WAY[2])),
    calling(("act", {"action": "Fly"})),
    calling(("act", {"action": 3}), ("act", {"actoin": "Rock"}), ("act", {"action": "1", "now": True}), say="Oops."),
    calling(("observe", {"deep": {"list": [1, "ä", None]}})),
    calling(("jump", {"how": "high"}), ("observe", {})),
    calling(*map(act, WAY[3:5])),
    calling(("observe", {}), say="So?"),
    calling(*map(act, WAY[5:]), act(WAY[0])),
]
"""Every kind of call; the last act comes after the end."""

IDLE: Script = [calling(("observe", {})), calling(say="Let me think."), *BASIC[2:]]
"""A reply of words only."""

BROKEN: Script = [
    calling(("observe", {})),
    calling(("act", '{"action": ')),
    calling(act(WAY[0]), ("act", "[1]"), ("act", "Rock")),
    calling(*map(act, WAY[1:])),
]
"""Arguments that are no JSON, or no object: alone in a message, and after one that is."""

BUDGETS = {
    "free": sp.Budget(),
    "tight": sp.Budget(prompt_tokens=900, history=2),
    "lazy": sp.Budget(prompt_tokens=1000, slack=0.5, episode_tokens=20_000, reply_tokens=300),
}


def fresh(budget: sp.Budget | None = None, seed: int = SEED, **options: Any) -> tuple[sp.Episode, list[Any]]:
    events: list[Any] = []
    return sp.Episode(GAME, seed=seed, budget=budget, transcript=events, **options), events


def by_conversation(episode: sp.Episode, script: Script) -> Sent:
    """The measure of all rows: `play` with a scripted player."""
    player = sp.ScriptedPlayer(script)
    sp.play(episode, player)
    return [[dict(message) for message in prompt.messages] for prompt in player.prompts]


def by_conversation_with_one_system(episode: sp.Episode, script: Script) -> Sent:
    return [one_system(messages) for messages in by_conversation(episode, script)]


def judge(hold: Callable[[sp.Episode, Script], Sent], script: Script, budget: sp.Budget) -> None:
    """Hold a conversation through an adapter, and once more without it; nothing may tell the two apart."""
    episode, events = fresh(budget)
    with episode:
        sent = hold(episode, script)
    expected_episode, expected_events = fresh(budget)
    with expected_episode:
        expected = by_conversation(expected_episode, script)
    assert without_usage(episode.result) == without_usage(expected_episode.result)
    assert comparable(events) == comparable(expected_events)
    assert [[plain(m) for m in prompt] for prompt in sent] == [[plain(m) for m in one_system(p)] for p in expected]
    independently(events, sent, episode)


def without_usage(result: sp.EpisodeResult) -> sp.EpisodeResult:
    """What providers report is theirs; the rest is to be equal."""
    return result.model_copy(update={"tokens": result.tokens.model_copy(update={"provider": None})})


def independently(events: list[Any], sent: Sent, episode: sp.Episode) -> None:
    """Have `tests/checker.py` judge what the model received."""
    head = next(event for event in events if event["event"] == "head")
    judged = checker.Judge(
        head["messages"],
        head["tools"],
        checker.turns_of(events),
        episode.budget.model_dump(),
        episode.counter.tokenizer.count,
    )
    for turns, prompt in enumerate(sent):
        checker.check_prompt(prompt, head["tools"], judged, turns)


def plain(message: dict[str, Any]) -> dict[str, Any]:
    """A message without what frameworks spell differently: ids, and no text as null or as nothing."""
    calls = [call["function"] for call in message.get("tool_calls", ())]
    spelled = [(call["name"], checker.arguments_text(call["arguments"])) for call in calls]
    return {"role": message["role"], "content": checker.plain_text(message["content"]), "calls": spelled}


def one_system(messages: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The messages with all system messages joined at the beginning, as frameworks with one system text send them."""
    system = [checker.plain_text(message["content"]) for message in messages if message["role"] == "system"]
    return [{"role": "system", "content": "\n\n".join(system)}, *(m for m in messages if m["role"] != "system")]


CALLS: list[tuple[str, Any]] = [
    (call["function"]["name"], json.loads(call["function"]["arguments"]))
    for message in BASIC
    for call in message.get("tool_calls", ())
]
"""The script for adapters whose host owns the context: there each call is a turn."""


def judge_host(send: Callable[[sp.Episode, list[tuple[str, Any]]], list[tuple[str, bool]]]) -> None:
    """Send the calls through an adapter, and once more to the episode itself."""
    budget = sp.Budget(history=3)
    episode, events = fresh(budget, context="host")
    with episode:
        shown = send(episode, CALLS)
    expected_episode, expected_events = fresh(budget, context="host")
    with expected_episode:
        expected = [expected_episode.call(name, arguments) for name, arguments in CALLS]
    assert shown == [(result.text, result.is_error) for result in expected]
    assert comparable(events) == comparable(expected_events)
    assert episode.result == expected_episode.result
