"""The contract test of strategies: what prompts, records and replays rely on, for everybody who adds one.

`check_strategy` plays random hostile episodes under a strategy, here and in another process, and raises an
`AssertionError` that says what the strategy does wrong. With pytest:

    from smartplay_tools.testing import check_strategy

    def test_the_contract():
        check_strategy("first_and_newest.py:FirstAndNewest")

Every strategy of this package is held to the same checks. Nothing here needs pytest.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence

from smartplay_tools.context.strategies.choices import Choice, Past, Strategy
from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.episode.episode import Episode
from smartplay_tools.players.prompt_reading import call
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.records.replays import replay
from smartplay_tools.records.resumption import resume
from smartplay_tools.streams import keep_streams, own_output
from smartplay_tools.testing.hostile import hostile_episode, require
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import Budget

__all__ = ["check_strategy"]

EARLY, LATE = slice(60, 120), slice(260, 320)
"""The turns of which it is compared how much of the past a strategy reads, at most: one that lets turns go in batches
reads little at one turn and much at another."""


def check_strategy(strategy: str | Budget, *, episodes: int = 200, seconds: float = 600) -> None:
    """Hold a strategy to its contract; raise an `AssertionError` that says what it does wrong.

    No prompt is over its cap, every turn is whole, the newest observation is visible and none is too old; the same
    episode is played alike again, from the middle of its record, and in another process; every prompt is rebuilt from
    the record; and a choice reads no more of a long past than of a short one, unless the class has
    `reads_everything = True`. A compactor may forget what it wants: its prompts need not show the newest observation.

    Arguments:
        strategy: the name of a strategy, as `Budget.strategy` takes it, or a budget with strategies of the window.
        episodes: the number of random episodes.
        seconds: how long they may take in the other process, which is then ended: a strategy can block.
    """
    budget = strategy if isinstance(strategy, Budget) else Budget(strategy=strategy)
    elsewhere = _digests_elsewhere(budget, episodes, seconds)
    here = digests(budget, episodes)
    differs = next((number for number, pair in enumerate(zip(here, elsewhere, strict=True)) if len({*pair}) > 1), None)
    require(
        differs is None,
        f"episode {differs} is played differently in another process: is the order of a set, a clock or an id used?",
    )
    check_reading(budget)


def digests(budget: Budget, episodes: int) -> list[str]:
    """Play and check the episodes; return a digest of the record of each."""
    chains: list[str] = []
    for number in range(episodes):
        events = hostile_episode(budget, number)
        _check_record(events)
        chains.append(str(events[-1]["chain"]))
    return chains


def _check_record(events: Sequence[Event]) -> None:
    """Require that a record is replayed, resumed and rebuilt."""
    replayed = replay(events, calls_compactor=True)
    require(replayed.identical, f"the same episode is not played alike again: {''.join(replayed.differences[:1])}")
    for sent in sent_prompts(events):
        require(sent.sha256 == sent.recorded_sha256, f"the prompt of turn {sent.turn} is not rebuilt from the record")
    with resume(events[: 1 + len(events) // 2], transcript=[]) as resumed:
        require(resumed.conversation is not None, "the record has no conversation that could be continued")


class _Reads:
    """A strategy that counts how much of the past another one reads."""

    def __init__(self, strategy: Strategy) -> None:
        self._strategy = strategy
        self.counts: list[int] = []

    def choose(self, past: Past, room: int | None) -> Choice:
        before = past.turns.reads  # type: ignore[attr-defined]  # of the package's own sequence
        choice = self._strategy.choose(past, room)
        choice = Choice(tuple(choice.turns), tuple(choice.masked), dict(choice.texts))
        self.counts.append(past.turns.reads - before)  # type: ignore[attr-defined]
        return choice


def check_reading(budget: Budget) -> None:
    """Require that a choice after many turns reads no more of them than one after fewer, unless that is declared."""
    if budget.strategy is None:
        return
    limits = {"prompt_tokens": 900, "tool_calls": None, "stalled_turns": None}
    long = budget.model_copy(update=limits)
    with Episode("RockPaperScissorBasic-v0", seed=1, budget=long) as episode:
        custom = episode.ledger.strategies.custom
        if not isinstance(custom, Strategy):
            return  # a compactor is given all that it has kept
        episode.ledger.strategies.custom = counting = _Reads(custom)
        conversation = Conversation(episode)
        while episode.result is None and len(counting.counts) < LATE.stop:
            conversation.receive(call("observe"))
            conversation.prompt()
    require(episode.end_reason != "strategy_error", f"{episode.result and episode.result.error}")
    if getattr(custom, "reads_everything", False):
        return
    early, late = max(counting.counts[EARLY]), max(counting.counts[LATE])
    require(
        late <= early,
        f"a choice reads up to {late} turns after {LATE.start} of them and up to {early} after {EARLY.start}: it gets "
        "slower with every turn; read no more than is shown, or declare reads_everything = True",
    )


def _digests_elsewhere(budget: Budget, episodes: int, seconds: float) -> list[str]:
    """Return the digests of the same episodes from another process, where sets and dictionaries hash differently."""
    hash_seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    asked = [budget.model_dump_json(exclude_unset=True), str(episodes)]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "smartplay_tools.testing.strategy_checks", *asked],
            env=environment, capture_output=True, text=True, timeout=seconds, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise AssertionError(f"{episodes} episodes took more than {seconds:g} seconds: the strategy blocks.") from None
    if done.returncode != 0:
        raise AssertionError(done.stderr.strip().splitlines()[-1].partition(": ")[2])
    answer: list[str] = json.loads(done.stdout)
    return answer


if __name__ == "__main__":
    with keep_streams():
        print(json.dumps(digests(Budget(**json.loads(sys.argv[1])), int(sys.argv[2]))), file=own_output())
