"""The effect of smaller windows: their cost in score, and their savings in tokens.

Cells that differ only in their window (history, prompt tokens, slack, strategies) are a family, and each is compared
with the widest window of its family, its **reference**: the cell with the longest history; if there are several, the
one with the highest cap on prompts, then the one with the least slack, and then the one with the fewest strategies.
None is no limit, and the longest. In a grid this is the largest history with the largest cap at slack 0 and plain
dropping, with the same manual. It is **full context** if nothing left the window in any of its episodes.

An episode that was cut short by a cap on the whole run (`run_budget`) does not show the value of a window, so it is not
compared. Means and paired differences are estimated with 95 % intervals (`pairs`, `intervals`), each of which holds by
itself: with twenty cells, one is expected to miss. The K differences of scores also have intervals that hold together
in 95 of 100 sweeps (`together`). Controls, which do not read their prompts, are not among the K. The
Pareto fronts compare the means of all cells of a game, including different players, manuals and protocols, because
these have a price too. A point is dominated if another one is at most as expensive and at least as good, and better in
one of the two. The front consists of the points that are not dominated; equal points are on it together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.evaluation.analysis.beside import Beside, ends_of
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell
from smartplay_tools.evaluation.analysis.pairs import (
    MEASURES,
    are_identical,
    cut_share,
    difference_samples,
    is_control,
    pairs,
    samples,
)
from smartplay_tools.evaluation.analysis.together import jointly
from smartplay_tools.records.rows import Row, is_whole
from smartplay_tools.statistics.intervals import MeanEstimate, mean_estimate, named_estimates, with_ends
from smartplay_tools.types import STRATEGIES, Budget
from smartplay_tools.types.arguments import canonical_text
from smartplay_tools.types.groups import grouped


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of the points (price, score) that no other dominates, cheapest first.

    Equal points keep their order.
    """
    front: list[int] = []
    best = float("-inf")
    last: tuple[float, float] | None = None
    # Cheapest first and, for one price, best first: a point is on the front if it is better than all before it.
    for index in sorted(range(len(points)), key=lambda at: (points[at][0], -points[at][1])):
        if points[index][1] > best or points[index] == last:
            front.append(index)
            best, last = points[index][1], points[index]
    return front


WINDOW = ("history", "prompt_tokens", "slack", *STRATEGIES)
"""The fields of a budget that say how much of an episode a prompt shows, and what happens to the rest."""

LIMITS = tuple(name for name in Budget.model_fields if name not in WINDOW)
"""The other fields, which limit replies, results and whole episodes."""

FOLLOWS_FROM_WINDOW = ("result_tokens", "manual_tokens")
"""Fields for which "auto" gives a different number under a different cap on prompts."""


@dataclass(frozen=True)
class WindowComparison:
    """The comparison of one cell with the reference of its family."""

    cell: PlayedCell
    episodes: int
    reference: PlayedCell
    """The cell that it is compared with, which may be itself."""
    is_whole: bool
    """Whether nothing left the window in any of its episodes."""
    means: Mapping[str, MeanEstimate]
    """By the names of `pairs.MEASURES`, as far as the episodes have them."""
    differences: Mapping[str, MeanEstimate]
    """Paired, this cell less its reference; empty for the reference itself."""
    is_identical: bool
    """Whether every prompt and reply is equal to the reference's."""
    together: MeanEstimate | None
    """The difference of scores with an interval that holds together with those of all other cells."""
    cut_share: float | None
    """The share of tool results that were cut to their cap; None without a tool call."""
    pairs: int
    """Episodes with a counterpart in the reference."""
    ends: Mapping[str, int]
    """How many of its episodes ended before their game did, by the reason."""
    on_token_front: bool
    """Whether the cell is on the game's Pareto front of mean score against mean tokens."""
    on_cost_front: bool | None
    """The same against cost; None unless every episode of the game has a price."""

    @property
    def is_reference(self) -> bool:
        """Whether this is the reference of its family."""
        return self.cell == self.reference

    @property
    def beside(self) -> Beside:
        """What may have to stand beside its score."""
        return Beside.of(self.cell.game, self.means, self.ends)


def compare_windows(rows: Iterable[Row], *, along: Sequence[str] = WINDOW) -> list[WindowComparison]:
    """Compare every cell of a run with the reference of its family; cells keep the order of the rows.

    `along` are the fields of the budget in which a family may differ. `("slack",)` isolates slack: every
    cell is compared with the one that has the same history and cap, and the least slack.
    """
    groups = by_cell(row for row in rows if row["end_reason"] != "run_budget")
    references = _references(groups, along)
    means = [named_estimates(samples(members)) for _, members in groups]
    played = [
        [] if at == reference else pairs(groups[at][1], groups[reference][1]) for at, reference in enumerate(references)
    ]
    differing = [difference_samples(own) if own else {} for own in played]
    judged = zip(differing, groups, strict=True)
    method = jointly([own["score"] for own, (cell, _) in judged if own and not is_control(cell.player)])
    token_fronts, cost_fronts = _fronts(groups, means, "tokens"), _fronts(groups, means, "cost")
    return [
        WindowComparison(
            cell=cell,
            episodes=len(members),
            reference=groups[reference][0],
            is_whole=all(map(is_whole, members)),
            means=means[at],
            differences=named_estimates(differing[at]),
            is_identical=are_identical(played[at]),
            together=mean_estimate(own.values, own.bounds, method) if (own := differing[at].get("score")) else None,
            cut_share=cut_share(members),
            pairs=len(played[at]),
            ends=ends_of(members),
            on_token_front=bool(token_fronts[at]),
            on_cost_front=cost_fronts[at],
        )
        for at, ((cell, members), reference) in enumerate(zip(groups, references, strict=True))
    ]


def width(budget: Mapping[str, Any]) -> tuple[float, float, float, float]:
    """A sort key of windows, which is larger for a window that shows more, and then for one with fewer strategies."""
    history, prompt_tokens = (float("inf") if budget[name] is None else float(budget[name]) for name in WINDOW[:2])
    strategies = sum(budget.get(name, default) != default for name, default in STRATEGIES.items())
    return history, prompt_tokens, -budget["slack"], -strategies


def is_widest_but(comparison: WindowComparison, field: str) -> bool:
    """Whether only this field of the window limits a cell, compared with the widest window of its family."""
    others = (name for name in WINDOW if name != field)
    return all(comparison.cell.budget[name] == comparison.reference.budget[name] for name in others)


def family(cell: PlayedCell, along: Sequence[str] = WINDOW) -> bytes:
    """A key for everything about a cell except the given fields of its window."""
    return cell.key(without=(*along, *FOLLOWS_FROM_WINDOW))


def _references(groups: Sequence[tuple[PlayedCell, list[Row]]], along: Sequence[str]) -> list[int]:
    """For every group the index of its family's reference."""
    families = [family(cell, along) for cell, _ in groups]
    widest: dict[bytes, int] = {}
    for at, (name, (cell, _)) in enumerate(zip(families, groups, strict=True)):
        best = widest.setdefault(name, at)
        if width(cell.budget) > width(groups[best][0].budget):
            widest[name] = at
    return [widest[name] for name in families]


def _fronts(
    groups: Sequence[tuple[PlayedCell, list[Row]]], means: Sequence[Mapping[str, MeanEstimate]], price: str
) -> list[bool | None]:
    """For every group whether it is on its game's front of score against a price; None if prices are missing."""
    verdicts: list[bool | None] = [None] * len(groups)
    for members in grouped(range(len(groups)), lambda at: groups[at][0].game).values():
        # A mean over only those episodes that have a price would be misleading.
        if any(MEASURES[price](row) is None for at in members for row in groups[at][1]):
            continue
        front = pareto_front([(means[at][price].mean, means[at]["score"].mean) for at in members])
        for position, at in enumerate(members):
            verdicts[at] = position in front
    return verdicts


def as_row(comparison: WindowComparison) -> dict[str, Any]:
    """Return a comparison as one flat row of a table: `score`, `score_low`, `score_high`, `score_difference`, ..."""
    cell = comparison.cell
    row: dict[str, Any] = {"game": cell.game, "engine": cell.engine, "player": cell.player, **cell.rules}
    row |= {"tokenizer": cell.tokenizer}
    row |= {name: canonical_text(getattr(cell, name)) for name in ("options", "player_options")}
    row |= {name: cell.budget[name] for name in (*WINDOW, *LIMITS)}
    row |= {
        "episodes": comparison.episodes,
        "reference": comparison.is_reference,
        "full_context": comparison.is_reference and comparison.is_whole,
    }
    row |= {"cut_share": comparison.cut_share, "ended_early": sum(comparison.ends.values())}
    for measure in MEASURES:
        row |= with_ends(measure, comparison.means.get(measure))
        row |= with_ends(f"{measure}_difference", comparison.differences.get(measure))
    joint = with_ends("score_difference_together", comparison.together)
    row |= {name: end for name, end in joint.items() if name != "score_difference_together"}
    row |= {"pairs": None if comparison.is_reference else comparison.pairs}
    row |= {"identical": comparison.is_identical}
    return row | {"on_token_front": comparison.on_token_front, "on_cost_front": comparison.on_cost_front}
