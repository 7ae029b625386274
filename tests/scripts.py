"""Arbitrary conversations: messages that a model might send, and a driver that plays them and stores the prompts."""

from __future__ import annotations

import functools
import hashlib
import io
import json
import random
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st
from PIL import Image

import smartplay_tools as sp
from smartplay_tools.context import View
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.strategies.memory import memory_spec
from smartplay_tools.context.strategies.notes import notes_spec
from smartplay_tools.context.strategies.offload import pages_spec
from smartplay_tools.context.strategies.recall import recall_spec
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.records import Record, replay, resume
from smartplay_tools.records.accounts import Accounts
from tests import checker

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0", "Hanoi3Disk-v0")
NOTE = sp.ToolSpec(
    "note",
    "Keep a note.",
    {
        "type": "object",
        "properties": {
            "text": {"type": "string", "description": "What to keep."},
            "kind": {"type": "string", "description": "Its kind.", "enum": ["plan", "fact"]},
        },
        "required": ["text", "kind"],
        "additionalProperties": False,
    },
)
HOST_HEAD = {"role": "user", "content": [{"type": "text", "text": "Be brief."}], "name": "host"}


def pixels_of(png: bytes) -> np.ndarray:
    """The pixels of a PNG file: rows x columns x red, green and blue."""
    with Image.open(io.BytesIO(png)) as image:
        return np.array(image)


def picture_digest(png: bytes) -> str:
    """The digest of a picture, from its file alone and as `Picture.sha256` defines it."""
    pixels = pixels_of(png)
    height, width, _ = pixels.shape
    return hashlib.sha256(b"%d %d\n" % (width, height) + pixels.tobytes()).hexdigest()


class Words:
    """A tokenizer for tests: a token for a word of up to eight letters, and one for every sign."""

    name = "words"

    def count(self, text: str) -> int:
        return _words(text)


@functools.lru_cache(20_000)
def _words(text: str) -> int:
    return len(re.findall(r"\w{1,8}|[^\w\s]", text))


def call(name: str, arguments: str) -> tuple[str, str]:
    return name, arguments


ACTS = [call("act", json.dumps({"action": action})) for action in ("1", "2.", " 1 ", "2")]
CALLS = [
    *ACTS,
    *ACTS,
    call("act", '{ "action" :\t"1"}'),
    call("observe", ""),
    call("observe", "{}"),
    call("observe", " { } "),
    call("read_manual", ""),
    call("read_manual", "{}"),
    call("act", '{"action": "fly to the moon"}'),
    call("act", '{"action": "1"'),
    call("act", '{"action": "1", "action": "2"}'),
    call("act", '{"action": 1.50, "é": [NaN]}'),
    call("act", '{"why": "\\u00e9\\ud800", "action": "1"}'),
    call("observe", "[1, 2]"),
    call("", ""),
    call("fly", '{"to":"the moon"}'),
    call("note", '{"text":"one  two",  "kind":"plan"}'),
    call("note", "not JSON"),
]
NOTES = [
    call("take_notes", '{"text": "Machine 1 is good."}'),
    call("take_notes", '{"text": "' + "word " * 30 + '"}'),
    call("take_notes", '{"text": "x"}'),
    call("take_notes", '{"text": " "}'),
    call("take_notes", '{"text": ""}'),
    call("take_notes", '{"text": 5}'),
    call("take_notes", '{"notes": "one"}'),
]
RECALLS = [
    call("recall", json.dumps({"query": query}))
    for query in ("1", "0-3", " 2 - 999999 ", "3-1", "1234567", "Machine 1", "step act Rock reward", "after", "é _", "")
]
RECALLS += [call("recall", '{"query": 5}'), call("recall", "{}"), call("recall", '{"query": "1", "steps": "2"}')]
PAGES = [
    call("read_result", json.dumps({"page": page}))
    for page in ("r1.1", "r1.2", "r1.2", "r1.3", "r2.2", "r3.2", "r5.2", "r1.99", "r01.2", " r1.2", "r0.1", "1.2", "")
]
PAGES += [call("read_result", '{"page": 5}'), call("read_result", "{}")]
PATHS = ("/memories", "/memories/a", "/memories/a/b", "/memories/a/b/c/d", "/memories/.h", "/memories/b.txt")
ODD_PATHS = (
    "/memories/",
    "/memories/..",
    "/memories/./a",
    "memories/a",
    "/memoriesa",
    "",
    "/memories/a\0",
    "/memories//a",
)
TEXTS = ("", "one", "one\ntwo\n", "one two\nthree\n\nfour", "word " * 12, "\n", "\ud800")


def memory_call(chance: random.Random) -> tuple[str, str]:
    """A call of `memory`, mostly one that could be meant."""
    path = lambda: chance.choice(ODD_PATHS if chance.random() < 0.1 else PATHS)  # noqa: E731
    text = lambda: chance.choice(TEXTS)  # noqa: E731
    part = chance.choice(("one", "two", "o", "", "\n", "word "))
    given: dict[str, Any] = chance.choice(
        [
            {"command": "view", "path": path(), "view_range": chance.choice([None, [1, 2], [2, -1], [0, 0], [9, 3]])},
            {"command": "create", "path": path(), "file_text": text()},
            {"command": "create", "path": path(), "file_text": text()},
            {"command": "str_replace", "path": path(), "old_str": part, "new_str": text()},
            {"command": "insert", "path": path(), "insert_line": chance.randrange(-1, 4), "insert_text": text()},
            {"command": "delete", "path": path()},
            {"command": "rename", "old_path": path(), "new_path": path()},
        ]
    )
    if chance.random() < 0.15:
        name = chance.choice([*given, "path", "view_range", "insert_line", "color"])
        given[name] = chance.choice([None, 5, "x", True, [1], [1, 2, 3], [1, "2"], 1.0, {}])
    return call("memory", json.dumps(given))


MEMORY = [memory_call(random.Random(f"memory {number}")) for number in range(120)]
ANSWERS: list[dict[str, Any]] = [
    {"content": "The first machine paid twice."},
    {"content": "Known: " + "much, " * 40},
    {"content": ""},
    {"content": None},
    {"content": " \n\n " * 20},
    {"content": "incomprehensibilities" * 12, "reasoning_content": "One, two."},
    {
        "content": "I would rather act.",
        "tool_calls": [{"id": "a", "type": "function", "function": {"name": "act", "arguments": '{"action": "1"}'}}],
    },
]
"""What a model says when it is asked for a summary."""
WORDS: list[dict[str, Any]] = [
    {"content": None},
    {"content": None},
    {"content": ""},
    {"content": "I think that machine 1 is the better one, but who knows."},
    {"content": "word " * 40},
    {"content": "incomprehensibilities" * 12, "name": "player"},
    {"content": [{"type": "text", "text": "In two"}, {"type": "text", "text": " parts."}]},
    {"content": "Hm.", "reasoning_content": "Let me see: one, two, three."},
    {
        "content": None,
        "provider_items": [
            {
                "type": "reasoning",
                "summary": [{"type": "summary_text", "text": "First this."}],
                "encrypted_content": "x y z",
            },
            {"type": "thinking", "thinking": "Then that.", "signature": "a b c d"},
        ],
    },
]
AFTER: list[list[dict[str, Any]]] = [
    [],
    [],
    [],
    [{"role": "user", "content": "Go on."}],
    [{"role": "user", "content": "word " * 25, "name": "host"}, {"role": "user", "content": "And on."}],
]


@dataclass(frozen=True)
class Move:
    """A reply of the model, and the host's messages after it."""

    message: dict[str, Any]
    after: Sequence[dict[str, Any]]


def _move(words: dict[str, Any], calls: list[tuple[tuple[str, str], str]], after: list[dict[str, Any]]) -> Move:
    listed = [{"id": i, "type": "function", "function": {"name": n, "arguments": a}} for (n, a), i in calls]
    return Move({"role": "assistant", **words, **({"tool_calls": listed} if listed else {})}, after)


moves = st.builds(
    _move,
    st.sampled_from(WORDS),
    st.lists(
        st.tuples(
            st.sampled_from([*CALLS, *NOTES, *RECALLS, *PAGES, *MEMORY[:40]]), st.sampled_from(["a", "b", "", "c1"])
        ),
        max_size=4,
    ),
    st.sampled_from(AFTER),
)


def lively_script(chance: random.Random, length: int = 25) -> list[Move]:
    """A script that plays on, and uses the tools of memory at nearly every turn."""
    tools = [*ACTS, call("observe", "{}"), *RECALLS, *RECALLS[:7], *PAGES, *chance.sample(MEMORY, 30)]
    return [
        _move(chance.choice(WORDS), [(chance.choice(ACTS), "a"), *((chance.choice(tools), "") for _ in range(2))], [])
        for _ in range(length)
    ]


scripts = st.lists(moves, max_size=9)
answers = st.lists(st.sampled_from(ANSWERS), min_size=1, max_size=3)
strategies = st.fixed_dictionaries(
    {
        "beyond_history": st.sampled_from(["drop", "mask"]),
        "notes_tokens": st.sampled_from([None, 2, 12, 40]),
        "summary_tokens": st.sampled_from([None, 1, 6, 30]),
        "own_words": st.sampled_from([None, None, 0, 1, 3, "never"]),
        "first_turns": st.sampled_from([None, None, 1, 3]),
        "recall_tokens": st.sampled_from([None, None, 3, 15, 40, 120]),
        "beyond_result": st.sampled_from(["cut", "offload"]),
        "memory_tokens": st.sampled_from([None, None, 1, 20, 60]),
    }
)
histories = st.sampled_from([0, 1, 2, 3, 5, None])
stalls = st.sampled_from([None, 1, 2, 3, 10])
slacks = st.sampled_from([0.0, 0.0, 0.1, 0.25, 0.5, 0.7, 1.0])


@dataclass
class Played:
    """A conversation that was played: its record as JSON, and every prompt as it was sent."""

    events: list[dict[str, Any]]
    sent: list[dict[str, Any]]
    conversation: sp.Conversation | sp.AgentSession
    result: sp.EpisodeResult


def as_json(value: Any) -> Any:
    return json.loads(json.dumps(value))


def choices_of(odd: Any) -> dict[int, Any]:
    """What `tests/data/odd_strategy.py` chose, as a record holds it."""
    texts = {k: {turn: as_json(text) for turn, text in spoken.items()} for k, (_, _, spoken) in odd.chosen.items()}
    return {k: (*odd.chosen[k][:2], texts[k]) for k in odd.chosen}


def view_as_json(view: View) -> dict[str, Any]:
    numbers = {name: getattr(view, name) for name in ("tokens", "shown_steps", "dropped_turns", "prefix_tokens")}
    marked = [list(pair) for pair in view.masked_results]
    return {**numbers, "messages": as_json(view.messages), "masked_results": marked, "purpose": view.purpose}


def converse(
    game: str,
    script: Sequence[Move],
    *,
    host: bool = False,
    answers: Sequence[dict[str, Any]] = ANSWERS,
    host_seed: int | None = None,
    **options: Any,
) -> Played:
    """Play a script to its end or the episode's, whichever comes first; `answers` are the summaries, over and over.

    With `host_seed` the calls are those of an agent session, whose host treats them as it likes, in any order.
    """
    events: list[dict[str, Any]] = []
    episode = sp.Episode(game, transcript=events, **options)
    about: dict[str, Any] = {"player": "script", "foreign_tools": [NOTE], "head": [HOST_HEAD] if host else []}
    conversation: sp.Conversation | sp.AgentSession
    if host_seed is None:
        conversation = sp.Conversation(episode, **about)
    else:
        conversation, chance = sp.AgentSession(episode, summaries=True, **about), random.Random(host_seed)
    sent: list[dict[str, Any]] = []
    schemas: dict[int, tuple[Any, Any]] = {}
    """By the identity of the tools of a prompt, which most prompts share: them, so that they stay, and their JSON."""

    def prompted() -> bool:
        prompt = conversation.prompt()
        while prompt is not None:
            assert conversation.view is not None
            if id(prompt.tools) not in schemas:
                schemas[id(prompt.tools)] = prompt.tools, [as_json(asdict(tool)) for tool in prompt.tools]
            tools = schemas[id(prompt.tools)][1]
            sent.append({**view_as_json(conversation.view), "tools": tools, "max_tokens": prompt.max_tokens})
            assert as_json(prompt.messages) == sent[-1]["messages"]
            assert prompt.purpose == conversation.view.purpose
            if prompt.purpose == "play":
                return True
            answer = answers[conversation.view.summaries % len(answers)]
            assert not conversation.receive({"role": "assistant", **answer})
            prompt = conversation.prompt()
        return False

    for move in script:
        if not prompted():
            break
        conversation.receive(move.message)
        if isinstance(conversation, sp.AgentSession):
            act_as_host(chance, conversation)
        for one in conversation.latest_turn.calls:
            if one.name == "note":
                conversation.add({"role": "tool", "tool_call_id": one.id, "content": "noted: word word"})
        for message in move.after:
            conversation.add(message)
    prompted()
    episode.close()
    assert episode.result is not None
    return Played(as_json(events), sent, conversation, episode.result)


def whole_observations(events: Sequence[dict[str, Any]]) -> list[str]:
    """The observations of a record as the same play shows them without caps, in their order."""
    free = {"budget": sp.Budget(stalled_turns=None), "batch": "all"}  # without the pages that a turn read it may stall
    config = EpisodeConfig.from_event(events[0]).model_copy(update=free)
    calls = [event for event in events if event["event"] == "call" and not event["is_error"]]
    with sp.Episode.from_config(config, tokenizer=Words()) as episode:
        return [
            episode.call(event["name"], event["arguments"]).text
            for event in calls
            if event["name"] in ("act", "observe")
        ]


def act_as_host(chance: random.Random, session: sp.AgentSession) -> None:
    """Answer, edit, refuse or forget the calls of a reply, in any order.

    An earlier call that was left open cannot be played after a later one; the host then refuses it, or forgets it.
    """
    calls = list(session.open_calls)
    chance.shuffle(calls)
    for call in calls:
        if call not in session.open_calls:
            continue
        match chance.randrange(6):
            case 0:
                session.refuse(call.id, "The user said no.")
            case 1:
                session.edit(call.id, {"action": "2"})
            case 2:
                pass
            case way:
                steps, progress = session.episode.stats, session.progress
                before = steps.tool_calls
                try:
                    session.answer(call.id, earlier=way < 5)
                except sp.InvalidArgumentError:
                    assert (steps.tool_calls, session.progress) == (before, progress)
                    if chance.random() < 0.5:
                        session.refuse(call.id, "It is too late.")


_HEADS: dict[Any, int] = {}


def head_tokens(game: str, tokenizer: Any, *, host: bool, manual: str = "tool") -> int:
    """The tokens of a head with its schemas and priming: the smallest budget there is."""
    key = game, tokenizer.name, host, manual
    if key not in _HEADS:
        played = converse(game, [], host=host, seed=0, manual=manual, tokenizer=tokenizer)
        [head] = [event for event in played.events if event["event"] == "head"]
        messages = sum(checker.message_tokens(message, tokenizer.count) for message in head["messages"])
        _HEADS[key] = messages + 3 + checker.tools_tokens(head["tools"], tokenizer.count)
    return _HEADS[key]


def strategy_tokens(budget: dict[str, Any], tokenizer: Any) -> int:
    """What a strategy adds to the smallest prompt: the schemas of tools, the reserve for summaries, an answer."""
    summary, recall = budget.get("summary_tokens"), budget.get("recall_tokens")
    made = {"notes_tokens": notes_spec, "recall_tokens": recall_spec, "memory_tokens": memory_spec}
    words = Wording.of(VERSION)
    tools = [as_json(asdict(spec(budget[name], words))) for name, spec in made.items() if budget.get(name) is not None]
    tools += [as_json(asdict(pages_spec(words)))] if budget.get("beyond_result") == "offload" else []
    added = checker.tools_tokens(tools, tokenizer.count) - 12 if tools else 0
    if summary is not None:
        asking = {"history": None, "prompt_tokens": None, "slack": 0, "summary_tokens": summary}
        added += checker.Judge([], [], [], asking, tokenizer.count).reserve
    if recall is not None:
        results = budget.get("result_tokens", "auto")
        added += recall + (max(32, (added + recall + 600) // 3) if results == "auto" else results or 0)
    return added


def check_record(events: list[dict[str, Any]]) -> None:
    """Whatever the strategy: a record replays, can be continued from its middle, and says where every token went."""
    assert replay(events).identical
    with resume(events[: len(events) // 2], transcript=[]) as resumed:
        assert resumed.conversation is not None
    record = Record(events)
    assert all(sent.sha256 == sent.recorded_sha256 for sent in record.sent_prompts())
    accounts = Accounts.of(record)
    assert [*map(sum, accounts.prompts())] == [view["tokens"] for view in record.views]
    list(accounts.departures())
