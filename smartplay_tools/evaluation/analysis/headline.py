"""The headline of a run: one short table, shown first, with the scores, tokens and cost of every player.

It fits 80 columns. `TERMS` explains its columns, and `details` has all other tables.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from smartplay_tools.evaluation.analysis.formats import (
    NOTHING,
    TextTable,
    columns,
    decimals_of,
    dollars,
    interval_notes,
    percent,
    sections,
    with_interval,
)
from smartplay_tools.evaluation.analysis.summary import CellSummary, RunSummary
from smartplay_tools.evaluation.quantities import short

CUT = "\N{DAGGER}"
"""The mark of cells in which tool results were cut to fit."""

UNPLAYED = "!"
"""The mark of cells with episodes in which no action was ever played."""

EARLY = "\N{DOUBLE DAGGER}"
"""The mark of cells with episodes that ended early and count as the least that they could have scored."""

INTERVALS = "[ ]: 95 % interval of the mean"
PRIVILEGED = "*: privileged, it knows the game's state and not only its messages"

MANY_CUTS = 0.01
"""The share of cut results at which a table begins to warn."""

TERMS: Mapping[str, str] = {
    "n": "finished episodes",
    "score": "the game's own score, mean over episodes",
    EARLY: "a budget, a stall or a strategy ended episodes; each counts as the least that the missing steps allow",
    "[ ]": "the 95 % interval of a mean; docs/metrics.md says which one, and how often it holds",
    "equal": "the episodes show no spread, and the measure has no bounds from which an interval would follow",
    "% human": "(score - minimum) / (human - minimum), with the paper's human score",
    "tokens": "budget tokens of an episode's prompts and replies, by our own count; mean over episodes",
    "USD": "cost of all episodes of the line; none if the price of a model is not known",
    "done": "share of episodes that reached the objective, in games that have one",
    "illegal": "calls of `act` whose argument is not an action",
    "malf.": "malformed: calls that could not be read (unknown tool, broken JSON, missing or extra arguments)",
    "refused": "calls that the batch policy refused, or that came after the end",
    "idle": "replies without a tool call",
    "fallb.": "fallbacks: answers of the paper's protocol that named no action, so that the first one was played",
    "cut": "share of tool results that were longer than their cap and were cut",
    "stable": "share of prompt tokens that repeats the beginning of the previous prompt, which a cache can serve",
    "over": "replies that were longer than allowed; charged in full",
    "drift": "the provider's count of tokens as a multiple of ours",
    "capability": "sum of degree x normalised score over the settings, divided by the sum of degrees",
    "seen": "share of the answers for which every observation that the game says they need was in view",
    "in view": "share of right answers where it was; a right answer has a positive reward",
    "out of view": "share of right answers where it was not",
    "looked": "of the answers out of view, those before which recall, read_result or a file was asked",
    "rules": "actions that broke no rule of the game, where some would have, while the manual was in view",
    "rules lost": "the same after the manual had left the view",
    "0, 1, 2-3": "right answers by how often something had left the view since what they needed was first shown",
    "texts": "tokens that a custom strategy has written, in all prompts of an episode; questions: of a compactor",
    "+-": "difference to full context, the cell with the widest window, paired by seed",
}
"""The meaning of the terms in the tables."""


Named = tuple[str, CellSummary]
"""A cell and its name in a table."""


def headline(summary: RunSummary, title: str = "") -> TextTable:
    """Return the short table of a run: score, share of the human's, tokens and cost for every game and player."""
    rows = sections((game, _rows(cells)) for game, cells in by_game(summary))
    headings = columns("game and player", "n", "score", "% human", "tokens", "USD")
    intervals = [INTERVALS, *interval_notes(cell.score for cell in summary.cells)]
    return TextTable(title or shared(summary), headings, rows, (*intervals, *warnings(summary.cells)))


def by_game(summary: RunSummary) -> list[tuple[str, list[Named]]]:
    """Return the cells of each game with their names: the player, and what distinguishes its cells of the game."""
    players = Counter((game_name(cell), cell.cell.player) for cell in summary.cells)
    games: dict[str, list[Named]] = {}
    for cell in summary.cells:
        game, given = game_name(cell), summary.label_of(cell)
        name = f"{player_name(cell)}, {given}" if given and players[game, cell.cell.player] > 1 else player_name(cell)
        games.setdefault(game, []).append((name, cell))
    return list(games.items())


def shared(summary: RunSummary) -> str:
    """Return a short description of the run's condition; empty for the default, or if players' conditions differ."""
    given = {summary.label_of(cell) for cell in summary.cells}
    return given.pop() if len(given) == 1 else ""


def warnings(cells: Iterable[CellSummary]) -> list[str]:
    """Return the warnings to read before comparing these cells."""
    cells = list(cells)
    notes = [PRIVILEGED] if any(cell.privileged for cell in cells) else []
    if unplayed := sum(cell.unplayed for cell in cells):
        notes.append(
            f"{UNPLAYED}: {unplayed} without any action, whose scores say nothing of how well the player plays"
        )
    if early := sum(cell.early for cell in cells):
        notes.append(f"{EARLY}: {early} that ended early; each counts as the least that the missing steps allow")
    worst = max((cell.cut_share or 0.0 for cell in cells), default=0.0)
    if is_much_cut(worst):
        notes.append(
            f"{CUT}: tool results were cut to fit (up to {percent(worst)} of them), so a low score is not that "
            "of less memory alone; raise --prompt-tokens or --result-tokens"
        )
    return notes


def is_much_cut(share: float | None) -> bool:
    """Whether so large a share of tool results was cut that a score does not measure its window alone."""
    return (share or 0.0) >= MANY_CUTS


def player_name(cell: CellSummary) -> str:
    """Return the player's name with its marks."""
    marks = {"*": cell.privileged, UNPLAYED: cell.unplayed > 0, EARLY: cell.early > 0}
    marks |= {CUT: is_much_cut(cell.cut_share)}
    return cell.cell.player + "".join(mark for mark, holds in marks.items() if holds)


def game_name(cell: CellSummary) -> str:
    """Return the game, with engine and options if it has them."""
    made = [cell.cell.engine] if cell.cell.engine else []
    made += [f"{name}={value}" for name, value in cell.cell.options.items()]
    return f"{cell.cell.game} ({', '.join(made)})" if made else cell.cell.game


def _rows(cells: Sequence[Named]) -> Iterator[tuple[str, ...]]:
    decimals = decimals_of(cell.score for _, cell in cells)
    for name, cell in cells:
        human = NOTHING if cell.normalized_score is None else f"{100 * cell.normalized_score.mean:.0f}"
        tokens = short((cell.tokens.prompt + cell.tokens.reply) / cell.episodes)
        score = with_interval(cell.score, decimals)
        yield f"  {name}", f"{cell.episodes}", score, human, tokens, dollars(cell.cost)
