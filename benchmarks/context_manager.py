"""The time of a fitted prompt, beside LangChain's `trim_messages` with the same exact counter, in one run.

    python benchmarks/context_manager.py

Conversations of 100, 1,000 and 5,000 messages, one request and a cap of 8,000 tokens. "Known" means that all texts were
counted before, by either; one exchange is new. Each figure is the median of its rounds, which alternate, in time of the
processor.
"""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable
from typing import Any

from langchain_core.messages import convert_to_messages, convert_to_openai_messages, trim_messages
from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter

CAP, ROUNDS = 8_000, 9
WORDS = ["the", "door", "opens", "north", "key", "lamp", "You", "see", "a", "wooden", "chest", "日本", "🙂"]


def conversation(length: int) -> list[dict[str, Any]]:
    """An agent's messages: one request, then replies with a call and results of many lengths."""
    rng = random.Random(length)
    messages: list[dict[str, Any]] = [{"role": "system", "content": "You read."}, {"role": "user", "content": "Read."}]
    for number in range((length - 2) // 2):
        function = {"name": "read", "arguments": f'{{"page": {number}}}'}
        calls = [{"id": f"c{number}", "type": "function", "function": function}]
        words = " ".join(rng.choices(WORDS, k=rng.choice([5, 30, 100, 400])))
        messages.append({"role": "assistant", "content": f"Page {number}.", "tool_calls": calls})
        messages.append({"role": "tool", "tool_call_id": f"c{number}", "content": f"{number}: {words}"})
    return messages


def milliseconds(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return 1_000 * (time.process_time() - begun)


def main() -> None:
    table = Table("messages", "tokens", "fit, nothing known", "fit, known", "trim_messages, known", "ratio")
    for length in (100, 1_000, 5_000):
        messages = conversation(length)
        theirs, counter, manager = convert_to_messages(messages), TokenCounter(), sp.ContextManager(CAP)
        cold = milliseconds(lambda manager=manager, messages=messages: manager.fit(messages))
        counter.prompt(messages)

        def trim(theirs: Any = theirs, counter: TokenCounter = counter) -> object:
            def count(given: Any) -> int:
                return counter.prompt(convert_to_openai_messages(given))

            return trim_messages(theirs, max_tokens=CAP, strategy="last", include_system=True, token_counter=count)

        fits, trims = [], []
        for number in range(ROUNDS):
            grown = messages[: len(messages) - 2 * (ROUNDS - number - 1)]
            fits.append(milliseconds(lambda manager=manager, grown=grown: manager.fit(grown)))
            trims.append(milliseconds(trim))
        fit, other = statistics.median(fits), statistics.median(trims)
        cells = (
            f"{counter.prompt(messages):,}",
            f"{cold:.1f} ms",
            f"{fit:.2f} ms",
            f"{other:.1f} ms",
            f"{other / fit:.0f}",
        )
        table.add_row(f"{length:,}", *cells)
    Console().print(table)


if __name__ == "__main__":
    main()
