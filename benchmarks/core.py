"""The speed of the core: calls and views. `python benchmarks/core.py`.

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

from langchain_core.messages import AIMessage, BaseMessage, HumanMessage, SystemMessage, ToolMessage, trim_messages
from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.context import ContextWindow
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.tokens import TokenCounter, Tokenizer
from smartplay_tools.context.turns import Item, Turn
from smartplay_tools.players.conversion import function_call
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


if __name__ == "__main__":
    console = Console(width=120)
    for measure in (calls_table, views):
        console.print(measure())
