"""The tables of `docs/servers.md`, made of the rules: `python -m tests.dialects.page` writes them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from smartplay_tools.players.server_errors import rows as rows_of_errors
from smartplay_tools.types.groups import grouped
from tests.dialects.rules import DIALECTS, LIMITS, RULES, limits
from tests.dialects.ways import WAYS

PAGE = Path(__file__).parents[2] / "docs" / "servers.md"
KINDS = {"refuses": "refuses", "overlooks": "does not read", "says": "answers with", "streams": "streams"}


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


def rules() -> Iterator[list[str]]:
    """What each server does, or several alike; `rules.toml` has the source of each rule."""
    yield ["server", *KINDS.values()]
    same = grouped(RULES, lambda rule: (rule.kind, rule.rule))
    servers = {rule: tuple(dict.fromkeys(name for each in own for name in each.dialects)) for rule, own in same.items()}
    for names, own in grouped(servers, servers.__getitem__).items():
        texts = grouped(own, lambda rule: rule[0])
        yield [", ".join(names), *("; ".join(text for _, text in texts.get(kind, ())) for kind in KINDS)]


def errors() -> Iterator[list[str]]:
    """Whose the errors of the table are, and at which servers; the table has their words and sources."""
    yield ["whose", "about", "servers"]
    for (whose, about), same in grouped(rows_of_errors(), lambda row: (row.whose, row.about)).items():
        yield [whose, about, ", ".join(dict.fromkeys(row.provider for row in same))]


def renewed(page: str) -> str:
    """The page with its tables as the rules have them."""
    tables = {name: matrix(name) for name in ("chat", "responses", "messages")} | {
        "set": to_set(),
        "errors": errors(),
        "rules": rules(),
    }
    for name, rows in tables.items():
        begin, end = f"<!-- table: {name} -->\n", "<!-- end -->"
        before, rest = page.split(begin)
        page = f"{before}{begin}{table(rows)}\n{rest[rest.index(end) :]}"
    return page


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
