"""How wide a window a budget of money should buy: points of a game until an episode has cost as much as another.

    python experiments/window_for_a_budget.py            # plays 1,200 episodes, in minutes
    python experiments/window_for_a_budget.py --pilot    # the same in the worlds in which the claims were found

Players without a model play every world under every cap, to the end. Each episode is then cut where the budget
`episode_cost` ends it: before the first prompt that does not fit with its longest reply. These players do not see what
is left, so the cut is what they do under that budget; a test plays it.

Claims, written after the pilot and before any world of the experiment was played, about 10,000 uncached tokens:
1. At a tenth, the price of a cached token today, the full history buys `rule` more points than a cap of 450 tokens
   does, at the bandit and at Rock Paper Scissors, and more than any cap that was tried.
2. It buys the players of one line, which need two or five rounds, fewer points than their best cap does, at both.
3. Without a cache it buys the player of one line at the bandit fewer points than 450 tokens do.
4. At Lockers, where any sentence may be asked for, it buys more than 450 tokens at every price.
5. The price up to which it buys most is from 0.1 to 0.4 for `rule` at both games, and below 0.1 for the players of one
   line at both.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from itertools import accumulate
from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np
from context_tables import TARIFFS
from page_tables import Experiment, arguments, interval, markdown_table

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.style import Series, figure, legend_below, panels
from smartplay_tools.evaluation.costs.charges import calls_under
from smartplay_tools.providers.caches import CacheRule
from smartplay_tools.records import Record, requests_of
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import mean_estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BANDIT, HANDS, LOCKERS = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Lockers12-v0"
CELLS = ((BANDIT, "rule"), (BANDIT, "leave-after-two"), (HANDS, "rule"), (HANDS, "count-last-5"), (LOCKERS, "reader"))
CAPS = (450, 600, 800, 1200, None)
NARROWER = slice(len(CAPS) - 1)
WORLDS, FIRST, PILOT = 48, 68_000, 7_000
"""How many worlds, and the seeds of the first of them."""
COST, REPLY, OUTPUT = 10_000, 40, 5
"""The budget, the cap on a reply, and the price of a reply's token where only that of a cached one is varied."""
PRICES = np.arange(101) / 100
"""The prices of a cached token, as shares of an uncached one."""
ANY = CacheRule(name="any", title="no minimum", read_on=date(2026, 11, 29), source="this file")


def budget(cap: int | None, **more: Any) -> sp.Budget:
    """Return the budget of a window."""
    return sp.Budget(history=None, prompt_tokens=cap, slack=0.5, reply_tokens=REPLY, **more)


def paid_for(prompts: Any, replies: Any, output: float) -> Any:
    """Return how many calls the budget pays, each with its longest reply reserved; `prompts` may have more axes."""
    spent = np.cumsum(prompts + output * replies, axis=-1)
    return (spent + output * (REPLY - replies) <= COST + 1e-6).cumprod(axis=-1).sum(axis=-1)


def play(first: int) -> Iterator[Row]:
    """Play every cell in every world."""
    for game, player in CELLS:
        for cap in CAPS:
            for seed in range(first, first + WORLDS):
                events: list[Any] = []
                with sp.Episode(game, seed=seed, budget=budget(cap), transcript=events) as episode:
                    sp.play(episode, sp.get_player(player, seed=seed))
                record = Record(events)
                log, paid = requests_of(record), [0.0] * len(record.turns)
                for call in record.calls:
                    paid[call["turn"]] += call["data"].get("reward", 0)
                points, bought = list(accumulate(paid, initial=0.0)), {}
                for each in TARIFFS["money"]:
                    charged = calls_under(log, each.rule, marks=each.marks)
                    prompts = each.rule.priced().each([(call.prompt, call.hit, call.written, 0) for call in charged])
                    replies = np.array([call.reply for call in charged])
                    bought[each.label] = points[paid_for(np.array(prompts), replies, each.rule.output)]
                calls = [(call.prompt, call.hit, call.reply) for call in calls_under(log, ANY)]
                yield {
                    "game": game, "player": player, "cap": cap, "seed": seed, "bought": bought, "calls": calls,
                    "points": points,
                }  # fmt: skip


def by_price(rows: Sequence[Row], game: str, player: str) -> Any:
    """Return the points that the budget buys, by cap, world and price of a cached token."""
    shares = []
    for row in _of(rows, game, player):
        prompts, hits, replies = np.array(row["calls"]).T
        costs = prompts - hits + PRICES[:, None] * hits
        shares.append(np.array(row["points"])[paid_for(costs, replies, OUTPUT)])
    return np.array(shares).reshape(len(CAPS), -1, len(PRICES))


def turn(points: Any, others: slice, chosen: Any = slice(None)) -> float:
    """Return the price up to which the full history buys at least as much, on average over the worlds chosen."""
    means = points[:, chosen].mean(axis=1)
    loses = means[-1] < means[others].max(axis=0) - 1e-9
    return float(PRICES[max(0, loses.argmax() - 1)] if loses.any() else PRICES[-1])


def turned(points: Any, others: slice) -> str:
    """Return that price with its bootstrap interval over worlds."""
    chance, count = np.random.default_rng(0), points.shape[1]
    drawn = [turn(points, others, chance.integers(count, size=count)) for _ in range(10_000)]
    low, high = np.quantile(drawn, (0.025, 0.975), method="nearest")
    return f"{turn(points, others):.2f} [{low:.2f}, {high:.2f}]"


def less(points: Any, price: int, other: int) -> str:
    """Return what the full history buys less what another window does, at a price in hundredths."""
    return interval(mean_estimate((points[-1, :, price] - points[other, :, price]).tolist()), "+")


def prices(rows: Sequence[Row]) -> str:
    """The prices of a cached token up to which the full history buys most, and the differences of the claims."""
    lines = []
    for game, player in CELLS:
        points = by_price(rows, game, player)
        best = int(points[NARROWER].mean(axis=1)[:, 10].argmax())
        facts = f"`{game}`", player, turned(points, NARROWER), turned(points, slice(1)), less(points, 10, 0)
        lines.append([*facts, f"{CAPS[best]:,}: {less(points, 10, best)}", less(points, 100, 0)])
    most, narrow = "all buys most up to [95 %]", "more than 450 up to"
    headings = "game", "player", most, narrow, "at 0.1, less 450", "at 0.1, less the best cap", "no cache, less 450"
    return markdown_table(headings, lines)


def table(rows: Sequence[Row]) -> str:
    """The points that the budget buys under every rule with 450 tokens, with the full history, and what buys more."""
    lines = []
    for game, player in CELLS:
        lines.append([f"`{game}`", player])
        for rule in (each.label for each in TARIFFS["money"]):
            own = [fmean(r["bought"][rule] for r in _of(rows, game, player) if r["cap"] == cap) for cap in CAPS]
            means = [f"{mean:.1f}" for mean in own]
            most = means[max(range(len(CAPS)), key=own.__getitem__)]
            shown = [f"**{mean}**" if mean == most else mean for mean in (means[0], means[-1])]
            between = "" if most in (means[0], means[-1]) else f"; {_cap(CAPS[means.index(most)])}: **{most}**"
            lines[-1].append(" / ".join(shown) + between)
    return markdown_table(("game", "player", *(each.label for each in TARIFFS["money"])), lines)


@figure
def curves(rows: Sequence[Row]) -> Figure:
    """Draw what the budget buys against the price of a cached token, with a line for each cap."""
    drawn, axes = panels(2)
    for panel, player, need in zip(axes, ("rule", "count-last-5"), ("counts all rounds", "counts five"), strict=True):
        points = by_price(rows, HANDS, player)
        for cap, means, look in zip(CAPS, points.mean(axis=1), map(Series.number, range(len(CAPS))), strict=True):
            panel.plot(PRICES, means, color=look.colour, linestyle=look.line, label=_cap(cap))
        up_to = f"all buys most up to {turn(points, NARROWER):.2f} of a token"
        panel.set(title=f"Who {need}:\n{up_to}", xlabel="price of a cached token", ylabel="points bought")
    legend_below(drawn, note=f"Rock Paper Scissors, {COST:,} uncached tokens an episode, {WORLDS} worlds")
    return drawn


def _of(rows: Sequence[Row], game: str, player: str) -> Sequence[Row]:
    return [row for row in rows if (row["game"], row["player"]) == (game, player)]


def _cap(cap: int | None) -> str:
    return "all" if cap is None else f"{cap:,}"


EXPERIMENT = Experiment(
    "window-for-a-budget",
    lambda rows: {"window-prices": prices(rows), "window-for-a-budget": table(rows)},
    lambda rows: {"window-for-a-budget": curves(rows)},
)


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__)
    parser.add_argument("--pilot", action="store_true", help="play the worlds in which the claims were found")
    asked = parser.parse_args()
    EXPERIMENT.conclude(list(play(PILOT if asked.pilot else FIRST)), publishes=asked.publish)


if __name__ == "__main__":
    main()
