"""A comparison as a table: for each game the reference, and below it the sides that are compared with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from smartplay_tools.evaluation.analysis.beside import (
    EARLY,
    POINTS,
    WAY,
    Beside,
    column_notes,
    early_notes,
    shows_points,
    shows_steps,
)
from smartplay_tools.evaluation.analysis.comparison import Comparison, Pairing, Side
from smartplay_tools.evaluation.analysis.formats import Column, ShownColumn, TextTable, figures_table
from smartplay_tools.evaluation.analysis.names import apart
from smartplay_tools.evaluation.analysis.numbers import (
    IDENTICAL,
    NOTHING,
    decimals_of,
    fixed,
    interval_notes,
    with_interval,
)
from smartplay_tools.statistics.intervals import MeanEstimate
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import short

NOTES = (
    "+-: to the reference, paired by game, seed and trial, with its 95 % interval",
    "W/T/L: pairs won, tied and lost by score; tokens: of an episode, prompts and replies",
)

VERDICT_NOTES = (
    "W/T/L: pairs won, tied and lost by score",
    "different: the interval excludes 0, or p < 0.05",
    "equivalent: the 90 % interval is within the margin; undecided: neither",
    "MDE: the smallest difference that as many pairs show in four of five such comparisons",
)


@dataclass(frozen=True)
class _Line:
    """A side in a game: a reference, or one that is compared with the reference above it."""

    game: str
    side: Side
    means: Mapping[str, MeanEstimate]
    ends: Mapping[str, int]
    pairing: Pairing | None = None

    @property
    def beside(self) -> Beside:
        """What decides about the columns."""
        return Beside.of(self.game, self.means, self.ends)


def _lines(comparison: Comparison) -> Iterator[_Line]:
    for game, reference, means in comparison.references:
        compared = [each for each in comparison.pairings if (each.game, each.reference) == (game, reference)]
        yield _Line(game, reference, means, compared[0].reference_ends)
        yield from (_Line(game, each.side, each.means, each.ends, each) for each in compared)


def comparison_tables(comparison: Comparison) -> list[TextTable]:
    """Return the table with a section for each game and, where points are not what scores count, that of points."""
    names, lines, judged = side_names(comparison), list(_lines(comparison)), comparison.is_judged
    games = {game: [(_name(line, names), line) for line in own] for game, own in grouped(lines, _game).items()}
    beside = {(line.game, line.side): line.beside for line in lines}
    has_steps, has_best = shows_steps(beside.values()), any("way_to_best" in line.means for line in lines)

    def scores(own: Sequence[_Line]) -> Sequence[ShownColumn[_Line]]:
        points = decimals_of(line.means["score"] for line in own)
        return (
            ("pairs", lambda line: f"{line.pairing.pairs}" if line.pairing else NOTHING),
            *([("steps", lambda line: f"{line.beside.steps:,.1f}")] if has_steps else []),
            ("score", lambda line: fixed(line.means["score"].mean, points)),
            *([("to best", lambda line: with_interval(line.means.get("way_to_best"), 2))] if has_best else []),
            ("+-", lambda line: _difference(line.pairing, "score", points)),
            ("W/T/L", lambda line: _outcome(line.pairing) if line.pairing else ""),
            (Column("verdict", words=True), _verdict) if judged else ("tokens", _tokens),
        )

    early = early_notes(beside.values())
    notes = [*((NOTES[0], *VERDICT_NOTES) if judged else NOTES), *column_notes([*beside.values()], points=False)]
    notes += [*([WAY] if has_best else []), *_notes(comparison), *early]
    tables = [figures_table(_title("scores", comparison, names), "", games, scores, notes)]
    if shows_points(beside.values()):
        notes = [NOTES[0], POINTS, *early]
        tables.append(figures_table(_title("points", comparison, names), "", games, lambda _: PAID, notes))
    return tables


def _game(line: _Line) -> str:
    return line.game


def _name(line: _Line, names: Mapping[Side, str]) -> str:
    return ("  " if line.pairing else "") + names[line.side] + EARLY * bool(line.ends)


def _difference(pairing: Pairing | None, measure: str, decimals: int) -> str:
    if pairing is None:
        return "reference"
    if measure == "score" and pairing.is_identical:
        return "identical"
    return with_interval(pairing.differences.get(measure), decimals, sign="+")


PAID: Sequence[ShownColumn[_Line]] = (
    ("points", lambda line: fixed(line.means["reward"].mean, 2, "+")),
    ("+-", lambda line: _difference(line.pairing, "reward", 2)),
)
"""The points of a side, and their difference, where points are not what scores count."""


def _title(measure: str, comparison: Comparison, names: Mapping[Side, str]) -> str:
    """What is compared with what, as a caption: the reference by its name, if there is one alone."""
    references = {names[side] for _, side, _ in comparison.references}
    return f"compared: {measure} less those of {references.pop() if len(references) == 1 else 'their references'}"


def _outcome(each: Pairing) -> str:
    return f"{each.wins}/{each.ties}/{each.losses}"


def _verdict(line: _Line) -> str:
    if line.pairing is None:
        return ""
    if (verdict := line.pairing.verdict) is None:
        return NOTHING
    if verdict.word == "undecided":
        return "undecided" + ("" if verdict.mde is None else f", MDE {verdict.mde:.2g}")
    return verdict.word + (f" than {verdict.margin:g}" if verdict.word == "different, but less" else "")


def _tokens(line: _Line) -> str:
    return short(line.means["tokens"].mean)


def side_names(comparison: Comparison) -> dict[Side, str]:
    """Return the names of sides: a letter for the run, the player, and its condition if that differs."""
    letters = {run: f"{_letter(at)} " if len(comparison.runs) > 1 else "" for at, run in enumerate(comparison.runs)}
    sides = dict.fromkeys([*(side for _, side, _ in comparison.references), *(p.side for p in comparison.pairings)])
    differing, _ = apart([side.label for side in sides])
    named = zip(sides, differing, strict=True)
    names = [letters[side.run] + ", ".join(filter(None, [side.player, own])) for side, own in named]
    return dict(zip(sides, names, strict=True))


def _notes(comparison: Comparison) -> Iterator[str]:
    sides = [*(each.side for each in comparison.pairings), *(side for _, side, _ in comparison.references)]
    if shared := apart([side.label for side in sides])[1]:
        yield f"everywhere: {shared}"
    if len(comparison.runs) > 1:
        yield from (f"{_letter(at)}: {run}" for at, run in enumerate(comparison.runs))
    yield from interval_notes(each.differences.get("score") for each in comparison.pairings)
    if any(each.is_identical for each in comparison.pairings):
        yield IDENTICAL
    if unpaired := sum(each.unpaired for each in comparison.pairings):
        yield f"{unpaired} episodes have no counterpart of the same seed and trial, and are in no difference"
    if comparison.uncompared:
        yield f"{comparison.uncompared} episodes are of a game or a side that has nothing to be compared with here"
    for name, versions in comparison.versions.items():
        yield f"{name} differs: {', '.join(f'{version} in {run}' for run, version in versions.items())}"


def _letter(at: int) -> str:
    return chr(ord("A") + at) if at < 26 else f"#{at + 1}"
