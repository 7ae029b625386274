"""What the arena's tables show, asked again on fresh worlds: a table of `docs/experiments.md`.

    python experiments/arena_claims.py --learned runs/learned  # plays it; continues where it stopped

A difference that was picked from a table because it is large looks larger than it is. So the claims below were written
down before the worlds of `SEED` were played. Their intervals hold together, and one that contains 0 confirms nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from arena import HISTORY
from arena_curves import LEARNED_GAME, STAGES, SUBJECT, described, play, play_learned
from page_tables import (
    TOGETHER,
    Experiment,
    arguments,
    complete,
    in_steps,
    interval,
    markdown_table,
    outcome,
    records_of,
)

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.names import way_name
from smartplay_tools.evaluation.analysis.pairs import MEASURES, difference_sample, pairs
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate, mean_estimates
from smartplay_tools.types.groups import grouped

SEED = 2032
"""Of the runs: their worlds are in no other table."""
TRIALS = 64
LEARNED_TRIALS = 32
"""Of a learned model, which takes longer."""


CAP = 700
"""The cap on prompts under which all claims are held: the smallest of the curves."""


@dataclass(frozen=True)
class Claim:
    """That a strategy scores more, or less, than dropping does under the cap."""

    game: str
    way: Mapping[str, Any]
    """The strategy, as fields of a budget."""
    better: bool
    player: str = SUBJECT.name
    history: int | None = None


BANDIT, HANDS, SCORED_HANDS, MESSENGER = (
    "BanditTwoArmedHighLowFixed-v0",
    "RockPaperScissorBasic-v0",
    "RockPaperScissorDifferentScore-v0",
    "MessengerL3-v0",
)
CLAIMS = (
    Claim(BANDIT, {"notes_tokens": 200}, better=True),
    Claim(BANDIT, {"first_turns": 3}, better=True),
    Claim(HANDS, {"notes_tokens": 200}, better=True),
    Claim(HANDS, {"slack": 0.5}, better=False),
    Claim(HANDS, {"memory_tokens": 100}, better=False, player="full-0"),
    Claim(HANDS, {"summary_tokens": 100, "slack": 0.5}, better=False, player="full-0"),
    Claim(MESSENGER, {"memory_tokens": 200}, better=False),
    Claim(BANDIT, {"first_turns": 3}, better=False, history=HISTORY),
    Claim(SCORED_HANDS, {"first_turns": 3}, better=True, history=HISTORY),
    Claim(SCORED_HANDS, {"notes_tokens": 200}, better=True, history=HISTORY),
)
"""Each is the sign of a difference whose joint interval in the first tables does not contain 0."""


def played(out: Path, models: Path | None) -> Iterator[Row]:
    """Play what the claims compare, and yield the rows; claims about a learned model need `models`.

    Without a history, the rows have the other caps of the curves, too.
    """
    options: dict[str, Any] = {"trials": TRIALS, "seed": SEED}
    for (game, player, history), own in grouped(CLAIMS, lambda each: (each.game, each.player, each.history)).items():
        ways = [{}, *(claim.way for claim in own)]
        if history is not None:
            budgets = [sp.Budget(history=history, prompt_tokens=CAP, **way) for way in ways]
            folder = out / game / f"history-{history}-{CAP}"
            run = complete([game], [SUBJECT], budgets=budgets, out=folder, executor="inline", **options)
            yield from described(run.rows, records_of(run))
        elif player == SUBJECT.name:
            yield from play(replace(STAGES[game], ways=ways), out / game, executor="inline", **options)
        elif models is not None:
            from learned_lab import Lab

            stage, few = replace(STAGES[game], ways=ways), {**options, "trials": LEARNED_TRIALS}
            yield from play_learned(stage, Lab(models, LEARNED_GAME), player, out / "learned", **few)


def outcomes(rows: Sequence[Row], claims: Sequence[Claim] = CLAIMS) -> list[tuple[MeanEstimate, str] | None]:
    """Return the difference of every claim with its mark of early ends; None if its episodes are not among the rows."""
    cells = {
        (cell.game, f"{cell.player}, {way_name(cell)}", cell.budget["history"]): members
        for cell, members in by_cell(row for row in rows if row["budget"]["prompt_tokens"] == CAP)
    }
    keys = [(claim.game, _name(claim), claim.history) for claim in claims]
    plain = [(claim.game, _name(replace(claim, way={})), claim.history) for claim in claims]
    samples = [
        difference_sample(pairs(cells[key], cells[reference]), MEASURES["score"])
        for key, reference in zip(keys, plain, strict=True)
        if key in cells
    ]
    estimates = iter(mean_estimates(samples, bonferroni(len(claims))))
    return [(next(estimates), in_steps(cells[key])) if key in cells else None for key in keys]


def _name(claim: Claim) -> str:
    slack = claim.way.get("slack", 0)
    strategy = sp.Budget(**{name: claim.way[name] for name in claim.way if name != "slack"}).describe()
    name = f"{claim.player}, {strategy or sp.Budget().words()['beyond_history']}"
    return name + (f", slack {slack:g}" if slack else "")


def table(rows: Sequence[Row]) -> str:
    """Every claim with its outcome, in Markdown."""
    lines = []
    for claim, played in zip(CLAIMS, outcomes(rows), strict=True):
        claimed = "more" if claim.better else "less"
        window = f"{CAP} tokens" if claim.history is None else f"{CAP} tokens, {claim.history} past steps"
        facts = ["-", "not played"]
        if played is not None:
            estimate, early = played
            facts = [interval(estimate, "+") + early, outcome(estimate, better=claim.better)]
        lines.append([f"`{claim.game}`", _name(claim), window, claimed, *facts])
    return markdown_table(("game", "player and strategy", "window", "claim", TOGETHER[0], "outcome"), lines)


EXPERIMENT = Experiment("arena-claims", lambda rows: {"arena-claims": table(rows)})


def main() -> None:
    """Play, and print or publish the table."""
    parser = arguments(__doc__, "runs/claims")
    parser.add_argument("--learned", type=Path, help="the folder in which experiments/learned.py keeps its models")
    asked = parser.parse_args()
    EXPERIMENT.conclude(played(asked.out, asked.learned), publishes=asked.publish)


if __name__ == "__main__":
    main()
