"""The tables of a run apart from its headline, at most 80 columns wide.

There is a table for each topic: scores with their intervals, the nine capabilities,
mistakes, tokens and cost, differences from the paper, and failed attempts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from smartplay_tools.evaluation.analysis.formats import Column, ShownColumn, TextTable, columns, figures_table
from smartplay_tools.evaluation.analysis.grouping import Condition
from smartplay_tools.evaluation.analysis.headline import INTERVALS, PRIVILEGED, by_game, shared, warnings
from smartplay_tools.evaluation.analysis.numbers import (
    NOTHING,
    amount,
    count,
    decimals_of,
    dollars,
    interval_notes,
    percent,
    with_interval,
)
from smartplay_tools.evaluation.analysis.summary import (
    CellSummary,
    Drift,
    Failures,
    Profile,
    RunSummary,
)
from smartplay_tools.games.paper_tables import CAPABILITIES
from smartplay_tools.games.specs import GAMES
from smartplay_tools.types.quantities import short

PROFILES_PER_TABLE = 2
"""The number of capability columns that fit into 80 columns beside the capabilities' names."""


Figures = tuple[ShownColumn[CellSummary], ...]


def details(summary: RunSummary) -> Iterator[TextTable]:
    """Yield the tables of a run, without the headline."""
    cells = summary.cells
    if cells:
        shown = interval_notes(each for c in cells for each in (c.score, c.normalized_score, c.completion))
        yield _cells(summary, "scores", _scores, INTERVALS, *shown, *warnings(cells))
    for first in range(0, len(summary.profiles), PROFILES_PER_TABLE):
        beside = summary.profiles[first : first + PROFILES_PER_TABLE]
        yield _capabilities(beside, [profile.condition for profile in summary.profiles])
    if cells:
        yield _cells(summary, "how it went", lambda _: PLAY, "totals over episodes; cut: share of tool results")
        rewards = interval_notes(cell.reward for cell in cells)
        yield _cells(summary, "rewards, and why episodes ended", _ends, INTERVALS, *rewards)
        spent = SPENT if any(cell.spent_cost for cell in cells) else ()
        yield _cells(summary, "what it took", lambda _: (*TOKENS, *spent), *TOKEN_NOTES)
        yield deviations_table(cells)
    if summary.failures:
        yield failures_table(summary.failures)


def failures_table(failures: Sequence[Failures]) -> TextTable:
    """Return the attempts without a result: what failed, was interrupted, or was paused by a cap of the run."""
    rows: list[tuple[str, ...]] = []
    for failed in failures:
        reasons = ", ".join(f"{reason} {count}" for reason, count in failed.reasons.items())
        rows.append((f"{failed.game or NOTHING}, {failed.player or NOTHING}",))
        rows.append((f"  {reasons}", f"{failed.attempts}", f"{failed.missing}", failed.last_error or ""))
    headings = (*columns("why", "attempts", "missing"), Column("last error", words=True))
    note = "they are in no figure; missing: episodes that no later attempt has finished"
    return TextTable("attempts without a result", headings, tuple(rows), (note,))


def _scores(cells: Sequence[CellSummary]) -> Figures:
    points = decimals_of(cell.score for cell in cells)
    return (
        ("n", lambda c: count(c.episodes, c.score)),
        ("score", lambda c: with_interval(c.score, points)),
        ("% human", lambda c: with_interval(c.normalized_score, 0, factor=100)),
        ("% done", lambda c: with_interval(c.completion, 0, factor=100)),
    )


def _ends(cells: Sequence[CellSummary]) -> Figures:
    points = decimals_of(cell.reward for cell in cells)
    return (
        ("reward", lambda c: with_interval(c.reward, points)),
        (Column("ends", words=True), lambda c: ", ".join(f"{why} {count}" for why, count in c.end_reasons.items())),
    )


def _cells(
    summary: RunSummary, title: str, figures: Callable[[Sequence[CellSummary]], Figures], *notes: str
) -> TextTable:
    """A table with a heading for every game and below it a row for every player."""
    given = shared(summary)
    return figures_table(f"{title} ({given})" if given else title, "game and player", by_game(summary), figures, notes)


def _count(name: str) -> Callable[[CellSummary], str]:
    return lambda cell: short(cell.counts[name])


def _money(cost: float) -> str:
    return short(cost) if cost >= 100 else f"{cost:.3g}"


def _drift(drift: Drift | None) -> str:
    return NOTHING if drift is None or drift.ratio is None else f"x{drift.ratio:.3f}"


PLAY: Figures = (
    ("steps", _count("steps")),
    ("calls", _count("tool_calls")),
    ("illegal", _count("illegal_actions")),
    ("malf.", _count("malformed_calls")),
    ("refused", _count("refused_calls")),
    ("idle", _count("idle_replies")),
    ("fallb.", _count("fallback_actions")),
    ("cut", lambda cell: percent(cell.cut_share)),
)

TOKEN_NOTES = (
    "tokens, those of replies among them, and USD are of an episode; over, unusable: totals over episodes;",
    "stable: share of prompts that repeats the prompt before;",
    "over: replies longer than allowed; drift: the provider's count against ours;",
    "unusable: usages that the provider reported with numbers that cannot be tokens, which count as none",
)
TOKENS: Figures = (
    ("tokens", lambda cell: amount(cell.episode_tokens, short)),
    ("replies", lambda cell: short(cell.tokens.reply / cell.episodes)),
    ("stable", lambda cell: percent(cell.tokens.prefix_share)),
    ("over", lambda cell: short(cell.tokens.overruns)),
    ("unusable", _count("unusable_usages")),
    ("drift, p.", lambda cell: _drift(cell.tokens.prompt_drift)),
    ("drift, r.", lambda cell: _drift(cell.tokens.reply_drift)),
    ("USD", lambda cell: amount(cell.episode_cost, dollars)),
)
SPENT: Figures = (("spent", lambda cell: amount(cell.spent_cost, _money)),)
"""What episodes cost by the rule of their budgets, where these are in money."""


def _capabilities(profiles: Sequence[Profile], among: Sequence[Condition]) -> TextTable:
    given = [(p.condition.player + "*" * p.privileged, p.condition.label_among(among)) for p in profiles]
    names = [", ".join(filter(None, words)) for words in given]
    rows = [
        (capability, *(with_interval(p.capabilities.scores[index].estimate, 2) for p in profiles))
        for index, capability in enumerate(CAPABILITIES)
    ]
    reasons = [score.reason for profile in profiles for score in profile.capabilities.scores if score.reason]
    left_out = [
        f"{', '.join(p.capabilities.left_out)}: no normalised score, or no ratings"
        for p in profiles
        if p.capabilities.left_out
    ]
    rated = [game for game in GAMES.benchmark if GAMES[game].challenges]
    played = dict.fromkeys(
        f"of {len(rated)} rated settings of the paper, {len(p.capabilities.settings)} are in the scores: "
        f"{', '.join(p.capabilities.settings)}"
        for p in profiles
        if set(p.capabilities.settings) < set(rated)
    )
    privileged = [PRIVILEGED] if any(profile.privileged for profile in profiles) else []
    equal = interval_notes(score.estimate for p in profiles for score in p.capabilities.scores)
    empty = [f"{NOTHING}: {why}" for why in reasons]
    notes = dict.fromkeys([INTERVALS, *played, *equal, *left_out, *empty, *privileged])
    headings = columns("capability", *names)
    return TextTable("capabilities, the paper's weights", headings, tuple(rows), tuple(notes))


def deviations_table(cells: Sequence[CellSummary]) -> TextTable:
    """The table of deviations, each listed once with the cells that have it."""
    where: dict[tuple[str, str, str], list[CellSummary]] = {}
    for cell in cells:
        for name, values in cell.deviations.items():
            where.setdefault((name, _value(values["paper"]), _value(values["played"])), []).append(cell)
    rows = [(*deviation, _place(members, cells)) for deviation, members in where.items()]
    headings = tuple(Column(heading, words=True) for heading in ("what", "paper", "played", "where"))
    return TextTable("different from the paper", headings, tuple(rows))


def _place(members: Sequence[CellSummary], cells: Sequence[CellSummary]) -> str:
    if len(members) == len(cells):
        return "everywhere"
    return ", ".join(dict.fromkeys(cell.cell.game for cell in members))


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_value(each)}" for name, each in value.items())
    return "none" if value is None else str(value)
