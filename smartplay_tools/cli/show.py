"""The output of an episode: its turns as they happen, and its result."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.cells import cell_len
from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from smartplay_tools.streams import own_output
from smartplay_tools.terminal import Console, Text
from smartplay_tools.types.messages import calls_of, text_of

if TYPE_CHECKING:
    from smartplay_tools.conversation.base import BaseConversation
    from smartplay_tools.evaluation.analysis.formats import TextTable
    from smartplay_tools.types import EpisodeResult

FAILED = ("player_error", "game_error", "strategy_error")
"""How episodes end that have failed."""

MISTAKES = ("illegal_actions", "malformed_calls", "refused_calls", "idle_replies", "cut_results")
"""The counts of a result that are shown as mistakes."""

NARROWEST = 10
"""The least width of columns of words."""


def print_json(data: Any) -> None:
    """Print data for a program."""
    print(json.dumps(data, indent=2), file=own_output())


def print_turn(console: Console, conversation: BaseConversation) -> None:
    """Print the latest turn: the prompt's tokens and cap, dropped turns, calls and their results."""
    turn, view = conversation.latest_turn, conversation.view
    assert turn is not None
    assert view is not None
    cap = conversation.episode.budget.prompt_tokens
    limit = "" if cap is None else f"/{cap}"
    dropped = f", {view.dropped_turns} turns dropped" if view.dropped_turns else ""
    marked = f", {len(view.masked_results)} results marked" if view.masked_results else ""
    facts = f"prompt {view.tokens}{limit} tokens, {view.shown_steps} steps shown{dropped}{marked}"
    console.print(f"[bold]turn {turn.number}[/]  step {conversation.episode.stats.steps}  [dim]{facts}[/]", markup=True)
    if words := text_of(turn.assistant):
        console.print(f"  [italic]{escape(words)}[/]", markup=True)
    for call in calls_of(turn.assistant):
        function = call["function"]
        called = f"  [cyan]{escape(function['name'])}[/] {escape(function['arguments'])}"
        console.print(called, soft_wrap=True, markup=True)
    for item in turn.items:
        bar = "|" if console.options.ascii_only else "│"
        for line in text_of(item.message).splitlines():
            console.print(f"  [dim]{bar}[/] {escape(line)}", highlight=False, soft_wrap=True, markup=True)


def print_result(console: Console, result: EpisodeResult, cost: float | None, question_cost: float | None) -> None:
    """Print a result as a small table; costs are in US dollars, None if they are not known."""
    # A command that prints no result imports no statistics.
    from smartplay_tools.evaluation.analysis.remembering import work_in_words

    normalized = "" if result.normalized_score is None else f" ({result.normalized_score:.0%} of the human score)"
    counts = {name.replace("_", " "): getattr(result, name) for name in MISTAKES}
    mistakes = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    tokens = result.tokens
    stable = f"{tokens.prefix / tokens.prompt:.0%}" if tokens.prompt else "none"
    table = Table(show_header=False, title=result.game, title_justify="left")
    # The score at the moment of a player's failure is not a score of the game.
    failed = result.end_reason in FAILED and result.end_reason != "strategy_error"
    table.add_row("score", "none: the episode failed" if failed else f"{result.score:g}{normalized}")
    table.add_row("end", result.end_reason + (f": {result.error}" if result.error else ""))
    table.add_row("steps", f"{result.steps} in {result.turns} turns")
    table.add_row("tokens", f"{tokens.prompt:,} in prompts ({stable} prefix-stable), {tokens.reply:,} in replies")
    if cost:
        table.add_row("cost", f"${cost:.4f}")
    also = {"budget": {"strategy": "strategy" in result.deviations}, "question_cost": question_cost}
    if did := work_in_words(result.model_dump() | also):
        table.add_row("compactor", did)
    table.add_row("mistakes", mistakes or "none")
    for at, (name, values) in enumerate(result.deviations.items()):
        deviation = f"{name} {_value(values['played'])} (paper: {_value(values['paper'])})"
        table.add_row("" if at else "not as in the paper", deviation)
    console.print(table)


def _value(value: Any) -> str:
    return "no limit" if value is None else str(value)


def table_console() -> Console:
    """Return a console for tables: as wide as the terminal; in a file or a pipe as COLUMNS says, or 80 columns."""
    console, columns = Console(), os.environ.get("COLUMNS", "")
    return console if console.is_terminal else Console(width=max(20, int(columns)) if columns.isdecimal() else 80)


def compact_table(*headings: str, folded: int = 0) -> Table:
    """Return a table that fits a terminal of 80 columns: no frame, the first column to the left, numbers right.

    The first `folded` columns are broken where they are too wide.
    """
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="bold")
    for at, heading in enumerate(headings):
        table.add_column(heading, justify="left" if heading == headings[0] else "right", no_wrap=at >= folded)
        table.columns[at].overflow = "fold" if at < folded else "ellipsis"
    return table


def print_table(console: Console, table: TextTable) -> None:
    """Print a table with its title and notes. Numbers are never cut or broken; if space is short, words wrap."""
    if table.title:
        console.print(Text(table.title, style="bold cyan"), soft_wrap=True)
    widths = _widths(table, console.width)
    for at, rows in enumerate(_groups(table.rows)):
        if len(rows[0]) == 1:
            heading, rows = rows[0][0], rows[1:]
            lines = [_grid(table, widths, [])] if at == 0 else []
            console.print(*lines, Text(heading, style="bold"), sep="\n", end="\n")
            if rows:
                console.print(_grid(table, widths, rows, header=False))
        else:
            console.print(_grid(table, widths, rows))
    for note in table.notes:
        console.print(Text(note, style="dim"))
    console.print()


def _groups(rows: Sequence[tuple[str, ...]]) -> list[list[tuple[str, ...]]]:
    """The rows below each heading row, that row first."""
    groups: list[list[tuple[str, ...]]] = [] if rows and len(rows[0]) == 1 else [[]]
    for row in rows:
        if len(row) == 1:
            groups.append([])
        groups[-1].append(row)
    return [group for group in groups if group]


def _widths(table: TextTable, width: int) -> list[int]:
    """The widths of the columns: those of their contents or, if these are too wide, less.

    Headings wrap first, then words, then numbers with an interval, which goes to a separate line.
    """
    rows = [row for row in table.rows if len(row) > 1]
    cells = [[row[at] for row in rows] for at in range(len(table.columns))]
    body = [max(map(cell_len, column), default=0) for column in cells]
    parts = [max((cell_len(part) for cell in column for part in cell.split(" [")), default=0) + 1 for column in cells]
    widths = [max(own, cell_len(column.heading)) for own, column in zip(body, table.columns, strict=True)]
    headings = [max(map(cell_len, column.heading.split()), default=0) for column in table.columns]
    words = [column.words for column in table.columns]
    for shrinks, least in (
        ([not word for word in words], list(map(max, body, headings))),
        (words, [NARROWEST] * len(words)),
        ([not word for word in words], [max(min(parts[at], body[at]), headings[at]) for at in range(len(words))]),
    ):
        shrinking = [at for at, shrinks_here in enumerate(shrinks) if shrinks_here]
        while sum(widths) + len(widths) - 1 > width:
            widest = max(shrinking, key=lambda at: widths[at] - least[at], default=None)
            if widest is None or widths[widest] <= least[widest]:
                break
            widths[widest] -= 1
    return widths


def _grid(table: TextTable, widths: Sequence[int], rows: Sequence[tuple[str, ...]], *, header: bool = True) -> Table:
    grid = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, header_style="dim", show_header=header)
    for column, width in zip(table.columns, widths, strict=True):
        grid.add_column(
            Text(column.heading),
            width=width,
            justify="left" if column.words else "right",
            overflow="fold",
            no_wrap=False,
        )
    for row in rows:
        grid.add_row(*(_cell(cell) for cell in row))
    return grid


def _cell(text: str) -> RenderableType:
    indent = len(text) - len(text.lstrip())
    # Wrapped lines keep the indentation of the first.
    return Padding(Text(text[indent:]), (0, 0, 0, indent)) if indent else Text(text)
