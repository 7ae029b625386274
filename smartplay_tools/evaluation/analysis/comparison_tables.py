"""A comparison as a table: for each game the reference, and below it the sides that are compared with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from smartplay_tools.evaluation.analysis.comparison import Comparison, Overall, Pairing, Side
from smartplay_tools.evaluation.analysis.decisions import Verdict
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, columns, sections
from smartplay_tools.evaluation.analysis.names import apart, check_distinct
from smartplay_tools.evaluation.analysis.numbers import (
    IDENTICAL,
    NOTHING,
    decimals_of,
    fixed,
    interval_notes,
    with_interval,
)
from smartplay_tools.statistics.intervals import MeanEstimate
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


def comparison_tables(comparison: Comparison) -> list[TextTable]:
    """Return the table with a section for each game and, if there are several games, the table over all games."""
    names = side_names(comparison)
    games = dict.fromkeys(each.game for each in comparison.pairings)
    rows = sections((game, _game_rows(comparison, game, names)) for game in games)
    judged = comparison.is_judged
    last = Column("verdict", words=True) if judged else Column("tokens")
    headings = (*columns("", "pairs", "score", "+-", "W/T/L"), last)
    notes = (NOTES[0], *VERDICT_NOTES) if judged else NOTES
    tables = [TextTable("compared", headings, rows, (*notes, *_notes(comparison)))]
    if len(games) > 1:
        tables.append(_overall_table(comparison, names))
    return tables


def _game_rows(comparison: Comparison, game: str, names: Mapping[Side, str]) -> Iterator[tuple[str, ...]]:
    pairings = [each for each in comparison.pairings if each.game == game]
    references = [(side, means) for named, side, means in comparison.references if named == game]
    points = decimals_of([*(each.means["score"] for each in pairings), *(means["score"] for _, means in references)])
    for side, means in references:
        last = "" if comparison.is_judged else _tokens(means)
        yield f"  {names[side]}", NOTHING, fixed(means["score"].mean, points), "reference", "", last
        for each in pairings:
            if each.reference == side:
                told = _verdict(each.verdict) if comparison.is_judged else _tokens(each.means)
                yield _pairing_row(each, names[each.side], points, told)


def _pairing_row(each: Pairing, name: str, points: int, last: str) -> tuple[str, ...]:
    difference = "identical" if each.is_identical else with_interval(each.differences.get("score"), points, sign="+")
    outcome, mean = f"{each.wins}/{each.ties}/{each.losses}", fixed(each.means["score"].mean, points)
    return f"    {name}", f"{each.pairs}", mean, difference, outcome, last


def _verdict(verdict: Verdict | None) -> str:
    if verdict is None:
        return NOTHING
    if verdict.word == "undecided":
        return "undecided" + ("" if verdict.mde is None else f", MDE {verdict.mde:.2g}")
    return verdict.word + (f" than {verdict.margin:g}" if verdict.word == "different, but less" else "")


def _tokens(means: Mapping[str, MeanEstimate]) -> str:
    return short(means["tokens"].mean)


def _overall_table(comparison: Comparison, names: Mapping[Side, str]) -> TextTable:
    rows = [_overall_row(each, names) for each in comparison.overall]
    headings = columns("", "games", "% human, +-", "W/T/L")
    note = "% human, +-: difference of normalised scores, the mean over the games that have one"
    return TextTable("over all games", headings, tuple(rows), (note,))


def _overall_row(each: Overall, names: Mapping[Side, str]) -> tuple[str, ...]:
    difference = with_interval(each.difference, 1, factor=100, sign="+")
    outcome = f"{each.wins}/{each.ties}/{each.losses}"
    return f"{names[each.side]} against {names[each.reference]}", f"{len(each.games)}", difference, outcome


def side_names(comparison: Comparison) -> dict[Side, str]:
    """Return the names of sides: a letter for the run, the player, and its condition if that differs."""
    letters = {run: f"{_letter(at)} " if len(comparison.runs) > 1 else "" for at, run in enumerate(comparison.runs)}
    sides = dict.fromkeys([*(side for _, side, _ in comparison.references), *(p.side for p in comparison.pairings)])
    differing, _ = apart([side.label for side in sides])
    named = zip(sides, differing, strict=True)
    names = [letters[side.run] + ", ".join(filter(None, [side.player, own])) for side, own in named]
    check_distinct(names)
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
