"""A digest of the worlds of every setting: what its seeds draw at a reset and in the steps after it.

`python -m tests.worlds` writes `tests/data/worlds.json`. A line that changes there is another game for every seed,
whose results cannot be compared with earlier ones; CHANGELOG.md has to say so.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import smartplay_tools as sp

FILE = Path(__file__).parent / "data" / "worlds.json"
STEPS = 12
"""Steps in each world, which take the actions of the setting in turn."""

WORLDS = {"crafter": (20,), "minecraft": (2, 20)}
"""How many seeds a digest is of, by family, where worlds take long to make; others have `MANY`."""

MANY = (200,)


def digest(setting: str, seeds: int) -> str:
    """Return the digest of everything that the first seeds of a setting show, in text and in state."""
    game, shown = sp.GAMES[setting].make(), hashlib.sha256()
    try:
        for seed in range(seeds):
            seen = [game.reset(seed=seed)[0], game.state_hash()]
            for step in range(STEPS):
                text, reward, over, cut, info = game.step((seed + step) % len(game.actions))
                seen += [text, repr(float(reward)), info["score"]]
                if over or cut:
                    break
            shown.update(json.dumps([*seen, game.state_hash()]).encode("ascii"))
    finally:
        game.close()
    return shown.hexdigest()


def cases() -> list[tuple[str, int]]:
    """Return every setting with the numbers of seeds that its digests are of."""
    return [(name, seeds) for name, spec in sp.GAMES.items() for seeds in WORLDS.get(spec.family, MANY)]


if __name__ == "__main__":
    pinned: dict[str, dict[str, str]] = {}
    for setting, seeds in cases():
        pinned.setdefault(setting, {})[str(seeds)] = digest(setting, seeds)
    FILE.write_text(json.dumps(pinned, indent=1) + "\n", encoding="ascii")
