"""Compactors of other projects, with their code unchanged, in a real game: what holds for each of them.

Those whose framework is not in this environment are left out; `.ci/framework compactors` and `openhands` have it.
"""

from __future__ import annotations

import itertools
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import smartplay_tools as sp
from smartplay_tools.compactors.retrieval import MemoryCompactor, WordMemory
from smartplay_tools.context.compaction import Room
from smartplay_tools.context.strategies import custom
from smartplay_tools.errors import MissingExtraError
from smartplay_tools.registry import resolve

GAME = "RockPaperScissorDifferentScore-v0"
CAP = 1500
FILES = Path(__file__).parents[2] / "experiments" / "compactors"
OURS = "smartplay_tools.errors:ContextOverflowError"


class Row(NamedTuple):
    """A compactor, and what is known about it."""

    name: str
    framework: str
    """The module that it needs."""
    overflow: str = OURS
    """What it takes for a full context."""
    options: str = ""
    idle: str = ":tokens=1000000"
    """The options with which it has nothing to do."""
    ends: str = "rollout"
    """How an episode ends in which no question is longer than a prompt."""
    refused: str | None = None
    """How an episode ends in which every question is refused; None if it asks nothing."""
    is_exact: bool = True
    """Whether the framework can hold every conversation: two user messages in a row, an empty reply."""
    acts: bool = True
    """Whether it does anything in a game whose results are short."""


LANGCHAIN = "langchain_core.exceptions:ContextOverflowError"
PYDANTIC = "pydantic_ai.exceptions:ModelContextWindowExceededError"
ROWS = [
    Row("langchain-summary", "langchain.agents", LANGCHAIN, refused="strategy_error"),
    Row("langchain-clear", "langchain.agents", LANGCHAIN),
    Row("deepagents-summary", "deepagents", LANGCHAIN, refused="strategy_error"),
    Row("langmem-summary", "langmem", LANGCHAIN, refused="strategy_error"),
    Row("inspect-edit", "inspect_ai", ends="strategy_error"),
    Row("inspect-trim", "inspect_ai"),
    Row("inspect-summary", "inspect_ai", ends="strategy_error", refused="strategy_error"),
    Row("pydantic-ai-newest", "pydantic_ai", PYDANTIC, idle=":keep=1000"),
    Row("pydantic-ai-window", "pydantic_ai_harness", PYDANTIC),
    Row("pydantic-ai-summary", "pydantic_ai_harness", PYDANTIC, ends="strategy_error", refused="strategy_error"),
    Row(
        "agent-framework-summary",
        "agent_framework",
        "agent_framework.exceptions:ChatClientInvalidRequestException",
        idle=":more=1000",
        refused="rollout",
    ),
    Row("llama-index-summary", "llama_index", options=":tokens=400", refused="strategy_error"),
    Row(
        f"{FILES / 'adk_summary.py'}:Summary", "google.adk", "google.genai.errors:ClientError", refused="rollout",
        is_exact=False,
    ),
    Row(
        f"{FILES / 'openhands_summary.py'}:Summary",
        "openhands.sdk",
        "openhands.sdk.llm.exceptions:LLMContextWindowExceedError",
        refused="strategy_error",
        is_exact=False,
    ),
    Row(f"{FILES / 'haystack_compaction.py'}:Summary", "haystack", refused="rollout"),
    Row(f"{FILES / 'haystack_compaction.py'}:Window", "haystack"),
    Row(f"{FILES / 'haystack_compaction.py'}:Pruning", "haystack"),
    Row(f"{FILES / 'autogen_contexts.py'}:Buffered", "autogen_core", idle=":keep=1000"),
    Row(f"{FILES / 'autogen_contexts.py'}:TokenLimited", "autogen_core"),
    Row(f"{FILES / 'ag2_compact.py'}:Summary", "ag2", refused="strategy_error"),
    Row(f"{FILES / 'ag2_compact.py'}:Newest", "ag2"),
    Row(f"{FILES / 'agno_compression.py'}:Compression", "agno", refused="rollout"),
    Row(f"{FILES / 'headroom_compress.py'}:Compression", "headroom", acts=False),
    Row("memory-bm25", "smartplay_tools", idle=":tokens=100"),
    Row("memory-wordllama", "wordllama", idle=":tokens=100"),
]  # fmt: skip
FAST = ("llama-index-summary",)


def is_installed(module: str) -> bool:
    """Whether a module can be imported; what it is in is imported for this."""
    package = module.rpartition(".")[0]
    return (not package or is_installed(package)) and find_spec(module) is not None


HERE = [row for row in ROWS if is_installed(row.framework)]


def rows(rows: list[Row]) -> Any:
    marked = [
        pytest.param(row, id=row.name.rpartition("/")[2], marks=[] if row.name in FAST else pytest.mark.slow)
        for row in rows
    ]
    return pytest.mark.parametrize("row", marked)


def play(strategy: str, player: Any = None, **budget: Any) -> tuple[sp.EpisodeResult, list[Any]]:
    events: list[Any] = []
    limits = sp.Budget(strategy=strategy, history=None, **budget)
    with sp.Episode(GAME, seed=1, manual="pinned", budget=limits, transcript=events) as episode:
        sp.play(episode, player or sp.get_player("rule"))
    assert episode.result is not None
    return episode.result, events


@rows(HERE)
def test_it_plays_under_the_cap_and_is_on_record(row):
    result, events = play(row.name + row.options, prompt_tokens=CAP)
    assert result.end_reason == row.ends
    assert (result.rewrites > 0) == row.acts or row.ends == "strategy_error"
    assert max(event["tokens"] for event in events if event["event"] == "view") <= CAP
    packages = custom.load_strategy(row.name).make.packages
    assert set(packages) <= set(events[0]["versions"])
    assert sp.replay(events).identical


class Odd:
    """Says and calls what frameworks find hard to hold."""

    name = "odd"

    def __init__(self) -> None:
        calls = [("act", '{"action": 1}'), ("no such tool", "{}"), ("act", "no JSON"), ("act", "[1]"), ("observe", "")]
        both = [("act", '{"action": "Paper"}'), ("read_manual", '{"a": {"b": [null, 1.5, "é"]}}')]
        texts = ["", "Words.", "half \ud83d", " \n"]
        self._replies = itertools.cycle(itertools.product(texts, [both, [], *([call] for call in calls)]))

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        """Return the next reply."""
        text, calls = next(self._replies)
        listed = [
            {"id": f"c{at}", "type": "function", "function": {"name": name, "arguments": arguments}}
            for at, (name, arguments) in enumerate(calls)
        ]
        return sp.Reply({"role": "assistant", "content": text, **({"tool_calls": listed} if calls else {})})


@rows([row for row in HERE if row.is_exact])
def test_with_nothing_to_do_it_returns_the_same_messages(row):
    result, _ = play(row.name + row.idle, Odd(), stalled_turns=None, tool_calls=30)
    assert result.end_reason == "tool_calls"
    assert result.rewrites == 0
    assert result.questions == 0


@rows([row for row in HERE if not row.is_exact])
def test_of_a_conversation_that_its_framework_can_hold_it_returns_the_same_messages(row):
    result, _ = play(row.name + row.idle)
    assert result.end_reason == "rollout"
    assert result.rewrites == 0


@rows([row for row in HERE if row.refused])
def test_a_refused_question_is_its_framework_s_full_context(row):
    result, _ = play(row.name + row.options, prompt_tokens=CAP, question_tokens=100)
    assert result.refused_questions == result.questions > 0
    assert result.end_reason == row.refused
    overflow = resolve(row.overflow)
    assert isinstance(custom.load_strategy(row.name).make.overflow("too long"), overflow)


@rows([row for row in ROWS if row not in HERE and ".py:" not in row.name])
def test_a_framework_that_is_not_installed_is_one_sentence(row):
    with pytest.raises(MissingExtraError, match=r"^\S.* needs an optional dependency: .*pip install .*\["):
        sp.Episode(GAME, seed=1, budget=sp.Budget(strategy=row.name, prompt_tokens=CAP))


@pytest.mark.skipif(not is_installed("headroom"), reason="needs headroom-ai")
def test_headroom_shortens_a_long_result():
    lines = "\n".join(f"2026-01-01 12:00:{second % 60:02} INFO request {second} was served" for second in range(500))
    history: Any = [
        {"role": "user", "content": "Look."},
        {**sp.call("look"), "content": ""},
        {"role": "tool", "content": lines, "tool_call_id": "call_0"},
        *({"role": "user" if number % 2 else "assistant", "content": "On."} for number in range(9)),
    ]
    compactor = custom.load_strategy(f"{FILES / 'headroom_compress.py'}:Compression").make()
    room = Room(2_000, None, None, lambda messages: sum(len(each["content"]) // 4 for each in messages))
    made: Any = None
    try:
        next(compactor.compact(history, room))
    except StopIteration as stop:
        made = stop.value
    assert len(made) == len(history)
    assert len(made[2]["content"]) < len(lines)


def test_options_follow_each_other_with_commas_or_colons():
    expected = ("langchain-summary", {"tokens": 1200, "keep": 6})
    assert custom.parted("langchain-summary:tokens=1200,keep=6") == expected
    assert custom.parted("langchain-summary:tokens=1200:keep=6") == expected
    assert custom.parted("mine.py:S:a=[1,2],b=c,d") == ("mine.py:S", {"a": [1, 2], "b": "c,d"})
    with pytest.raises(sp.InvalidArgumentError, match="each key once"):
        custom.parted("langchain-summary:keep=1,keep=2")


class Notebook(MemoryCompactor):
    """A memory that says how many turns it was given, and then more than fits."""

    def __init__(self) -> None:
        super().__init__(tokens=8)
        self.turns: list[Any] = []

    def write(self, turn: Any) -> None:
        self.turns.append(turn)

    def read(self, query: str) -> str:
        return f"{len(self.turns)} turns before:\n{query}\nand so on"


def words(messages: Any) -> int:
    return sum(len(message["content"].split()) for message in messages)


def test_a_memory_is_given_the_turns_that_leave_and_shows_the_lines_that_fit():
    task = [{"role": "user", "content": "Play the game."}]
    turns = [[{"role": "assistant", "content": f"move {n}"}, {"role": "user", "content": "You won."}] for n in range(6)]
    memory = Notebook()
    for played in range(1, 7):
        history = [*task, *itertools.chain(*turns[:played])]
        shown: Any = memory.compact(history, Room(24, None, None, words))
        left = max(0, played - 3)
        remembered = [{"role": "user", "content": f"{left} turns before:\nmove {played - 1}\nYou won."}] if left else []
        assert memory.turns == turns[:left]
        assert shown == [*task, *remembered, *itertools.chain(*turns[left:played])]


def test_our_memory_returns_the_turns_with_the_words_of_the_query():
    memory = WordMemory()
    for text in ("The key is red.", "The door is shut.", "The red door opens with a key."):
        memory.write([{"role": "assistant", "content": None}, {"role": "user", "content": text}])
    assert memory.read("red").splitlines() == [
        "Turn 0:",
        "The key is red.",
        "Turn 2:",
        "The red door opens with a key.",
    ]
    assert memory.read("window") == ""
