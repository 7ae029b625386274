"""The smallest caps on prompts at which a sweep measures context alone: the table of `docs/experiments.md`.

    python experiments/caps.py             # the paper's settings and two larger ones; a minute
    python experiments/caps.py --publish   # the same, and rows and table go into the checkout

`result_tokens` is "auto" by default: a small `prompt_tokens` also caps every tool result, so below some cap a player
sees less not only of its past but also of the present. For every game the longest observation in episodes of the
players `random` and `rule` without a cap is found, and then the smallest cap that does not cut it; the same for the
manual.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from page_tables import Experiment, arguments, markdown_table

import smartplay_tools as sp
from smartplay_tools.context.tokens import get_tokenizer
from smartplay_tools.games.paper_tables import PAPER_SETTINGS
from smartplay_tools.records import Record
from smartplay_tools.records.rows import Row
from smartplay_tools.types.groups import grouped

GAMES = (*PAPER_SETTINGS, "Hanoi4Disk-v0", "MessengerL3-v0")
PLAYERS = ("random", "rule")
SEEDS = 3
CALLS = 500
"""The most tool calls of an episode; longer games do not have longer observations later."""
LARGEST = 100_000


def play() -> Iterator[Row]:
    """Yield a row for every episode: the tokens of the longest result of an action or an observation."""
    count = get_tokenizer().count
    for game in GAMES:
        for player in PLAYERS:
            for seed in range(SEEDS):
                events: list[dict[str, object]] = []
                with sp.Episode(game, seed=seed, budget=sp.Budget(tool_calls=CALLS), transcript=events) as episode:
                    sp.play(episode, sp.get_player(player, seed=seed))
                texts = {call["text"] for call in Record(events).calls if call["name"] != "read_manual"}
                yield {"game": game, "player": player, "seed": seed, "longest": max(map(count, texts))}


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


def table(rows: Sequence[Row]) -> str:
    """The longest observation of every game, and the caps from which on neither it nor the manual is cut."""
    lines = []
    for game, own in grouped(rows, lambda row: row["game"]).items():
        longest = max(row["longest"] for row in own)
        with sp.Episode(game, seed=0) as episode:
            manual = get_tokenizer().count(episode.call("read_manual").text)
        caps = smallest_cap(game, result=longest), smallest_cap(game, manual=manual)
        lines.append((f"`{game}`", *(f"{tokens:,}" for tokens in (longest, *caps))))
    return markdown_table(("game", "longest observation", "observations whole from", "manual whole from"), lines)


EXPERIMENT = Experiment("caps", lambda rows: {"caps": table(rows)})


def main() -> None:
    """Play, and print or publish the table."""
    EXPERIMENT.conclude(play(), publishes=arguments(__doc__).parse_args().publish)


if __name__ == "__main__":
    main()
