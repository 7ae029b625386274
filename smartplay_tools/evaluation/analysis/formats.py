"""Tables as plain data, and their output formats: markdown, LaTeX, CSV and HTML.

The same table can be shown in a terminal, in a notebook and in a paper; only the markup differs.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from smartplay_tools.types.arguments import well_formed
from smartplay_tools.visible import as_html, visible

T = TypeVar("T")


@dataclass(frozen=True)
class Column:
    """A column; words are aligned to the left and may wrap, numbers are aligned to the right and never wrap."""

    heading: str
    words: bool = False


@dataclass(frozen=True)
class TextTable:
    """A table whose cells are text; a row of one cell is a heading for the rows below it."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # Every format has the same text, and measures what it shows.
        for name, value in vars(self).items():
            object.__setattr__(self, name, _visible(value))

    def of_run(self, name: str) -> TextTable:
        """Return the table with the name of its run, for those that stand beside tables of others."""
        return replace(self, title=", ".join(filter(None, (name, self.title))))

    def full_rows(self) -> list[tuple[str, ...]]:
        """Return the rows, each with its heading as the first cell, for formats without heading rows."""
        rows, group = [], ""
        for row in self.rows:
            if len(row) == 1:
                group = row[0]
            else:
                rows.append((f"{group}, {row[0].strip()}" if group else row[0], *row[1:]))
        return rows


def _visible(part: Any) -> Any:
    if isinstance(part, Column):
        return replace(part, heading=visible(part.heading))
    return visible(part) if isinstance(part, str) else tuple(map(_visible, part))


def columns(words: str, *others: str | Column) -> tuple[Column, ...]:
    """Return the columns of most tables: one of words, then numbers, which headings alone stand for."""
    return Column(words, words=True), *(each if isinstance(each, Column) else Column(each) for each in others)


def sections(groups: Iterable[tuple[str, Iterable[tuple[str, ...]]]]) -> tuple[tuple[str, ...], ...]:
    """Return the rows of groups, each group below its heading, if it has one."""
    return tuple(row for heading, rows in groups for row in [*([(heading,)] if heading else []), *rows])


ShownColumn = tuple[str | Column, Callable[[T], str]]
"""A column of a table, and what it shows of a thing."""


def figures_table(
    title: str,
    what: str,
    groups: Mapping[str, Sequence[tuple[str, T]]],
    figures: Callable[[Sequence[T]], Sequence[ShownColumn[T]]],
    notes: Iterable[str] = (),
) -> TextTable:
    """Return a table of named things in groups, each below its heading; a group without one has "" for it.

    `what` heads the names. `figures` has the columns; it is called with the things of each group, since what these
    show may decide how numbers are written.
    """

    def lines(heading: str, named: Sequence[tuple[str, T]]) -> Iterator[tuple[str, ...]]:
        shown = figures([thing for _, thing in named])
        for name, thing in named:
            yield f"  {name}" if heading else name, *(show(thing) for _, show in shown)

    rows = sections((heading, lines(heading, named)) for heading, named in groups.items())
    return TextTable(title, columns(what, *(heading for heading, _ in figures([]))), rows, tuple(notes))


def to_markdown(table: TextTable) -> str:
    """Return a table for GitHub, a notebook or this project's documentation."""
    head = [column.heading for column in table.columns]
    rule = ["---" if column.words else "---:" for column in table.columns]
    rows = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in table.full_rows()]
    title = [f"**{table.title}**", ""] if table.title else []
    lines = [*title, *(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))]
    return "\n".join([*lines, *(["", *(f"{note}  " for note in table.notes)] if table.notes else [])]) + "\n"


def to_latex(table: TextTable, number: int = 1) -> str:
    r"""Return a `tabular` in the style of the package booktabs, in a `table` with a caption, a label and notes below.

    `number` counts the tables with this title, whose labels would be the same.
    """
    columns = "".join("l" if column.words else "r" for column in table.columns)
    head = " & ".join(_latex(column.heading) for column in table.columns)
    body = []
    for row in table.rows:
        if len(row) == 1:
            body += ["\\addlinespace", f"\\multicolumn{{{len(table.columns)}}}{{l}}{{{_latex(row[0])}}} \\\\"]
        else:
            body.append(" & ".join(map(_latex_cell, row)) + " \\\\")
    is_path = "/" in table.title.partition(",")[0]
    title = table.title if is_path else table.title[:1].upper() + table.title[1:]
    return "\n".join(
        [
            "% \\usepackage{booktabs}",
            "\\begin{table}",
            "\\centering",
            f"\\caption{{{_latex(title)}.}}",
            f"\\label{{tab:{_label(table.title)}{f'-{number}' if number > 1 else ''}}}",
            f"\\begin{{tabular}}{{{columns}}}",
            "\\toprule",
            f"{head} \\\\",
            "\\midrule",
            *body,
            "\\bottomrule",
            "\\end{tabular}",
            *(f"\\par{{\\footnotesize {_latex(note)}\\par}}" for note in table.notes),
            "\\end{table}",
            "",
        ]
    )


def rows_to_csv(rows: Sequence[Mapping[str, Any]], columns: Iterable[str] = ()) -> str:
    """Return rows as CSV, in full precision; None is an empty field.

    The columns are those of the first row, unless they are given because there may be none. A text that a spreadsheet
    would compute has an apostrophe in front: names come from strangers.
    """
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, list(columns or (rows[0] if rows else ())), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _uncomputed(value) for name, value in row.items()} for row in rows)
    return file.getvalue()


NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


def _uncomputed(value: Any) -> Any:
    """A cell that a spreadsheet shows as it is."""
    if not isinstance(value, str):
        return value
    text = well_formed(value).replace("\r", "\\r")  # `csv` would write it without quotes, and a reader see two lines
    return f"'{text}" if value[:1] in tuple("=+-@\t\r\n") and not NUMBER.fullmatch(text) else text


def to_html(tables: Sequence[TextTable]) -> str:
    """Return tables as markup for notebooks, without scripts and without a style sheet."""
    return "\n".join(map(_html_table, tables))


def _html_table(table: TextTable) -> str:
    head = "".join(f"<th{_side(column)}>{as_html(column.heading)}</th>" for column in table.columns)
    body = []
    for row in table.rows:
        if len(row) == 1:
            body.append(f'<tr><th colspan="{len(table.columns)}" style="text-align: left">{as_html(row[0])}</th></tr>')
        else:
            cells = zip(table.columns, row, strict=True)
            body.append("<tr>" + "".join(f"<td{_side(c)}>{as_html(cell)}</td>" for c, cell in cells) + "</tr>")
    notes = "".join(f"<br><small>{as_html(note)}</small>" for note in table.notes)
    caption = f"<b>{as_html(table.title)}</b>" if table.title else ""
    rows = "".join(body)
    return f"<div>{caption}<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{notes}</div>"


def _side(column: Column) -> str:
    return f' style="text-align: {"left" if column.words else "right"}"'


def _latex_cell(text: str) -> str:
    """A cell that keeps its indentation and its minus sign, and whose leading bracket is not read as an argument."""
    inner = text.lstrip(" ")
    escaped = re.sub(r"(?<![\w-])-(?=\d)", "$-$", _latex(inner))
    return "\\quad " * ((len(text) - len(inner)) // 2) + ("{}" if escaped.startswith("[") else "") + escaped


def _label(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "results"


def _latex(text: str) -> str:
    return "".join(_LATEX.get(letter, letter) for letter in text)


_LATEX = {
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    "\\": "\\textbackslash{}",
    "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}",
    "|": "\\textbar{}",
    "<": "\\textless{}",
    ">": "\\textgreater{}",
    "\N{DAGGER}": "\\textdagger{}",
    "\N{DOUBLE DAGGER}": "\\textdaggerdbl{}",
    "\N{PLUS-MINUS SIGN}": "$\\pm$",
}
