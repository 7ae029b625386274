"""The tables of `docs/servers.md`, made of the rules: `python -m tests.dialects.page` writes them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from smartplay_tools.players.server_errors import rows as rows_of_errors, server_error
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
    ways = [way.name for way in WAYS.values() if way.interface == interface]
    yield ["server", *ways]
    for dialect in DIALECTS.values():
        if dialect.interface == interface:
            yield [dialect.name, *(_cell([LIMITS.index(limit) for limit in limits(way, dialect)]) for way in ways)]


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
    """Each rule with its source."""
    yield ["server", "", "what", "source"]
    for rule in RULES:
        sources = ", ".join(map(_link, rule.source.split(", ")))
        yield [", ".join(rule.dialects), KINDS[rule.kind], rule.rule, sources]


def errors() -> Iterator[list[str]]:
    """Each error of the table, by whose it is, with the beginning of what the server says."""
    yield ["whose", "about", "server", "what it says", "source"]
    for row in rows_of_errors():
        status, _, body = row.says.partition(" ")
        said = " ".join(server_error({"error": json.loads(body)}).words) or body
        words = "; ".join([*([status] if status != "200" else []), *row.code, said])
        sources = ", ".join(map(_link, row.source.split(", ")))
        yield [row.whose, row.about, row.provider, f"`{words.replace('|', '/').replace('`', '')[:90]}`", sources]


def _link(source: str) -> str:
    """A source as a link, where it is a thread; threads of GitHub are numbered alike."""
    thread = re.fullmatch(r"([\w.-]+/[\w.-]+)#(\d+)", source)
    return f"[{source}](https://github.com/{thread[1]}/issues/{thread[2]})" if thread else source


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
