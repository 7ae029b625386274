"""What windows of other projects send under a cap: the table of `docs/cap-audit.md`.

    python -m venv build/audit
    build/audit/bin/python -m pip install -e . -r experiments/cap-audit/requirements.txt
    build/audit/bin/python experiments/cap_audit.py             # plays; ten minutes
    build/audit/bin/python experiments/cap_audit.py --publish   # the same, and rows and table go into the checkout

Every trimmer gets the same histories of chat completions under the same caps, and what it returns is judged by code
that shares none with the library: a count by tiktoken after the definition of budget tokens, and a rule of pairs.
"""

from __future__ import annotations

import copy
import itertools
import platform
import random
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from statistics import fmean, median
from typing import Any

from cap_audit_histories import Messages, history, plain, verdict
from page_tables import HERE, Experiment, arguments, markdown_table, write_rows

import smartplay_tools as sp
from smartplay_tools.records.rows import Row

Trimmer = Callable[[Messages, int], Messages]

SEEDS = ("first", "confirmed")
"""The histories that were looked at while this was written, and those of the table, made once afterwards."""
KINDS = ("chat", "loop", "chinese", "json", "base64", "parallel", "huge")
CAPS = (1_000, 2_000, 4_000, 8_000)
EACH = 4
"""How many histories there are of a kind under a cap."""
QUICK = 0.05
"""Seconds."""


def ours(*, keeps: bool = True, **settings: Any) -> Trimmer:
    """`sp.ContextManager`, one for each cap as its pages have it, or a new one for each prompt."""
    managers: dict[int, sp.ContextManager] = {}

    def trim(messages: Messages, cap: int) -> Messages:
        if cap not in managers or not keeps:
            managers[cap] = sp.ContextManager(cap, **settings)
        return managers[cap].fit(messages).messages

    return trim


OURS: dict[tuple[str, str, str], Trimmer] = {
    ("smartplay-tools", "ContextManager, slack 0.5", "own"): ours(),
    ("smartplay-tools", "ContextManager, slack 0", "own"): ours(slack=0),
    ("smartplay-tools", "ContextManager, slack 0, new each time", "own"): ours(slack=0, keeps=False),
}
"""The library's rows, by package, name and what counts."""


def given_history(seed: str, kind: str, cap: int, number: int) -> Messages:
    """A history of the audit."""
    return history(random.Random(f"{seed} {kind} {cap} {number}"), kind, cap)


def judged(trim: Trimmer, given: Messages, cap: int) -> dict[str, Any]:
    """What a trimmer does with a history: the verdict, or the error that it raises, and how long it takes.

    The judge has counted the texts before. What takes less than `QUICK` is done twice, and the second time counts, so
    that a manager has seen the conversation before, too.
    """
    taken = 0.0
    for _ in range(2):
        if taken < QUICK:
            mine = copy.deepcopy(given)
            begin = time.perf_counter()
            try:
                shown = trim(mine, cap)
            except Exception as error:
                return {"refused": type(error).__name__}
            taken = time.perf_counter() - begin
    return {"refused": "", "ms": round(1_000 * taken, 2)} | verdict(given, shown, cap)


def check_forms(trimmers: dict[tuple[str, str, str], Trimmer]) -> None:
    """Raise a ValueError if a trimmer's form changes a history that fits, because then its row would be our fault."""
    for kind in KINDS:
        given = history(random.Random(kind), kind, 1_000)
        for name, trim in trimmers.items():
            if plain(trim(copy.deepcopy(given), 10**7)) != plain(given):
                raise ValueError(f"{name} does not return a history of the kind {kind} that fits.")


def play() -> Iterator[Row]:
    """Yield a row about the packages, then one for every trimmer and history."""
    from cap_audit_trimmers import TRIMMERS

    trimmers = OURS | TRIMMERS
    check_forms(trimmers)
    pinned = (HERE / "cap-audit" / "requirements.txt").read_text(encoding="utf-8").split()
    packages = {name: version(name) for name in ("smartplay-tools", *(each.partition("==")[0] for each in pinned))}
    yield {"packages": packages, "python": platform.python_version(), "date": f"{datetime.now(UTC):%Y-%m-%d}"}
    for seed, kind, cap, number in itertools.product(SEEDS, KINDS, CAPS, range(EACH)):
        given = given_history(seed, kind, cap, number)
        place = {"seed": seed, "kind": kind, "cap": cap, "number": number}
        for (package, name, counter), trim in trimmers.items():
            yield place | {"package": package, "trimmer": name, "counter": counter} | judged(trim, given, cap)


FAULTS = ("over", "texts", "broken", "empty", "task", "newest")
SHOWN = FAULTS[:-1]


def line(rows: Sequence[Row], versions: dict[str, str]) -> list[str]:
    """The line of a trimmer in the table."""
    sent = [row for row in rows if not row["refused"]]
    under = [row for row in sent if not row["over"]]

    def share(number: int) -> str:
        return f"{100 * number / len(rows):.0f}" if number in (0, len(rows)) else f"{100 * number / len(rows):.1f}"

    good = sum(not any(row[fault] for fault in FAULTS) for row in sent)
    first = rows[0]
    return [
        f"{first['package']}=={versions[first['package']]} {first['trimmer']}",
        first["counter"],
        *(share(sum(row[fault] for row in sent)) for fault in SHOWN),
        share(len(rows) - len(sent)),
        share(good),
        f"{100 * fmean(1 - row['used'] / row['cap'] for row in under):.0f}" if under else "",
        f"{median(row['ms'] for row in sent):.1f}" if sent else "",
    ]


def by_trimmer(rows: Sequence[Row], seed: str) -> list[list[Row]]:
    """The rows of a seed, for each trimmer."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if row.get("seed") == seed:
            found.setdefault((row["package"], row["trimmer"], row["counter"]), []).append(row)
    return list(found.values())


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """The table of the page, from the histories that were made after everything was written."""
    versions = rows[0]["packages"]
    headings = ["trimmer", "counter", "over", "texts over", *SHOWN[2:], "refused", "usable", "unused", "ms"]
    lines = [line(own, versions) for own in by_trimmer(rows, SEEDS[-1])]
    return {"cap-audit": markdown_table(headings, lines)}


EXPERIMENT = Experiment("cap-audit", tables)


def main() -> None:
    """Play, and print or publish."""
    asked = arguments(__doc__).parse_args()
    rows = list(play())
    for seed in SEEDS:
        lines = [line(own, rows[0]["packages"]) for own in by_trimmer(rows, seed)]
        print(seed, *(" | ".join(each) for each in lines), sep="\n", end="\n\n", flush=True)
    if asked.publish:
        write_rows(rows, EXPERIMENT.path)
        EXPERIMENT.publish()


if __name__ == "__main__":
    main()
