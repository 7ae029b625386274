"""The smallest caps on prompts at which a sweep measures context alone: the table of `docs/experiments.md`.

    python experiments/caps.py             # the paper's settings and two larger ones; about two minutes
    python experiments/caps.py --publish   # the same, and the table goes into the page

`result_tokens` is "auto" by default: a small `prompt_tokens` also caps every tool result, so below some cap a player
sees less not only of its past but also of the present. For every game the longest observation in episodes of the
players `random` and `rule` without a cap is found, and then the smallest cap that does not cut it; the same for the
manual. The table also has the share of results that are cut under smaller caps.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from page_tables import show

import smartplay_tools as sp
from smartplay_tools.context.tokens import get_tokenizer
from smartplay_tools.games import PAPER_RESULTS
from smartplay_tools.records import Record

PAGE = Path(__file__).parents[1] / "docs" / "experiments.md"
GAMES = (*PAPER_RESULTS[0].raw, "Hanoi4Disk-v0", "MessengerL3-v0")
PLAYERS = ("random", "rule")
CAPS = (500, 1000, 2000)
CALLS = 500
"""The most tool calls of an episode; longer games do not have longer observations later."""
LARGEST = 100_000


def main() -> None:
    """Measure every game, print the table, and put it into the page."""
    parser = argparse.ArgumentParser(
        description="The smallest caps on prompts at which a sweep measures context alone."
    )
    parser.add_argument("--seeds", type=int, default=5, help="episodes of every player")
    parser.add_argument("--publish", action="store_true", help="put the table into the documentation")
    asked = parser.parse_args()
    show(PAGE, "caps", "\n".join(_table(asked.seeds)), publishes=asked.publish)


def _table(seeds: int) -> Iterator[str]:
    heads = ["game", "longest observation", "observations whole from", "manual whole from"]
    heads += [f"cut at {cap:,}" for cap in CAPS]
    yield f"| {' | '.join(heads)} |"
    yield f"| --- |{' ---: |' * (len(heads) - 1)}"
    for game in GAMES:
        observation, manual = longest(game, seeds)
        enough, enough_for_manual = smallest_cap(game, result=observation), smallest_cap(game, manual=manual)
        # At the cap that was found, only the manual may be cut.
        assert not any(cut for name, cut in results(game, seeds, enough) if name != "read_manual"), game
        shares = [_share(game, seeds, cap) for cap in CAPS]
        numbers = [f"{observation:,}", f"**{enough:,}**", f"{enough_for_manual:,}", *shares]
        yield f"| `{game}` | {' | '.join(numbers)} |"


def longest(game: str, seeds: int) -> tuple[int, int]:
    """Return the tokens of the longest result of an action or an observation, and of the manual."""
    count = get_tokenizer().count
    texts = {text for text, _ in _texts(game, seeds, None)}
    with sp.Episode(game, seed=0) as episode:
        manual = count(episode.call("read_manual").text)
    return max(map(count, texts)), manual


def results(game: str, seeds: int, cap: int) -> Iterator[tuple[str, bool]]:
    """Yield the name of every call under a cap, and whether its result was cut."""
    for player in PLAYERS:
        for seed in range(seeds):
            for event in _calls(game, player, seed, cap):
                yield event["name"], bool(re.search(r"\[\d+ tokens cut\]", event["text"])) or not event["text"]


def smallest_cap(game: str, *, result: int = 0, manual: int = 0) -> int:
    """Return the smallest `prompt_tokens` under which results and the manual may be that long."""

    def is_enough(cap: int) -> bool:
        try:
            with sp.Episode(game, seed=0, budget=sp.Budget(prompt_tokens=cap)) as episode:
                return (episode.budget.result_tokens or 0) >= result and (episode.budget.manual_tokens or 0) >= manual
        except sp.InvalidArgumentError:
            return False  # it does not even hold the head

    low, high = 1, LARGEST
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle + 1, high)
    return low


def _share(game: str, seeds: int, cap: int) -> str:
    try:
        cuts = [cut for _, cut in results(game, seeds, cap)]
    except sp.InvalidArgumentError:
        return "head too long"
    return f"{sum(cuts) / len(cuts):.0%}"


def _texts(game: str, seeds: int, cap: int | None) -> Iterator[tuple[str, str]]:
    for player in PLAYERS:
        for seed in range(seeds):
            for event in _calls(game, player, seed, cap):
                if event["name"] != "read_manual":
                    yield event["text"], event["name"]


def _calls(game: str, player: str, seed: int, cap: int | None) -> Iterator[Mapping[str, Any]]:
    budget = sp.Budget(prompt_tokens=cap, tool_calls=CALLS)
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "record.jsonl"
        with sp.Episode(game, seed=seed, budget=budget, transcript=record) as episode:
            sp.play(episode, sp.get_player(player, seed=seed))
        yield from Record.read(record).calls


if __name__ == "__main__":
    main()
