"""The comparison with PyPI `crafter` is worth the mistakes that it finds: each of these, in the compiled engine."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

pytest.importorskip("numba", reason="the compiled engine is the extra rl")

from smartplay_tools.games.crafter import compiled
from smartplay_tools.games.crafter.facts import CARRIED, FURNACE
from tests.games.crafter_edits import POLICIES, Compiled, play
from tests.games.marks import COMPILED

pytestmark = COMPILED

DIAMOND = CARRIED.index("diamond")
MUTANTS = {
    "iron tools need no furnace": ("body", "if {} and not", "_NEARBY[number, material]", f"material != {FURNACE}"),
    "diamonds need no pickaxe": (
        "body",
        "if {} and not",
        "rule.tool >= 0",
        f"0 <= rule.tool and rule.item != {DIAMOND}",
    ),
    "swords are useless": ("body", "damage = {}", "_SWORDS[i, 1]", "1"),
    "a ripe plant is more food": ("body", "world.inventory[_FOOD] += {}", "4", "6"),
    "plants are ripe a step early": ("body", "if {}:", "thing.clock > RIPE", "thing.clock >= RIPE"),
    "lava only hurts": ("body", "world.inventory[_HEALTH] = {}", "0", "max(0, world.inventory[_HEALTH] - 2)"),
    "stations are near at the edge": (
        "body",
        "if {}:",
        "world.at // COLUMN == MARGIN or world.at % COLUMN == MARGIN",
        "False",
    ),
    "arrows do not break furnaces": ("others", "if {}:", "hit in (TABLE, FURNACE)", "hit == TABLE"),
    "sleepers are not hurt more": ("others", "hurt(world, {})", "7 if world.sleeping else 2", "2"),
    "cows do not eat plants": (
        "others",
        "if {}:",
        "is_creature(world.surface[thing.at + direction])",
        "world.surface[thing.at + direction] in (ZOMBIE, SKELETON)",
    ),
}
"""Name to module, where in it, the right expression, and the wrong one."""


@pytest.mark.slow
def test_every_wrong_rule_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All are compiled at once; a field of the world says which of them it follows."""
    sources = {
        source.name: source.read_text(encoding="utf-8") for source in Path(compiled.__file__).parent.glob("*.py")
    }
    replace(sources, "layout.py", '("entries", "i4"),', '("entries", "i4"), ("mutant", "i4"),')
    for number, (module, place, right, wrong) in enumerate(MUTANTS.values(), start=1):
        either = f"(({wrong}) if world.mutant == {number} else ({right}))"
        replace(sources, f"{module}.py", place.format(right), place.format(either))
    (tmp_path / "mutants").mkdir()
    for name, text in sources.items():
        (tmp_path / "mutants" / name).write_text(text.replace(compiled.__name__, "mutants"), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(importlib.import_module("mutants.entry"), "_digest", lambda: "mutants")

    class Mutant(Compiled):
        Worlds = importlib.import_module("mutants.worlds").CompiledWorlds
        follows = 0

        def __init__(self, seed: int, episode: int) -> None:
            super().__init__(seed, episode)
            self._world["mutant"] = self.follows

    play([Mutant], POLICIES, 10, 20)
    for number, name in enumerate(MUTANTS, start=1):
        Mutant.follows = number
        assert is_noticed(Mutant), f"Nobody notices that {name}."


def is_noticed(engine: type[Compiled]) -> bool:
    try:
        play([engine], POLICIES * 4, 10, 250)
    except AssertionError:
        return True
    return False


def replace(sources: dict[str, str], name: str, old: str, new: str) -> None:
    assert sources[name].count(old) == 1, old
    sources[name] = sources[name].replace(old, new)
