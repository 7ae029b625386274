"""Random episodes, each prompt compared: `python -m tests.model_from_docs --prompts 100000 --seed 0`."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import smartplay_tools as sp

from .carrying import play_chains
from .play import SMALL, Counts, play, replay_is_identical

GAMES = (*SMALL * 12, *sp.GAMES)


def main() -> None:
    """Play until enough prompts are compared, and print what was; the first that differs is an AssertionError."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prompts", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--replay-every", type=int, default=20, help="replay the record of one episode in N")
    parser.add_argument("--games", nargs="+", default=GAMES)
    parser.add_argument("--chains-every", type=int, default=20, help="play chains of trials once for N episodes")
    given = parser.parse_args()
    counts, seed, replayed, carried = Counts(), given.seed, 0, 0
    while counts.prompts < given.prompts:
        record = play(seed, counts, given.games)
        if record and record[0]["config"]["game"] in sp.GAMES and seed % given.replay_every == 0:
            assert replay_is_identical(record), f"the record of seed {seed} does not replay"
            replayed += 1
        if seed % given.chains_every == 0:
            with tempfile.TemporaryDirectory() as out:
                carried += play_chains(seed, Path(out) / "run")
        seed += 1
    print(
        f"seeds {given.seed} to {seed - 1}: {counts}, {replayed} records replayed, "
        f"{carried} trials that carry, 0 violations"
    )


if __name__ == "__main__":
    main()
