"""The estimate of a run's calls, tokens and cost, before it is played.

For every cell a few episodes are played offline, under the cell's own budget, on the seeds of its first trials. A free
player plays them itself. In place of a model, the players `rule` and `random` play them, with replies padded to the
assumed length of the model's, because replies are part of later prompts. The length of an episode depends on how well
it is played, so every estimate is a range: from the shortest of these episodes to one that lasts as long as the game
and the budget allow, with a tenth more calls for observing and mistakes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from statistics import fmean
from typing import Any

from smartplay_tools.context.strategies.ageing import turns_leave
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.conversation.loop import AttachedPlayer, new_conversation, play
from smartplay_tools.costs.cached import marks_of
from smartplay_tools.episode.budgets import resolve
from smartplay_tools.episode.cells import most_calls
from smartplay_tools.episode.config import CellConfig
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.costs.charges import charge
from smartplay_tools.evaluation.runs.plan import Plan, PlannedEpisode, player_of
from smartplay_tools.players import PLAYERS, get_player, is_model
from smartplay_tools.players.player_registry import without_second
from smartplay_tools.providers.caches import cache_rules, rule_of
from smartplay_tools.providers.cost_rules import NO_CACHE, cost_rule
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.record import Record
from smartplay_tools.records.requests import requests_of
from smartplay_tools.records.rows import Row
from smartplay_tools.records.spent import Spent
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import Player, Prompt, Reply, Usage
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.messages import assistant_message, text_of

SAMPLED_TRIALS = 3
"""Episodes of a cell that a free player plays; each player that replaces a model plays two, with the shortest and the
longest replies."""

SAMPLED_CALLS = 400
"""The most calls of an episode that are played; longer episodes are extrapolated from the later prompts."""

ASSUMED_REPLY_TOKENS = 150
"""Default tokens of a model's reply: some sentences and a tool call. The range is from half to twice of it."""

STAND_INS = {"text": ("rule", "random"), "picture": ("random",), "both": ("rule", "random")}
"""The players in place of a model, by the form of observations: no rules read the pictures of every game and size."""
FREE = frozenset(name for name, place in PLAYERS.items() if place.startswith("smartplay_tools.")) - {"human"}
"""Players that cost nothing, so that they can play in an estimate."""

LOOKS_AND_MISTAKES = 1.1
"""Calls of the longest episode, as a multiple of its steps."""

MARGIN = 0.05
"""The uncertainty of the samples, as a share that is added at both ends of a range."""


@dataclass(frozen=True)
class Range:
    """The range in which a value is expected."""

    low: float
    expected: float
    high: float

    def __add__(self, other: Range) -> Range:
        return Range(self.low + other.low, self.expected + other.expected, self.high + other.high)

    def __mul__(self, factor: float) -> Range:
        return Range(self.low * factor, self.expected * factor, self.high * factor)


ADDED = ("episodes", "calls", "prompt_tokens", "reply_tokens")
"""The figures of estimates that add up whatever their prices are."""


@dataclass(frozen=True)
class Estimate:
    """The expected use of a cell's episodes."""

    cell: CellConfig
    episodes: int
    calls: Range
    """Calls to the player."""
    prompt_tokens: Range
    reply_tokens: Range
    cost: Range | None
    """US dollars: from the cache hits of the samples, to no hits and everything written to the provider's cache. None
    if the price of the player's model is not known."""
    cut_share: float = 0.0
    """The share of tool results that were cut to `result_tokens` in the samples."""
    reply_length: tuple[int, int] | None = None
    """The assumed tokens of a reply; None if the player itself has played."""

    def __add__(self, other: Estimate) -> Estimate:
        """Return what both take together, as an estimate of the first one's cell."""
        sums: dict[str, Any] = {name: getattr(self, name) + getattr(other, name) for name in ADDED}
        cost = None if self.cost is None or other.cost is None else self.cost + other.cost
        return replace(self, **sums, cost=cost)


@dataclass(frozen=True)
class _Sample:
    """An episode that was played offline."""

    prompts: tuple[int, ...]
    """Tokens of its prompts, in order, those for summaries included."""
    replies: tuple[int, ...]
    summaries: int
    """How many of the prompts asked for a summary: they are calls that no turn of the game needs."""
    hit: float
    """The share of prompt tokens that the provider's cache serves."""
    written: float
    """The share that is written to it and billed."""
    rates: tuple[float, float]
    """What a token of a prompt and one of a reply cost by the rule of a budget in money."""
    is_over: bool
    cut: int
    results: int


def estimate(plan: Plan, prices: Mapping[str, Price], *, reply_tokens: int | None = None) -> list[Estimate]:
    """Return an estimate for every cell of a plan; `reply_tokens` is the assumed length of a model's reply."""
    if reply_tokens is not None and reply_tokens < 1:
        raise InvalidArgumentError(f"The assumed tokens of a reply must be at least 1, not {reply_tokens}.")
    return [
        estimate_cell(members[0].cell, [e.seed for e in members], prices.get(player_of(members[0].cell)), reply_tokens)
        for members in grouped(plan.episodes, lambda episode: episode.place).values()
    ]


def estimate_cell(
    cell: CellConfig, seeds: Sequence[int], price: Price | None, reply_tokens: int | None = None
) -> Estimate:
    """Return an estimate for a cell's episodes with these seeds."""
    is_free = player_of(cell).partition(":")[0] in FREE
    lengths = None if is_free else _reply_lengths(cell, reply_tokens)
    if lengths is None:
        samples = [_sample(cell, seed, player_of(cell), 0) for seed in seeds[:SAMPLED_TRIALS]]
    else:
        pairs = [(name, length) for name in STAND_INS[cell.observation] for length in sorted(set(lengths))]
        samples = [_sample(cell, seeds[at % len(seeds)], *pair) for at, pair in enumerate(pairs)]
    ends = [_extended(sample, cell, most) for sample in samples for most in ([] if is_free else [_most_calls(cell)])]
    whole = [_extended(sample, cell, None if sample.is_over else _most_calls(cell)) for sample in samples]
    every = [*whole, *ends]
    per_episode = {
        "calls": _range(every, whole, lambda sample: len(sample.prompts)),
        "prompt_tokens": _range(every, whole, lambda sample: sum(sample.prompts)),
        "reply_tokens": _range(every, whole, lambda sample: sum(sample.replies)),
    }
    figures = {name: figure * len(seeds) for name, figure in per_episode.items()}
    cut, results = sum(sample.cut for sample in samples), sum(sample.results for sample in samples)
    return Estimate(
        cell,
        len(seeds),
        **figures,
        cost=Range(0, 0, 0)
        if not is_model(player_of(cell)) and price is None
        else _cost(every, whole, price, len(seeds)),
        cut_share=cut / results if results else 0.0,
        reply_length=lengths,
    )


def _reply_lengths(cell: CellConfig, asked: int | None) -> tuple[int, int]:
    cap = cell.budget.reply_tokens or math.inf
    low, high = (asked, asked) if asked is not None else (ASSUMED_REPLY_TOKENS // 2, ASSUMED_REPLY_TOKENS * 2)
    return int(min(low, cap)), int(min(high, cap))


def _most_calls(cell: CellConfig) -> int:
    """Calls of the longest episode: one per step (two in the paper's protocol), the manual, observing and mistakes."""
    if cell.protocol == "paper":
        return most_calls(cell)
    most = math.ceil(most_calls(cell) * LOOKS_AND_MISTAKES)
    cap = resolve(cell.budget, cell.spec, 0).tool_calls
    return most if cap is None else min(most, cap)


def _range(every: Sequence[_Sample], whole: Sequence[_Sample], figure: Any) -> Range:
    """The range from the smallest to the largest of all samples; the expected value is the mean of the played ones."""
    values = [figure(sample) for sample in every]
    return Range(min(values) * (1 - MARGIN), fmean(figure(sample) for sample in whole), max(values) * (1 + MARGIN))


def _cost(every: Sequence[_Sample], whole: Sequence[_Sample], price: Price | None, episodes: int) -> Range | None:
    if price is None:
        return None

    def likely(sample: _Sample) -> float:
        prompt, reply = round(fmean(sample.prompts)), round(fmean(sample.replies))
        hit, written = math.floor(prompt * sample.hit), math.floor(prompt * sample.written)
        return len(sample.prompts) * price.cost(Usage(prompt=prompt, reply=reply, cached=hit, written=written))

    def most(sample: _Sample) -> float:
        return len(sample.prompts) * price.most(round(fmean(sample.prompts)), round(fmean(sample.replies)))

    low, high = min(map(likely, every)) * (1 - MARGIN), max(map(most, every)) * (1 + MARGIN)
    return Range(low, fmean(map(likely, whole)), high) * episodes


def _sample(cell: CellConfig, seed: int, name: str, reply_tokens: int) -> _Sample:
    """Play an episode's first calls."""
    prompts: list[int] = []
    replies: list[int] = []
    events: list[Event] = []
    # The first engine of a game needs no server.
    engine = next(iter(cell.spec.load().engines), None)
    config = cell.model_copy(update={"engine": engine}).with_seed(seed)
    with Episode.from_config(config, transcript=events) as episode:

        def before(conversation: BaseConversation, prompt: Prompt) -> None:
            assert conversation.view is not None
            if len(prompts) == SAMPLED_CALLS:
                episode.close()
                return
            if len(replies) < len(prompts):  # the reply to a prompt for a summary ends no turn
                after(conversation)
            prompts.append(conversation.view.tokens)

        def after(conversation: BaseConversation) -> None:
            replies.append(episode.stats.tokens.reply - sum(replies))

        player = _player(cell, name, seed)
        assert isinstance(player, Player)
        wordy = player if not reply_tokens else _Wordy(player, reply_tokens, episode.counter)
        play(new_conversation(episode, name, cell.protocol), wordy, on_prompt=before, on_turn=after)
        stats = episode.stats
        is_over = episode.end_reason != "closed"
        cut = stats.cut_results
    hit, written = _cached(cell, Record(events))
    reply = cost_rule(cell.budget.cost_rule or NO_CACHE).output
    rates = (stats.spent_cost - reply * sum(replies)) / max(1, sum(prompts[: len(replies)])), reply
    return _Sample(tuple(prompts), tuple(replies), stats.summaries, hit, written, rates, is_over, cut, stats.tool_calls)


def _cached(cell: CellConfig, record: Record) -> tuple[float, float]:
    """The shares of prompt tokens that are read and written by the rule of the player's model.

    If that is not known, everything that is unchanged since the prompt before is read.
    """
    rule = rule_of(player_of(cell), cell.player_options, cache_rules())
    prompt = sum(usage["prompt"] for usage in record.usages)
    if rule is None or not prompt:
        return sum(usage["prefix"] for usage in record.usages) / max(1, prompt), 0.0
    charged = charge(requests_of(record), rule, marks=marks_of(cell.player_options))
    return charged.hit / prompt, charged.written / prompt


def _player(cell: CellConfig, name: str, seed: int) -> Any:
    """The player that plays the sample; without the cell's options if they are for a function of the user's."""
    try:
        return get_player(name, seed=seed, **(without_second(cell.player_options) if name == player_of(cell) else {}))
    except InvalidArgumentError:
        return get_player(name, seed=seed)


class _Wordy:
    """A player whose replies are padded to a length."""

    def __init__(self, player: Player, tokens: int, counter: TokenCounter) -> None:
        self.name, self._player, self._tokens, self._counter = player.name, player, tokens, counter
        self.observations: Sequence[str] = getattr(player, "observations", ("text",))
        if isinstance(player, AttachedPlayer):
            self.attach = player.attach

    def reply(self, prompt: Prompt) -> Reply:
        """Return the player's reply, padded with words to its length."""
        message = assistant_message(self._player.reply(prompt).message)
        tokens = self._tokens if prompt.max_tokens is None else min(self._tokens, prompt.max_tokens)
        missing = tokens - self._counter.message(message)
        if missing > 0:
            message["content"] = text_of(message) + " so" * missing
        return Reply(message)


def _extended(sample: _Sample, cell: CellConfig, calls: int | None) -> _Sample:
    """Return a sample extrapolated to `calls` prompts to play, plus its share of prompts for summaries.

    The budget of the episode may allow fewer.
    """
    prompts, replies = list(sample.prompts), list(sample.replies)
    replies += [round(fmean(replies))] * (len(prompts) - len(replies)) if replies else [0] * len(prompts)
    missing = math.ceil((calls or 0) * len(prompts) / max(1, len(prompts) - sample.summaries)) - len(prompts)
    if missing > 0:
        later = prompts[len(prompts) // 2 :]
        budget = resolve(cell.budget, cell.spec, 0)
        grows = cell.protocol == "tools" and not turns_leave(budget, budget.history)
        slope = (later[-1] - later[0]) / max(1, len(later) - 1) if grows else 0.0
        first = later[-1] if grows else fmean(later)
        prompts += [round(first + slope * at) for at in range(1, missing + 1)]
        replies += [round(fmean(replies))] * missing
    caps = (cell.budget.episode_tokens, (1, 1)), (cell.budget.episode_cost, sample.rates)
    for cap, (prompt, reply) in caps:
        spent = accumulate(asked * prompt + said * reply for asked, said in zip(prompts, replies, strict=True))
        fits = len(prompts) if cap is None else max(1, sum(each <= cap for each in spent))
        prompts, replies = prompts[:fits], replies[:fits]
    return replace(sample, prompts=tuple(prompts), replies=tuple(replies))


class Expectations:
    """The expected use of episodes, so that an episode of a run begins only if it fits under the caps.

    It is the mean of the cell's finished episodes or, before there is one, the estimate.
    """

    def __init__(self, plan: Plan, rows: Iterable[Row], prices: Mapping[str, Price]) -> None:
        self._prices = prices
        self._places = {episode.key: episode.place for episode in plan.episodes}
        self._estimates: dict[int, tuple[float, float]] = {}
        self._finished: dict[int, list[tuple[float, float]]] = {}
        self._begun: dict[str, tuple[float, float]] = {}
        for row in rows:
            self.finished(row)

    def of(self, episode: PlannedEpisode) -> tuple[float, float]:
        """Return the budget tokens and US dollars that the rest of an episode is expected to take."""
        if finished := self._finished.get(episode.place):
            expected = fmean(tokens for tokens, _ in finished), fmean(cost for _, cost in finished)
        else:
            expected = self._estimated(episode)
        begun = self._begun.get(episode.key, (0.0, 0.0))
        return max(0.0, expected[0] - begun[0]), max(0.0, expected[1] - begun[1])

    def finished(self, row: Row) -> None:
        """Take account of a finished episode."""
        tokens = row["tokens"]["prompt"] + row["tokens"]["reply"]
        self._finished.setdefault(self._places[row["key"]], []).append((tokens, row["cost"] or 0.0))

    def attempted(self, episode: PlannedEpisode, spent: Spent) -> None:
        """Take account of the part of an episode that an attempt has played and the next one continues."""
        tokens, cost = self._begun.get(episode.key, (0.0, 0.0))
        self._begun[episode.key] = tokens + spent.tokens, cost + (spent.cost or 0.0)

    def _estimated(self, episode: PlannedEpisode) -> tuple[float, float]:
        if episode.place not in self._estimates:
            price = self._prices.get(player_of(episode.cell))
            estimated = estimate_cell(episode.cell, [episode.seed], price)
            cost = 0.0 if estimated.cost is None else estimated.cost.expected
            self._estimates[episode.place] = estimated.prompt_tokens.expected + estimated.reply_tokens.expected, cost
        return self._estimates[episode.place]
