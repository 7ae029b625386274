"""Tables of `docs`, made of the providers' files and the rules: `python -m tests.dialects.page` writes them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from operator import itemgetter
from pathlib import Path
from typing import Any

from smartplay_tools.players.server_errors import rows as rows_of_errors
from smartplay_tools.providers.tables import each, rows as rows_of
from smartplay_tools.types.groups import grouped
from tests.dialects.rules import DIALECTS, LIMITS, RULES, limits
from tests.dialects.ways import WAYS

PAGES = [Path(__file__).parents[2] / "docs" / name for name in ("openai.md", "servers.md")]


def table(rows: Iterable[Iterable[str]]) -> str:
    """Rows as a table in Markdown, the first as its head."""
    head, *others = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([head, re.sub(r"[^|]+", "---", head), *others])


def matrix(interface: str) -> Iterator[list[str]]:
    """Servers of an interface by the ways in: yes, or the number of what has to be set, or no."""
    servers = [dialect for dialect in DIALECTS.values() if dialect.interface == interface]
    columns = {
        way.name: tuple(_cell([LIMITS.index(limit) for limit in limits(way.name, server)]) for server in servers)
        for way in WAYS.values()
        if way.interface == interface
    }
    ways = grouped(columns, columns.__getitem__)  # those that do the same everywhere share a column, and servers a row
    rows = dict(zip((server.name for server in servers), zip(*ways, strict=True), strict=True))
    yield ["server", *map(", ".join, ways.values())]
    for cells, names in grouped(rows, rows.__getitem__).items():
        yield [", ".join(names), *cells]


def _cell(numbers: list[int]) -> str:
    marked = ", ".join(str(number + 1) for number in numbers)
    return (
        "yes" if not numbers else f"{'no' if any('play' in LIMITS[at].without for at in numbers) else 'yes'}: {marked}"
    )


def to_set() -> Iterator[list[str]]:
    """What frameworks do not do at which servers, and what a user sets."""
    yield ["", "way in", "what it does", "what to set"]
    for number, limit in enumerate(LIMITS, 1):
        yield [str(number), ", ".join(limit.ways), limit.limit, limit.set]


def refusals() -> Iterator[list[str]]:
    """What each server refuses, or several alike; `rules.toml` has the source of each rule."""
    yield ["server", "refuses"]
    same = grouped((rule for rule in RULES if rule.kind == "refuses"), lambda rule: rule.rule)
    servers = {rule: tuple(dict.fromkeys(name for each in own for name in each.dialects)) for rule, own in same.items()}
    for names, own in grouped(servers, servers.__getitem__).items():
        yield [", ".join(names), "; ".join(own)]


def errors() -> Iterator[list[str]]:
    """Whose the errors of the table are, and at which servers; the table has their words and sources."""
    yield ["whose", "about", "servers"]
    for (whose, about), same in grouped(rows_of_errors(), lambda row: (row.whose, row.about)).items():
        yield [whose, about, ", ".join(dict.fromkeys(row.provider for row in same))]


def fields() -> Iterator[list[str]]:
    """Each field of a reply, those that an interface defines first, with who sends it."""
    yield [
        "interface",
        "field or type",
        "what it is, or who sends it",
        "counted",
        "goes back",
        "pieces of a stream",
        "empty",
    ]
    senders: dict[Any, list[str]] = {}
    for provider, row in rows_of("field"):
        same = tuple(row[key] for key in ("interface", "name", "pieces", "empty"))
        has = tuple("yes" if row.get(key, True) else "no" for key in ("counted", "sent"))
        senders.setdefault((*same, has, row.get("holds")), []).append(provider)
    order = ("chat", "Responses", "Messages")
    for same in sorted(senders, key=lambda same: (order.index(same[0]), same[1] == "any other", same[5] is None)):
        interface, name, pieces, empty, has, holds = same
        shown = name if name == "any other" else f"`{name}`"
        yield [interface, shown, ", ".join(senders[same]) if holds is None else holds, *has, pieces, empty]


def names() -> Iterator[list[str]]:
    """What providers call what a request or an answer has."""
    yield ["what", "names (servers)"]
    listed = {"cap on a reply": each("cap"), "why a reply ended": each("end_fields")}
    listed |= {f"tokens: {kind}": each("usage", kind) for kind in ("cached", "written", "written_1h", "reasoning")}
    for kind in ("cut", "refused", "paused", "broken_calls"):
        listed[f"end: {kind}"] = [(who, row["reasons"]) for who, row in rows_of("end") if row["count"] == kind]
    listed["a request does without"] = ((who, row["name"]) for who, row in rows_of("optional"))
    listed["goes back"] = ((who, f"{row['most']:,} {row['what']}") for who, row in rows_of("limit"))
    for what, said in listed.items():
        calls = ((who, [called] if isinstance(called, str) else called) for who, called in said)
        same = grouped(((who, ", ".join(f"`{name}`" for name in called)) for who, called in calls), itemgetter(1))
        yield [what, "; ".join(f"{names} ({', '.join(who for who, _ in own)})" for names, own in same.items())]


def renewed(page: str) -> str:
    """The page with its tables as the rules have them."""
    tables = {name: matrix(name) for name in ("chat", "responses", "messages")} | {
        "set": to_set(),
        "errors": errors(),
        "refusals": refusals(),
        "fields": fields(),
        "names": names(),
    }
    for name, rows in tables.items():
        if f"<!-- table: {name} -->" not in page:
            continue
        begin, end = f"<!-- table: {name} -->\n", "<!-- end -->"
        before, rest = page.split(begin)
        page = f"{before}{begin}{table(rows)}\n{rest[rest.index(end) :]}"
    return page


if __name__ == "__main__":
    for each_page in PAGES:
        each_page.write_text(renewed(each_page.read_text(encoding="utf-8")), encoding="utf-8")
