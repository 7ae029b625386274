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
from arena_curves import LEARNED_GAME, STAGES, SUBJECT, areas_of, described, play, play_learned
from page_tables import TOGETHER, Experiment, arguments, complete, markdown_table, records_of

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.intervals import mean_estimates
from smartplay_tools.evaluation.analysis.names import way_name
from smartplay_tools.evaluation.analysis.pairs import MEASURES, difference_sample, pairs
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.records.rows import Row

SEED = 2032
"""Of the runs: their worlds are in no other table."""
TRIALS = 64
LEARNED_TRIALS = 32
"""Of a learned model, which takes longer."""


@dataclass(frozen=True)
class Claim:
    """That a strategy does better, or worse, than dropping."""

    game: str
    way: Mapping[str, Any]
    """The strategy, as fields of a budget."""
    better: bool
    player: str = SUBJECT.name
    cap: int | None = None
    """Compares scores under this cap, with a history of 10; without one, areas under the curve."""

    @property
    def measure(self) -> str:
        """What is compared."""
        return "area" if self.cap is None else f"score under {self.cap:,}"


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
    Claim(BANDIT, {"first_turns": 3}, better=False, cap=700),
    Claim(SCORED_HANDS, {"first_turns": 3}, better=True, cap=700),
    Claim(SCORED_HANDS, {"notes_tokens": 200}, better=True, cap=700),
)
"""Each is the sign of a difference whose joint interval in the first tables does not contain 0."""


def played(out: Path, models: Path | None) -> Iterator[Row]:
    """Play what the claims compare, and yield the rows; claims about a learned model need `models`."""
    options: dict[str, Any] = {"trials": TRIALS, "seed": SEED}
    for game in dict.fromkeys(claim.game for claim in CLAIMS):
        own = [claim for claim in CLAIMS if claim.game == game]
        for player in dict.fromkeys(claim.player for claim in own if claim.cap is None):
            ways = [claim.way for claim in own if claim.player == player and claim.cap is None]
            stage = replace(STAGES[game], ways=[{}, *ways])
            if player == SUBJECT.name:
                yield from play(stage, [SUBJECT], (), out / game, executor="inline", **options)
            elif models is not None:
                from learned_lab import Lab

                few = {**options, "trials": LEARNED_TRIALS}
                yield from play_learned(stage, Lab(models, LEARNED_GAME), player, out / "learned", **few)
        for cap in dict.fromkeys(claim.cap for claim in own if claim.cap is not None):
            ways = [{}, *(claim.way for claim in own if claim.cap == cap)]
            budgets = [sp.Budget(history=HISTORY, prompt_tokens=cap, **way) for way in ways]
            folder = out / game / f"history-{HISTORY}-{cap}"
            run = complete([game], [SUBJECT], budgets=budgets, out=folder, executor="inline", **options)
            yield from described(run.rows, records_of(run))


@dataclass(frozen=True)
class Outcome:
    """A difference to dropping on the fresh worlds, with an interval that holds together with all others."""

    seeds: int
    difference: float
    low: float
    high: float

    def of(self, claim: Claim) -> str:
        """Return what it says about a claim."""
        if self.low <= 0 <= self.high:
            return "undecided"
        return "confirmed" if (self.low > 0) == claim.better else "contradicted"


def outcomes(rows: Sequence[Row], claims: Sequence[Claim] = CLAIMS) -> list[Outcome | None]:
    """Return the outcome of every claim; None if its episodes are not among the rows."""
    names = [_curve(claim) for claim in claims]
    curves = areas_of([row for row in rows if row["budget"]["history"] is None], compared=len(claims))
    shown = {(each.game, each.name): Outcome(each.seeds, *each.together) for each in curves if each.together}
    cells = {
        (cell.game, f"{cell.player}, {way_name(cell)}", cell.budget["prompt_tokens"]): members
        for cell, members in by_cell(row for row in rows if row["budget"]["history"] == HISTORY)
    }
    scored = [(claim, name) for claim, name in zip(claims, names, strict=True) if claim.cap is not None]
    samples = []
    for claim, name in scored:
        plain = cells[claim.game, _curve(replace(claim, way={})), claim.cap]
        samples.append(difference_sample(pairs(cells[claim.game, name, claim.cap], plain), MEASURES["score"]))
    estimates = iter(mean_estimates(samples, bonferroni(len(claims))))
    result: list[Outcome | None] = []
    for claim, name in zip(claims, names, strict=True):
        if claim.cap is None:
            result.append(shown.get((claim.game, name)))
            continue
        each = next(estimates)
        assert each.low is not None
        assert each.high is not None
        result.append(Outcome(each.episodes, each.mean, each.low, each.high))
    return result


def _curve(claim: Claim) -> str:
    slack = claim.way.get("slack", 0)
    strategy = sp.Budget(**{name: claim.way[name] for name in claim.way if name != "slack"}).describe()
    name = f"{claim.player}, {strategy or sp.Budget().words()['beyond_history']}"
    return name + (f", slack {slack:g}" if slack else "")


def table(rows: Sequence[Row]) -> str:
    """Every claim with its outcome, in Markdown."""
    lines = []
    for claim, outcome in zip(CLAIMS, outcomes(rows), strict=True):
        claimed = f"{claim.measure}: {'more' if claim.better else 'less'} than dropping"
        facts = ["-", "-", "not played"]
        if outcome is not None:
            shown = f"{outcome.difference:+.2f} [{outcome.low:+.2f}, {outcome.high:+.2f}]"
            facts = [str(outcome.seeds), shown, outcome.of(claim)]
        lines.append([f"`{claim.game}`", _curve(claim), claimed, *facts])
    return markdown_table(("game", "player and strategy", "claim", "seeds", TOGETHER[0], "outcome"), lines)


EXPERIMENT = Experiment("arena-claims", lambda rows: {"arena-claims": table(rows)})


def main() -> None:
    """Play, and print or publish the table."""
    parser = arguments(__doc__, "runs/claims")
    parser.add_argument("--learned", type=Path, help="the folder in which experiments/learned.py keeps its models")
    asked = parser.parse_args()
    EXPERIMENT.conclude(played(asked.out, asked.learned), publishes=asked.publish)


if __name__ == "__main__":
    main()
