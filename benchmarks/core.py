"""The speed of the core: calls, views, the tokenizer, the prompt hash. `python benchmarks/core.py`.

Peers are measured in the same run: the bare `env.step` below `Episode.call`, `langchain_core.messages.trim_messages`
with the same exact count beside the view. Machines differ and are noisy, so ratios count, and every figure is a median.

A view is measured in three situations. *Next turn*: a turn that was not counted before is appended to the window.
*Rebuilt*: a new window over new message objects whose texts were counted before. *Unknown*: a new window over texts
that were never counted. The peer is measured with two counters: one that tokenizes every text, and this library's,
which caches texts.
"""

from __future__ import annotations

import dataclasses
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from langchain_core.messages import AIMessage, BaseMessage, HumanMessage, SystemMessage, ToolMessage, trim_messages
from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.context import ContextWindow
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.tokens import TokenCounter, Tokenizer, get_tokenizer
from smartplay_tools.context.turns import Form, Item, Turn
from smartplay_tools.players.conversion import function_call
from smartplay_tools.transcript.hashing import message_bytes, prompt_sha256, tools_bytes
from smartplay_tools.types import ResolvedBudget

HANOI = "Hanoi3Disk-v0"
UNENDING = sp.Budget(tool_calls=None)


def microseconds(call: Callable[[], object], runs: int) -> float:
    """Median time of a call."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times) * 1e6


def calls_table() -> Table:
    """`Episode.call("act")` over the bare step, move by move in one loop."""
    spec = dataclasses.replace(sp.GAMES[HANOI], rollout=10**9)
    move = '{"action": "Move the top disk of rod B to the top of rod A"}'
    bare = spec.make()
    bare.reset(seed=0)
    with tempfile.TemporaryDirectory() as folder:
        plain = sp.Episode(spec, seed=0, budget=UNENDING)
        filed = sp.Episode(spec, seed=0, budget=UNENDING, transcript=Path(folder, "calls.jsonl"))
        calls = {
            "env.step": lambda: bare.step(2),
            "Episode.call": lambda: plain.call("act", move),
            "Episode.call, transcript file": lambda: filed.call("act", move),
        }
        times: dict[str, list[float]] = {name: [] for name in calls}
        for _ in range(3_000):
            for name, call in calls.items():
                start = time.perf_counter()
                call()
                times[name].append((time.perf_counter() - start) * 1e6)
        plain.close()
        filed.close()
    table = Table("one action of Hanoi", "microseconds", "added", title="A call", title_justify="left")
    base = statistics.median(times["env.step"])
    for name, measured in times.items():
        median = statistics.median(measured)
        table.add_row(name, f"{median:.1f}", f"{median - base:.1f}")
    return table


def conversation(turns: int) -> tuple[list[sp.Message], list[Turn]]:
    """A long conversation on message objects that were never counted: head, and turns of one act each."""
    head: list[sp.Message] = [{"role": "system", "content": "Play."}, {"role": "user", "content": "Begin."}]
    made, words = [], Wording.of(VERSION)
    for n in range(turns):
        call_id = f"call_{n}"
        call = function_call(call_id, "act", {"action": "Move the top disk of rod A to the top of rod B"})
        assistant: sp.Message = {"role": "assistant", "content": f"Step {n}: I move a disk.", "tool_calls": [call]}
        text = f"You tried move {n}. Current configuration:\n- A: |bottom, [2, 1, 0], top|\n- B: |bottom, [], top|"
        result: sp.Message = {"role": "tool", "content": text, "tool_call_id": call_id}
        made.append(Turn(n, assistant, (Item(result, n + 1, n + 1, position=0, words=words),), n))
    return head, made


def as_langchain(messages: list[sp.Message]) -> list[BaseMessage]:
    """The same messages as new objects of LangChain; each carries its chat form, to be counted alike."""
    made: list[BaseMessage] = []
    for message in messages:
        content, chat = str(message["content"] or ""), {"chat": message}
        if message["role"] == "assistant":
            calls = [{"name": "act", "args": {"action": "A"}, "id": c["id"]} for c in message["tool_calls"]]
            made.append(AIMessage(content, tool_calls=calls, additional_kwargs=chat))
        elif message["role"] == "tool":
            made.append(ToolMessage(content, tool_call_id=message["tool_call_id"], additional_kwargs=chat))
        else:
            kind = SystemMessage if message["role"] == "system" else HumanMessage
            made.append(kind(content, additional_kwargs=chat))
    return made


def views() -> Table:
    """A view in three situations, and trim_messages on the same history, keeping no more, with two exact counters."""
    columns = ("turns", "cap", "next turn", "rebuilt", "unknown", "trim, exact", "ratio", "trim, our cache", "ratio")
    table = Table(*columns, title="One prompt's view, microseconds", title_justify="left")
    for cap in (4096, None):
        for length in (100, 500, 1_000, 10_000):
            counter = TokenCounter()
            ours = view_microseconds(counter, length, cap)
            row = [f"{length:,}", str(cap), *(f"{time:,.0f}" for time in ours)]
            for theirs in (exact_counter(counter.tokenizer), counter.message):
                if length <= 1_000:
                    trim = trim_microseconds(length, theirs, cap)
                    row += [f"{trim:,.0f}", f"{trim / ours[0]:,.0f}"]
                else:
                    row += ["not run", ""]
            table.add_row(*row)
    return table


def strategies() -> Table:
    """The next turn under every strategy, all in one loop, and how often that of plain dropping it takes."""
    columns = ("strategy", "slack", *(f"{length:,} turns" for length in STRATEGY_TURNS), "ratio to dropping")
    table = Table(*columns, title="One prompt's view under every strategy, microseconds", title_justify="left")
    by_length = [strategy_microseconds(length) for length in STRATEGY_TURNS]
    for name, slack in STRATEGIES:
        times = [times[name, slack] for times in by_length]
        ratios = [of_length[name, slack] / of_length["dropping", slack] for of_length in by_length]
        low, high = min(ratios), max(ratios)
        table.add_row(name, f"{slack:g}", *(f"{time:,.0f}" for time in times), f"{low:.2f} to {high:.2f}")
    return table


UNCUT: dict[str, Any] = {"prompt_tokens": 4096, "result_tokens": None, "manual_tokens": None, "tool_calls": None}
STRATEGY_TURNS = (100, 1_000, 10_000)
STRATEGIES: dict[tuple[str, float], dict[str, Any]] = {
    ("dropping", 0.0): {},
    ("masking", 0.0): {"beyond_history": "mask"},
    ("notes", 0.0): {"notes_tokens": 200},
    ("masking, notes", 0.0): {"beyond_history": "mask", "notes_tokens": 200},
    ("dropping", 0.5): {},
    ("masking", 0.5): {"beyond_history": "mask"},
    ("notes", 0.5): {"notes_tokens": 200},
    ("summaries", 0.5): {"summary_tokens": 300},
    ("all three", 0.5): {"beyond_history": "mask", "notes_tokens": 200, "summary_tokens": 300},
}
"""The budgets, by name and slack. Their history and cap leave about as many turns in a view under each."""


def strategy_microseconds(length: int) -> dict[tuple[str, float], float]:
    """The median time of the next turn under every strategy, requests for summaries included."""
    counter = TokenCounter()
    head, turns = conversation(length + 60)
    # Notes are taken every fifty turns; between them they are what has to be pinned.
    turns = [dataclasses.replace(turn, notes=turn.number // 50 * 50) for turn in turns]
    windows = {}
    first = ContextWindow(head, [], ResolvedBudget(history=45, **UNCUT), counter)
    for (name, slack), strategy in STRATEGIES.items():
        budget = ResolvedBudget(history=45, slack=slack, **UNCUT, **strategy)
        windows[name, slack] = ContextWindow(head, [], budget, counter)
    times: dict[tuple[str, float], list[float]] = {key: [] for key in windows}
    for number, turn in enumerate(turns):
        first.append(turn)  # what a turn works out once is worked out here, and not for the strategy that comes first
        first.view()
        for key, window in windows.items():
            start = time.perf_counter()
            window.append(turn)
            if window.view().purpose != "play":
                window.answer("The disks have moved on.")
                window.view()
            if number >= length:
                times[key].append((time.perf_counter() - start) * 1e6)
    return {key: statistics.median(measured) for key, measured in times.items()}


def view_microseconds(counter: TokenCounter, length: int, cap: int | None) -> tuple[float, float, float]:
    """The time of a view: next turn, rebuilt, unknown."""
    budget = ResolvedBudget(history=None, prompt_tokens=cap, result_tokens=None, manual_tokens=None, tool_calls=None)
    head, turns = conversation(length + 30)
    counter.text("The tokenizer is loaded before anything is measured.")

    def build(turns: list[Turn]) -> ContextWindow:
        window = ContextWindow.of(turns, head, [], budget, counter)
        window.view()
        return window

    def grow(turn: Turn) -> None:
        window.append(turn)
        window.view()

    unknown = microseconds(partial(build, turns[:length]), 1)
    window = build(turns[:length])
    following = [microseconds(partial(grow, turn), 1) for turn in turns[length:]]
    rebuilt = []
    for _ in range(5):
        head, turns = conversation(length)
        rebuilt.append(microseconds(partial(build, turns), 1))
    return statistics.median(following), statistics.median(rebuilt), unknown


def exact_counter(tokenizer: Tokenizer) -> Callable[[sp.Message], int]:
    """Budget tokens of a message without a memory: what a user of trim_messages writes."""

    def count(message: sp.Message) -> int:
        calls = [call["function"] for call in message.get("tool_calls", ())]
        texts = [message["role"], str(message["content"] or ""), *(f["name"] for f in calls)]
        texts += [f["arguments"] for f in calls]
        return 3 + 11 * len(calls) + 8 * (message["role"] == "tool") + sum(map(tokenizer.count, texts))

    return count


def trim_microseconds(length: int, count: Callable[[sp.Message], int], cap: int | None) -> float:
    """The time of trim_messages on message objects that it has not seen."""

    def count_all(history: list[BaseMessage]) -> int:
        return sum(count(message.additional_kwargs["chat"]) for message in history) + 3

    head, turns = conversation(length)
    messages = [*head, *(message for turn in turns for message in turn.messages)]
    times = []
    for _ in range(3):
        fresh = as_langchain(messages)
        start = time.perf_counter()
        kept = trim_messages(
            fresh, max_tokens=cap or 10**9, token_counter=count_all, include_system=True, start_on=("human", "ai")
        )
        times.append((time.perf_counter() - start) * 1e6)
        assert cap is None or count_all(kept) <= cap
    return statistics.median(times)


def counting() -> Table:
    """Tokens counted in a second, and what a transcript adds to a prompt for its hash."""
    text = sp.GAMES[HANOI].make().manual
    tokenizer = get_tokenizer()
    tokens = tokenizer.count(text)
    count = microseconds(lambda: tokenizer.count(text), 300)
    head, turns = conversation(200)
    tools: tuple[sp.ToolSpec, ...] = ()
    shown = turns[-60:]
    lines = [line for turn in shown for line in Form.lines(turn.whole)]

    def new_turn() -> None:
        turn = Turn(7, shown[0].assistant, shown[0].items, 0)
        assert all(Form.lines(turn.whole))

    def sha256() -> None:
        prompt_sha256([*(message_bytes(m, ()) for m in head), *lines], tools_bytes(tools))

    table = Table("what", "figure", title="Counting and hashing", title_justify="left")
    table.add_row("tokens counted per second, one core", f"{tokens / count * 1e6:,.0f}")
    table.add_row("canonical JSON of a new turn, microseconds", f"{microseconds(new_turn, 500):.1f}")
    table.add_row("sha256 of a prompt of 60 turns, microseconds", f"{microseconds(sha256, 500):.1f}")
    return table


if __name__ == "__main__":
    console = Console(width=120)
    for measure in (calls_table, views, strategies, counting):
        console.print(measure())
