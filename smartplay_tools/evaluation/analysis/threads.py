"""The tables of threads of context managers: what their prompts were, and what they cost under the rules of caches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from smartplay_tools.evaluation.analysis.formats import ShownColumn, TextTable, columns, figures_table
from smartplay_tools.evaluation.analysis.headline import MANAGED
from smartplay_tools.evaluation.analysis.numbers import NOTHING, dollars, percent
from smartplay_tools.evaluation.costs.charges import charge
from smartplay_tools.evaluation.costs.tariffs import Tariff
from smartplay_tools.manager.record import RecordedThread
from smartplay_tools.records.threads import thread_requests, thread_row
from smartplay_tools.types.quantities import short

Thread = Mapping[str, Any]
"""The row of a thread."""

NOTES = ("refused: prompts that did not fit; dropped: prompts without some of the messages",)
COUNT_NOTES = (
    "masked, cut, repaired: prompts in which this became of a message",
    "over: prompts over their cap by the provider's count, of those that it has counted; theirs: its tokens to ours",
    "above: the most that it counted above ours in one prompt; a cap that is lower by so much holds by its count, too",
    f"{MANAGED}: with prompts that the provider edited or compacted itself, of which it has counted something else",
)
COST_NOTES = (
    "costs are of prompts alone, in uncached tokens of the input; in USD where the column is a model",
    "replies are not on record; a model of a bill: docs/context-cost.md has the definition",
)


def _count(name: str) -> Callable[[Thread], str]:
    return lambda row: NOTHING if row[name] is None else f"{row[name]:,}"


PROMPTS: Sequence[ShownColumn[Thread]] = (
    ("prompts", _count("prompts")),
    ("tokens", lambda row: short(row["tokens"])),
    ("largest", _count("largest")),
    ("cap", _count("cap")),
    ("prefix", lambda row: percent(row["prefix_tokens"] / row["tokens"] if row["tokens"] else None)),
    ("refused", _count("refusals")),
    ("dropped", _count("dropped")),
)
COUNTS: Sequence[ShownColumn[Thread]] = (
    *((name, _count(name)) for name in ("masked", "cut", "repaired")),
    ("over", lambda row: f"{row['over']} of {row['counted']}" if row["counted"] else NOTHING),
    ("theirs", lambda row: NOTHING if row["ratio"] is None else f"{row['ratio']:.3f}"),
    ("above", _count("most_above")),
)


def threads_tables(rows: Sequence[Thread]) -> tuple[TextTable, TextTable]:
    """Return what each thread's prompts were, and what became of messages, with the provider's count beside ours."""
    second = "messages, and the provider's count"
    return _table("threads", rows, PROMPTS, NOTES, mark=""), _table(second, rows, COUNTS, COUNT_NOTES)


def threads_table(rows: Sequence[Thread]) -> TextTable:
    """Return both in one table, for a page."""
    return _table("threads", rows, (*PROMPTS, *COUNTS), (*NOTES, *COUNT_NOTES))


def _table(
    title: str, rows: Sequence[Thread], shown: Sequence[ShownColumn[Thread]], notes: Sequence[str], mark: str = MANAGED
) -> TextTable:
    """`mark` follows the names of threads whose provider managed the context; the notes explain it."""
    named = [(row["thread"] + mark * bool(row["managed"]), row) for row in rows]
    return figures_table(title, "thread", {"": named}, lambda _: shown, notes)


def thread_costs(threads: Sequence[RecordedThread], tariffs: Sequence[Tariff]) -> Iterator[dict[str, Any]]:
    """Yield a row for each thread under each tariff."""
    for thread in threads:
        log = thread_requests(thread)
        row = thread_row(thread)
        for tariff in tariffs:
            made = charge(log, tariff.rule, marks=tariff.marks, price=tariff.price)
            facts = {"thread": row["thread"], "prompts": row["prompts"], "tokens": made.prompt, "tariff": tariff.label}
            yield {**facts, "read": made.hit, "written": made.written, "cost": made.cost, "usd": bool(tariff.price)}


def thread_costs_table(rows: Sequence[Mapping[str, Any]], tariffs: Sequence[Tariff]) -> TextTable:
    """Return a row for each thread, with a column for each tariff."""
    width = len(tariffs)
    cells = []
    for first in range(0, len(rows), width):
        of_thread = rows[first : first + width]
        costs = (dollars(row["cost"]) if row["usd"] else short(row["cost"]) for row in of_thread)
        facts = of_thread[0]["thread"], f"{of_thread[0]['prompts']:,}", short(of_thread[0]["tokens"])
        cells.append((*facts, *costs))
    names = columns("thread", "prompts", "tokens", *(tariff.label for tariff in tariffs))
    return TextTable("what the prompts of a thread cost", names, tuple(cells), COST_NOTES)
