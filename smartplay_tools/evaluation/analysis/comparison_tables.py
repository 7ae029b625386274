"""A comparison as a table: for each game the reference, and below it the sides that are compared with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from smartplay_tools.evaluation.analysis.comparison import Comparison, Overall, Pairing, Side
from smartplay_tools.evaluation.analysis.formats import Column, TextTable
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate
from smartplay_tools.evaluation.analysis.numbers import NOTHING, decimals_of, fixed, with_interval
from smartplay_tools.quantities import short

NOTES = (
    "+-: to the reference, paired by game, seed and trial, with its 95 % bootstrap interval (BCa)",
    "W/T/L: pairs won, tied and lost by score; tokens: of an episode, prompts and replies",
)


def comparison_tables(comparison: Comparison) -> list[TextTable]:
    """Return the table with a section for each game and, if there are several games, the table over all games."""
    names = _names(comparison)
    rows: list[tuple[str, ...]] = []
    for game in dict.fromkeys(each.game for each in comparison.pairings):
        rows += [(game,), *_game_rows(comparison, game, names)]
    columns = (Column("", words=True), *map(Column, ("pairs", "score", "+-", "W/T/L", "tokens")))
    tables = [TextTable("compared", columns, tuple(rows), (*NOTES, *_notes(comparison)))]
    if len({each.game for each in comparison.pairings}) > 1:
        tables.append(_overall_table(comparison, names))
    return tables


def _game_rows(comparison: Comparison, game: str, names: Mapping[Side, str]) -> Iterator[tuple[str, ...]]:
    pairings = [each for each in comparison.pairings if each.game == game]
    references = [(side, means) for named, side, means in comparison.references if named == game]
    points = decimals_of([*(each.means["score"] for each in pairings), *(means["score"] for _, means in references)])
    for side, means in references:
        yield f"  {names[side]}", NOTHING, fixed(means["score"].mean, points), "reference", "", _tokens(means)
        for each in pairings:
            if each.reference == side:
                yield _pairing_row(each, names[each.side], points)


def _pairing_row(each: Pairing, name: str, points: int) -> tuple[str, ...]:
    difference = with_interval(each.differences.get("score"), points, sign="+")
    outcome = f"{each.wins}/{each.ties}/{each.losses}"
    return (
        f"    {name}",
        f"{each.pairs}",
        fixed(each.means["score"].mean, points),
        difference,
        outcome,
        _tokens(each.means),
    )


def _tokens(means: Mapping[str, MeanEstimate]) -> str:
    return short(means["tokens"].mean)


def _overall_table(comparison: Comparison, names: Mapping[Side, str]) -> TextTable:
    rows = [_overall_row(each, names) for each in comparison.overall]
    columns = (Column("", words=True), *map(Column, ("games", "% human, +-", "W/T/L")))
    note = "% human, +-: difference of normalised scores, the mean over the games that have one"
    return TextTable("over all games", columns, tuple(rows), (note,))


def _overall_row(each: Overall, names: Mapping[Side, str]) -> tuple[str, ...]:
    difference = with_interval(each.difference, 1, factor=100, sign="+")
    outcome = f"{each.wins}/{each.ties}/{each.losses}"
    return f"{names[each.side]} against {names[each.reference]}", f"{len(each.games)}", difference, outcome


def _names(comparison: Comparison) -> dict[Side, str]:
    """The names of sides: a letter for the run, the player, and its condition if that differs."""
    letters = {run: f"{_letter(at)} " if len(comparison.runs) > 1 else "" for at, run in enumerate(comparison.runs)}
    sides = dict.fromkeys([*(side for _, side, _ in comparison.references), *(p.side for p in comparison.pairings)])
    given = {side.label for side in sides}
    return {
        side: letters[side.run] + ", ".join(filter(None, (side.player, side.label if len(given) > 1 else "")))
        for side in sides
    }


def _notes(comparison: Comparison) -> Iterator[str]:
    given = {each.side.label for each in comparison.pairings} | {side.label for _, side, _ in comparison.references}
    if len(given) == 1 and (shared := given.pop()):
        yield f"everywhere: {shared}"
    if len(comparison.runs) > 1:
        yield from (f"{_letter(at)}: {run}" for at, run in enumerate(comparison.runs))
    if unpaired := sum(each.unpaired for each in comparison.pairings):
        yield f"{unpaired} episodes have no counterpart of the same seed and trial, and are in no difference"
    for name, versions in comparison.versions.items():
        yield f"{name} differs: {', '.join(f'{version} in {run}' for run, version in versions.items())}"


def _letter(at: int) -> str:
    return chr(ord("A") + at) if at < 26 else f"#{at + 1}"
