"""A comparison as a table: for each game the reference, and below it the sides that are compared with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

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
from smartplay_tools.evaluation.analysis.comparison import Comparison, Overall, Side
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


def comparison_tables(comparison: Comparison) -> list[TextTable]:
    """Return the table with a section for each game and, if there are several games, the table over all games."""
    names = side_names(comparison)
    games = dict.fromkeys(each.game for each in comparison.pairings)
    rows = sections((game, _game_rows(comparison, game, names)) for game in games)
    judged = comparison.is_judged
    last = Column("verdict", words=True) if judged else Column("tokens")
    beside = list(_beside(comparison).values())
    way = ["to best"] if _has_best(comparison) else []
    headings = (*columns("", "pairs", *(["steps"] if shows_steps(beside) else []), "score", *way, "+-", "W/T/L"), last)
    notes = [*((NOTES[0], *VERDICT_NOTES) if judged else NOTES), *column_notes(beside, points=False)]
    notes += [WAY] if way else []
    notes += [*_notes(comparison), *early_notes(beside)]
    tables = [TextTable(_title("scores", comparison, names), headings, rows, tuple(notes))]
    if shows_points(beside):
        tables.append(_points_table(comparison, names))
    if len(games) > 1:
        tables.append(_overall_table(comparison, names))
    return tables


def _points_table(comparison: Comparison, names: Mapping[Side, str]) -> TextTable:
    """The points of every side, and their differences, where points are not what scores count."""
    beside = _beside(comparison)
    games = grouped(comparison.pairings, lambda each: each.game)
    rows: list[tuple[str, ...]] = []
    for game, members in games.items():
        rows.append((game,))
        for reference, pairings in grouped(members, lambda each: each.reference).items():
            paid = fixed(beside[game, reference].points, 2, "+")
            rows.append((f"  {_named(game, reference, names, beside)}", paid, "reference"))
            for each in pairings:
                paid = fixed(each.means["reward"].mean, 2, "+")
                less = with_interval(each.differences.get("reward"), 2, sign="+")
                rows.append((f"    {_named(game, each.side, names, beside)}", paid, less))
    notes = (NOTES[0], POINTS, *early_notes(beside.values()))
    return TextTable(_title("points", comparison, names), columns("", "points", "+-"), tuple(rows), notes)


def _named(game: str, side: Side, names: Mapping[Side, str], beside: Mapping[tuple[str, Side], Beside]) -> str:
    return names[side] + EARLY * bool(beside[game, side].ends)


def _title(measure: str, comparison: Comparison, names: Mapping[Side, str]) -> str:
    """What is compared with what, as a caption: the reference by its name, if there is one alone."""
    references = {names[side] for _, side, _ in comparison.references}
    return f"compared: {measure} less those of {references.pop() if len(references) == 1 else 'their references'}"


def _beside(comparison: Comparison) -> dict[tuple[str, Side], Beside]:
    """What decides about the columns, of every side in every game."""
    ends = {(each.game, each.reference): each.reference_ends for each in comparison.pairings}
    means = {(game, side): means for game, side, means in comparison.references}
    ends |= {(each.game, each.side): each.ends for each in comparison.pairings}
    means |= {(each.game, each.side): each.means for each in comparison.pairings}
    return {key: Beside.of(key[0], means[key], ends[key]) for key in means}


def _game_rows(comparison: Comparison, game: str, names: Mapping[Side, str]) -> Iterator[tuple[str, ...]]:
    pairings = [each for each in comparison.pairings if each.game == game]
    references = [(side, means) for named, side, means in comparison.references if named == game]
    points = decimals_of([*(each.means["score"] for each in pairings), *(means["score"] for _, means in references)])
    beside = _beside(comparison)
    has_steps = shows_steps(list(beside.values()))

    has_best = _has_best(comparison)

    def line(side: Side, pairs: str, means: Mapping[str, MeanEstimate], *others: str) -> tuple[str, ...]:
        steps = (f"{beside[game, side].steps:,.1f}",) if has_steps else ()
        way = (with_interval(means.get("way_to_best"), 2),) if has_best else ()
        return (
            f"  {_named(game, side, names, beside)}",
            pairs,
            *steps,
            fixed(means["score"].mean, points),
            *way,
            *others,
        )

    for side, means in references:
        last = "" if comparison.is_judged else _tokens(means)
        yield line(side, NOTHING, means, "reference", "", last)
        for each in pairings:
            if each.reference == side:
                told = _verdict(each.verdict) if comparison.is_judged else _tokens(each.means)
                difference = with_interval(each.differences.get("score"), points, sign="+")
                shown = "identical" if each.is_identical else difference, f"{each.wins}/{each.ties}/{each.losses}", told
                name, *own = line(each.side, f"{each.pairs}", each.means, *shown)
                yield f"  {name}", *own


def _has_best(comparison: Comparison) -> bool:
    """Whether a best choice of whole turns is known of any side."""
    means = [*(each.means for each in comparison.pairings), *(means for *_, means in comparison.references)]
    return any("way_to_best" in each for each in means)


def _verdict(verdict: Verdict | None) -> str:
    if verdict is None:
        return NOTHING
    if verdict.word == "undecided":
        return "undecided" + ("" if verdict.mde is None else f", MDE {verdict.mde:.2g}")
    return verdict.word + (f" than {verdict.margin:g}" if verdict.word == "different, but less" else "")


def _tokens(means: Mapping[str, MeanEstimate]) -> str:
    return short(means["tokens"].mean)


def _overall_table(comparison: Comparison, names: Mapping[Side, str]) -> TextTable:
    rows = [_overall_row(each, names, _beside(comparison)) for each in comparison.overall]
    headings = columns("", "games", "% human, +-", "W/T/L")
    note = "% human, +-: difference of normalised scores, the mean over the games that have one"
    title = f"over all games, {_title('human scores', comparison, names)}"
    early = early_notes(_beside(comparison).values())
    return TextTable(title, headings, tuple(rows), (note, *early))


def _overall_row(
    each: Overall, names: Mapping[Side, str], beside: Mapping[tuple[str, Side], Beside]
) -> tuple[str, ...]:
    difference = with_interval(each.difference, 1, factor=100, sign="+")
    outcome = f"{each.wins}/{each.ties}/{each.losses}"
    early = any(own.ends for (_, side), own in beside.items() if side in (each.side, each.reference))
    name = f"{names[each.side]}{EARLY * early} against {names[each.reference]}"
    return name, f"{len(each.games)}", difference, outcome


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
