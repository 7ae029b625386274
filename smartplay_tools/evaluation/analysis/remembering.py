"""Tables of what models still saw of what they needed, and of the tokens that were not those of play.

The figures of an episode are in its row (`records.remembered`, `Tokens`). A share is that of one episode, or of all
episodes of a world; intervals are those of means between 0 and 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from smartplay_tools.evaluation.analysis.formats import TextTable, columns, sections
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell, labels
from smartplay_tools.evaluation.analysis.numbers import amount, dollars, interval_notes, with_interval
from smartplay_tools.evaluation.analysis.pairs import Measure, sample, score, way_to
from smartplay_tools.records.contents import NOWHERE, PLACES
from smartplay_tools.records.remembered import EVICTIONS, IN_PLACE, LOOKED, RULED, SEEN, UNRULED, UNSEEN
from smartplay_tools.records.rows import Row, has_reported_tokens
from smartplay_tools.statistics.intervals import Bounds, MeanEstimate, mean_estimate
from smartplay_tools.types.groups import grouped

SHARE = Bounds(0, 1)

Groups = Sequence[tuple[PlayedCell, list[Row]]]


def share_of(name: str) -> Measure:
    """Return the measure of a share of `records.remembered`; an episode without such answers has none."""

    def share(row: Row) -> float | None:
        holds, of = row.get("memory", {}).get(name, (0, 0))
        return holds / of if of else None

    return share


def seen_share(row: Row) -> float | None:
    """The share of the answers for which everything needed was in view."""
    seen, unseen = (row.get("memory", {}).get(name, (0, 0))[1] for name in (SEEN, UNSEEN))
    return seen / (seen + unseen) if seen + unseen else None


def place_share(place: str) -> Measure:
    """Return the measure of the share of the answers for which everything needed stood in a place.

    Rows of older versions looked at observations alone, and say nothing of places.
    """

    def share(row: Row) -> float | None:
        memory = row.get("memory", {})
        if SEEN in memory and not any(name.startswith(IN_PLACE) for name in memory):
            return None
        of = sum(memory.get(name, (0, 0))[1] for name in (SEEN, UNSEEN))
        return memory.get(UNSEEN if place == NOWHERE else IN_PLACE + place, (0, 0))[1] / of if of else None

    return share


def tokens_of(*names: str) -> Measure:
    """Return the measure of the sum of some of an episode's `Tokens`."""
    return lambda row: float(sum(row["tokens"].get(name, 0) for name in names))


ANSWERS: Mapping[str, Measure] = {"seen": seen_share} | {
    name: share_of(name) for name in (SEEN, UNSEEN, LOOKED, RULED, UNRULED)
}
STOOD: Mapping[str, Measure] = {place: place_share(place) for place in PLACES}
SURVIVED: Mapping[str, Measure] = {name: share_of(name) for _, name in EVICTIONS}
BESIDE_PLAY: Mapping[str, Measure] = {
    "summaries": tokens_of("summary_prompt", "summary_reply"),
    "questions": tokens_of("question_prompt", "question_reply"),
    "texts": tokens_of("texts"),
}


def work_in_words(row: Row) -> str:
    """Return what a compactor did in an episode, in a line; empty if it did nothing and nothing was too long."""
    if not has_compactor(row):
        return ""
    told = [f"{IN_WORDS[name]} {count:,.0f}" for name, measure in WORK.items() if (count := measure(row))]
    cost = question_cost(row)
    money = "what its words cost is not known" if cost is None else f"questions cost ${dollars(cost)}" if cost else ""
    return ", ".join(filter(None, [*told, money, compactor_note([row])]))


IN_WORDS = {
    "rewrites": "rewritings",
    "too long": "prompts too long",
    "blind": "without the newest observation",
    "sent": "questions",
    "refused": "questions refused",
    "tokens": "tokens of questions and replies",
    "own words": "tokens of its own texts in prompts",
}


def best_of(name: str) -> Measure:
    """Return the measure of one of the scores of `records.best_choices`."""
    return lambda row: row["best"][name] if row.get("best") else None


BEST: Mapping[str, Measure] = {
    "dropping": best_of("dropping"),
    "score": score,
    "no return": best_of("without_return"),
    "at most": best_of("at_most"),
    "return": best_of("with_return"),
    "to no return": way_to("at_most"),
    "to best": way_to("with_return"),
}
"""The scores of the world's best choices of whole turns beside those that were played."""

WORK: Mapping[str, Measure] = {
    "rewrites": lambda row: row.get("rewrites", 0),
    "too long": lambda row: row.get("over_prompts", 0),
    "blind": lambda row: row.get("blind_prompts", 0),
    "sent": lambda row: row.get("questions", 0) - row.get("refused_questions", 0),
    "refused": lambda row: row.get("refused_questions", 0),
    "tokens": tokens_of("question_prompt", "question_reply"),
    "own words": tokens_of("texts"),
}
"""What a compactor did in an episode."""

MONEY = "USD of questions"
FOREIGN = "wrote without asking"
NEVER_ACTS = "never acts"


def has_compactor(row: Row) -> bool:
    """Whether a custom strategy has rewritten, asked, or left a prompt too long: a compactor, by what it did."""
    names = ("rewrites", "over_prompts", "questions", "refused_questions")
    return bool(row["budget"].get("strategy")) and any(row.get(name) for name in names)


def compactor_note(rows: Sequence[Row]) -> str:
    """Return what must be known of a compactor's rows: it never acts, or its words came from no question."""
    did = [row for row in rows if row.get("rewrites") or row.get("questions") or row.get("refused_questions")]
    if not did:
        return NEVER_ACTS
    return FOREIGN if any(map(_wrote_unasked, did)) else ""


def _wrote_unasked(row: Row) -> bool:
    return bool(row["tokens"].get("texts") and not row.get("questions"))


def question_cost(row: Row) -> float | None:
    """Return the US dollars of a compactor's questions; None if not known.

    That is so where a price is missing, where words came from no question, and in rows of older versions, unless
    nothing was asked or their episode cost nothing.
    """
    if _wrote_unasked(row):
        return None
    is_free = not WORK["sent"](row) or (row.get("cost") == 0 and not has_reported_tokens(row))
    known: float | None = row.get("question_cost", 0.0 if is_free else None)
    return known


def _money(rows: Sequence[Row], estimate: MeanEstimate | None) -> str:
    return "unknown" if None in map(question_cost, rows) else amount(estimate, dollars)


def remembering_tables(rows: Sequence[Row]) -> Iterator[TextTable]:
    """Yield the tables of these measures that have anything to show."""
    groups = by_cell(rows)
    declaring = [(cell, members) for cell, members in groups if any(row.get("memory") for row in members)]
    if declaring:
        yield _table("what was in view, in percent", declaring, ANSWERS, SHARE)
        yield _table("where what was needed stood, in percent", declaring, STOOD, SHARE)
        yield _table("right answers by evictions survived, in percent", declaring, SURVIVED, SHARE)
    bounded = [(cell, members) for cell, members in groups if any(row.get("best") for row in members)]
    if bounded:
        yield _table("how far from the best choice of whole turns", bounded, BEST, None, decimals=2)
    compacting = [(cell, members) for cell, members in groups if any(map(has_compactor, members))]
    if compacting:
        notes = {id(members): compactor_note(members) for _, members in compacting}
        yield _table("what the compactor did in an episode", compacting, {**WORK, MONEY: question_cost}, None, notes)
    beside = [
        (cell, members) for cell, members in groups if any(m(row) for m in BESIDE_PLAY.values() for row in members)
    ]
    if beside:
        yield _table("tokens of an episode beside those of play", beside, BESIDE_PLAY, None)


def _table(
    title: str,
    groups: Groups,
    measures: Mapping[str, Measure],
    bounds: Bounds | None,
    notes: Mapping[int, str] | None = None,
    *,
    decimals: int = 0,
) -> TextTable:
    """`notes` end the names of groups, by the ids of their rows."""
    named = zip(labels([cell for cell, _ in groups]), groups, strict=True)
    lines, estimates = [], []
    for label, (cell, members) in named:
        samples = [sample(members, measure, bounds) for measure in measures.values()]
        own = [mean_estimate(each.values, each.bounds) if each.values else None for each in samples]
        shown = [
            _money(members, each) if name == MONEY else with_interval(each, decimals, factor=100 if bounds else 1)
            for name, each in zip(measures, own, strict=True)
        ]
        note = (notes or {}).get(id(members), "")
        lines.append((cell.game, ("  " + ", ".join(filter(None, [cell.player, label, note])), *shown)))
        estimates += own
    by_game = grouped(lines, lambda line: line[0]).items()
    body = sections((game, (line for _, line in own_lines)) for game, own_lines in by_game)
    return TextTable(title, columns("game and player", *measures), body, tuple(interval_notes(estimates)))
