"""Hostile episodes at random, judged: `python -m tests.fuzz --calls 1000000 --prompts 100000 --seed 0`.

The property tests draw few cases and shrink what they find; this draws many. Every call has to be answered without
an exception and within its cap. Every prompt is judged by `tests/checker.py`, and every record has to replay. Drawn are
odd tool names and arguments, repeated and empty ids, foreign tools, hosts that edit, refuse, reorder or forget calls,
messages between turns, heads with examples, odd replies, tiny budgets, every strategy for the past with odd summaries
and notes, and a caller that edits whatever it still holds.
"""

from __future__ import annotations

import argparse
import copy
import functools
import json
import random
from collections import Counter
from collections.abc import Collection
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.episode.budgets import refused_strategy
from smartplay_tools.records import replay
from tests import checker, scripts

ODD_TEXTS = ["", " ", "\ud800", "\ud83d\ude00", "é\u0301", "x" * 300, "<|endoftext|>", "\x00", "a\u2028b", "{}", "null"]
ODD_ARGUMENTS: list[Any] = [
    None, "", "{}", " { } ", "{", "null", "[]", '{"action": 1}', '{"action": "1", "action": "2"}', '{"action": NaN}',
    '{"action": 1e999}', '{"action": ' + "[" * 120 + "]" * 120 + "}", '{"action": "' + "1" * 10_001 + '"}',
    '{"action": "\\ud800"}', {"action": ["1"]}, {"action": "\ud800"}, {1: 2}, object(), 10**5000, ["act"],
]  # fmt: skip
ODD_REPLIES: list[Any] = [
    None, "act", {"role": "user", "content": "x"}, {"role": "assistant", "content": 5},
    {"role": "assistant", "content": None, "tool_calls": [None]}, {"role": "assistant", "content": None, "name": 5},
    {"role": "assistant", "content": None, "extra": object()},
]  # fmt: skip
GAMES = scripts.GAMES
ADDED = [*scripts.NOTES, *scripts.RECALLS, *scripts.PAGES, *scripts.MEMORY]
"""Calls of the tools that strategies add."""
ODD = f"{Path(__file__).parent / 'data' / 'odd_strategy.py'}:Odd"
PICTURE, WORDS_BESIDE = 81, 13
"""The tokens of a picture of Crafter by `claude-28` with its accompanying text, by the tokenizer of these tests."""
EXAMPLE = [
    {"role": "user", "content": "An example:"},
    {"role": "assistant", "content": None, "tool_calls": [
        {"id": "a", "type": "function", "function": {"name": "act", "arguments": "{}"}}]},
    {"role": "tool", "tool_call_id": "a", "content": "It was played."},
]  # fmt: skip


def strategy(chance: random.Random) -> dict[str, Any]:
    """Return the fields of a budget about past turns; sometimes none."""
    if chance.random() < 0.2:
        return {}
    if chance.random() < 0.3:
        odd = f"{ODD}:seed={chance.randrange(999)}:wild={chance.choice(['true', 'false'])}"
        return {"strategy": odd, **added(chance), "own_words": chance.choice([None, 0, 1, 3])}
    return {
        "beyond_history": chance.choice(["drop", "mask"]),
        **added(chance),
        "summary_tokens": chance.choice([None, 1, 6, 30]),
        "own_words": chance.choice([None, None, 0, 1, 2, 5, "never"]),
        "first_turns": chance.choice([None, None, 1, 2, 4]),
    }


def added(chance: random.Random) -> dict[str, Any]:
    """Return the fields of a budget that add a tool."""
    return {
        "notes_tokens": chance.choice([None, 2, 12, 40]),
        "recall_tokens": chance.choice([None, None, 1, 9, 30, 90, 300]),
        "beyond_result": chance.choice(["cut", "offload"]),
        "memory_tokens": chance.choice([None, None, 5, 40, 200]),
    }


def budget(chance: random.Random, game: str, head: int | None, least: int = 0, form: str = "text") -> sp.Budget:
    """Return a budget near the size of the head, where it has an effect; impossible budgets are drawn again.

    `least` is what an observation with a picture needs.
    """
    while True:
        drawn = _any_budget(chance, head, least)
        if form != "text" and chance.random() < 0.6:
            drawn = drawn.model_copy(update={"newest_pictures": chance.choice([1, 1, 2, 3, 5])})
        if refused_strategy(drawn, sp.GAMES[game], context="window", observation=form) is None:
            return drawn


def _any_budget(chance: random.Random, head: int | None, least: int) -> sp.Budget:
    past = strategy(chance) if head is not None else {}
    results = chance.choice(["auto", None, *(least + more for more in ((0, 4, 30) if least else (1, 5, 30)))])
    more = scripts.strategy_tokens({**past, "result_tokens": results}, scripts.Words())
    return sp.Budget(
        **past,
        history=chance.choice([None, 0, 1, 2, 5]),
        prompt_tokens=None
        if head is None
        else head + more + least + chance.choice([chance.randrange(400 + 4 * least), chance.randrange(99)]),
        reply_tokens=chance.choice([None, None, 1, 40]),
        episode_tokens=chance.choice([None, None, None, 4_000]),
        result_tokens=results,
        tool_calls=chance.choice(["game", "game", 7]),
        stalled_turns=chance.choice([None, None, 1, 3, 10]),
        slack=chance.choice([0, 0, 0.25, 0.7, 1]),
    )


def arguments(chance: random.Random) -> Any:
    """Return arguments of a call: legal ones half of the time."""
    legal = ['{"action": "1"}', '{"action":"2."}', {"action": "1"}, '{ "action" : "2" }']
    return chance.choice(legal) if chance.random() < 0.5 else chance.choice(ODD_ARGUMENTS)


def name(chance: random.Random) -> Any:
    """Return the name of a tool, mostly an existing one."""
    return chance.choice(["act", "act", "act", "observe", "read_manual", "note", *ODD_TEXTS, "Act", None, 3])


def function(chance: random.Random, *, is_lively: bool = False, offered: Collection[str] = ()) -> dict[str, Any]:
    """Return the name and arguments of a call; of a lively player most play or observe.

    Some are of tools that a strategy adds, and more of them where it is among those `offered`.
    """
    if chance.random() < 0.4 and (added := [called for called in ADDED if called[0] in offered]):
        called, text = chance.choice(added)
        return {"name": called, "arguments": text}
    if is_lively and chance.random() < 0.7:
        return chance.choice([{"name": "act", "arguments": '{"action": "1"}'}, {"name": "observe", "arguments": "{}"}])
    if chance.random() < 0.2:
        called, text = chance.choice(ADDED)
        return {"name": called, "arguments": text}
    return {"name": name(chance), "arguments": arguments(chance)}


def hostile_calls(chance: random.Random, counts: Counter[str]) -> None:
    """Send hostile calls to an episode whose host manages the context, then replay its record."""
    events: list[Any] = []
    context: Any = chance.choice(["window", "host"])
    game = chance.choice(GAMES)
    with sp.Episode(
        game,
        seed=chance.randrange(99),
        context=context,
        budget=budget(chance, game, None),
        tokenizer=scripts.Words(),
        transcript=events,
    ) as episode:
        for _ in range(chance.randrange(120)):
            key = chance.choice([None, None, "k1", "k2", ""])
            result = episode.call(name(chance), arguments(chance), key)
            cap = episode.budget.result_tokens
            assert cap is None or scripts.Words().count(result.text) <= cap
            json.dumps(dict(result.data))
            counts["calls"] += 1
    replayed = replay(events, tokenizer=scripts.Words())
    assert replayed.identical, replayed.differences


def strategy_of(budget: sp.Budget) -> str:
    """Name what a budget says of the past."""
    slack = "with slack" if budget.slack else "without slack"
    return " and ".join(budget.strategies or ("plain dropping",)) + f", {slack}"


def hostile_reply(chance: random.Random, *, is_lively: bool = False, offered: Collection[str] = ()) -> dict[str, Any]:
    """Return a reply with odd texts, ids and calls."""
    words = chance.choice([None, "", "Let me see.", "word " * chance.randrange(60), *ODD_TEXTS])
    reply: dict[str, Any] = {"role": "assistant", "content": words}
    if chance.random() < 0.3:
        reply["reasoning_content"] = chance.choice(["Hm.", "\ud83d" + "\ude00", [{"text": "part"}]])
    if chance.random() < 0.2:
        reply["provider_items"] = [{"type": "reasoning", "summary": [{"text": "First."}]}]
    calls = [
        {
            "id": chance.choice(["a", "b", "", "c00000000"]),
            "function": function(chance, is_lively=is_lively, offered=offered),
        }
        for _ in range(chance.randrange(4))
    ]
    return {**reply, "tool_calls": calls} if calls else reply


def hostile_start(
    chance: random.Random, game: str | None, form: str, tokenizer: scripts.Words, events: list[Any]
) -> sp.Conversation | sp.AgentSession:
    """Begin an episode with what chance allows: a game if none is given, budget, head, and who plays the calls."""
    host = chance.random() < 0.3
    game = game or chance.choice(GAMES)
    size, least = scripts.head_tokens(game, tokenizer, host=host), 0 if form == "text" else PICTURE + WORDS_BESIDE
    episode = sp.Episode(
        game, seed=chance.randrange(9), budget=budget(chance, game, size, least, form), tokenizer=tokenizer,
        transcript=events, batch=chance.choice(["all", "all", "first_act"]), observation=form,
    )  # fmt: skip
    kind = chance.choice([sp.Conversation, sp.AgentSession])
    more = scripts.strategy_tokens(episode.budget.model_dump(), tokenizer)
    head = (
        [scripts.HOST_HEAD]
        if host
        else EXAMPLE
        if size + more + 60 < (episode.budget.prompt_tokens or 10**9) and chance.random() < 0.3
        else []
    )
    options = {"summaries": True, "pictures": True} if kind is sp.AgentSession else {}
    return kind(episode, head=head, foreign_tools=[scripts.NOTE], **options)


def hostile_conversation(
    chance: random.Random, counts: Counter[str], form: str | None = None, player: Any = None
) -> None:
    """Play a hostile conversation or agent session; judge every prompt, then replay the record.

    With a `form` the game is Crafter, and that is what its observations are. A `player` replies in place of chance.
    """
    game, form = ("Crafter-v0", form) if form is not None else (None, "text")
    events: list[Any] = []
    tokenizer, sent = scripts.Words(), list[Any]()
    conversation = hostile_start(chance, game, form, tokenizer, events)
    episode = conversation.episode
    is_lively = form != "text" or chance.random() < 0.6
    for _ in range(chance.choice([14, 14, 40])):
        prompt = conversation.prompt()
        if prompt is None:
            break
        counts[strategy_of(episode.budget)] += 1
        tools = [
            scripts.as_json({"name": t.name, "description": t.description, "parameters": t.parameters})
            for t in prompt.tools
        ]
        sent.append({**scripts.view_as_json(conversation.view), "tools": tools, "max_tokens": prompt.max_tokens})
        check_pictures(prompt, counts)
        said = None if player is None else dict(player.reply(prompt).message)
        deface(prompt.messages)
        deface(conversation.view.messages)
        refuse_odd_replies(chance, conversation)
        if prompt.purpose == "summary":
            usual = {"role": "assistant", **copy.deepcopy(chance.choice(scripts.ANSWERS))}
            answer = said or hostile_reply(chance) if chance.random() < 0.5 else usual
            assert not conversation.receive(answer)
            deface([answer])
            counts["summaries"] += 1
            continue
        reply = said or hostile_reply(chance, is_lively=is_lively, offered={tool.name for tool in prompt.tools})
        conversation.receive(reply)
        if isinstance(conversation, sp.AgentSession):
            scripts.act_as_host(chance, conversation)
        counts["calls"] += len(conversation.latest_turn.calls)
        answer_foreign(conversation)
        message = {"role": "user", "content": [{"type": "text", "text": "Go on."}]}
        if chance.random() < 0.3:
            conversation.add(message)
        deface([reply, message])
    if (prompt := conversation.prompt()) is not None and prompt.purpose == "summary" and chance.random() < 0.5:
        conversation.receive({"role": "assistant", "content": "The end."})
    episode.close()
    counts["prompts"] += len(sent)
    for event in (event for event in events if event["event"] == "call"):
        counts["recalls that found something"] += bool(event["data"].get("recalled"))
        counts["pages"] += "page" in event["data"]
        counts["calls of memory"] += event["name"] == "memory" and not event["is_error"]
    choices = None if episode.ledger.strategies.custom is None else scripts.choices_of(episode.ledger.strategies.custom)
    plain = scripts.as_json(events)
    checker.check_episode(plain, sent, tokenizer.count, choices, scripts.whole_observations(plain))
    replayed = replay(events, tokenizer=tokenizer)
    assert replayed.identical, replayed.differences


def check_pictures(prompt: sp.Prompt, counts: Counter[str]) -> None:
    """A prompt has exactly the pictures that its messages name."""
    named = [part for message in prompt.messages for part in message["content"] or () if "sha256" in part]
    assert prompt.pictures.keys() == {part["sha256"] for part in named}
    for part in named:
        picture = prompt.pictures[part["sha256"]]
        assert {"type": "image", **picture.facts} == part
        assert scripts.picture_digest(picture.png) == part["sha256"]
    counts["pictures in prompts"] += len(named)


def refuse_odd_replies(chance: random.Random, conversation: Any) -> None:
    """Sometimes send a value that is not a reply: it is refused, and nothing changes."""
    if chance.random() < 0.1:
        turns = conversation.episode.stats.turns
        try:
            conversation.receive(chance.choice(ODD_REPLIES))
        except sp.InvalidArgumentError:
            assert conversation.episode.stats.turns == turns
        else:
            raise AssertionError("an odd reply was taken")


def answer_foreign(conversation: Any) -> None:
    """Give every foreign call of the latest reply a result."""
    for call in conversation.latest_turn.calls:
        if call.name == "note" and conversation.result is None:
            conversation.add({"role": "tool", "tool_call_id": call.id, "content": "noted: word word"})


def deface(messages: list[Any]) -> None:
    """Edit all objects that a caller still holds, which must not change the conversation."""
    for message in messages:
        for call in message.get("tool_calls") or ():
            call["function"]["arguments"] = "word " * 500
        for item in message.get("provider_items") or ():
            item["summary"] = "word " * 500
        if isinstance(message["content"], list):
            for part in message["content"]:
                part["text"] = part["sha256"] = "word " * 500
        message["content"] = "word " * 500


def main() -> None:
    """Draw until the counts asked for are reached, and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=10_000)
    parser.add_argument("--prompts", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--player", help="Have this one reply, such as local:smollm2-135m-player.")
    parser.add_argument("--observation", choices=["text", "picture", "both"], help="Play Crafter with these.")
    asked = parser.parse_args()
    player = None if asked.player is None else sp.get_player(asked.player, seed=asked.seed)
    counts: Counter[str] = Counter()
    number = 0
    while counts["calls"] < asked.calls or counts["prompts"] < asked.prompts:
        number += 1
        chance = random.Random(f"{asked.seed} {number}")
        talks = number % 2 if counts["calls"] < asked.calls else True
        talk = functools.partial(hostile_conversation, form=asked.observation, player=player)
        play = talk if counts["prompts"] < asked.prompts and talks else hostile_calls
        try:
            play(chance, counts)
        except BaseException:
            print(f"case {number} of seed {asked.seed}, {'conversation' if play is talk else 'calls'}")
            raise
    print(f"{counts['calls']:,} calls and {counts['prompts']:,} prompts in {number:,} episodes: 0 violations")
    for what in sorted(counts.keys() - {"calls", "prompts"}):
        print(f"  {counts[what]:>9,} {what}")


if __name__ == "__main__":
    main()
