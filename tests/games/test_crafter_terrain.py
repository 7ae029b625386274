"""New worlds of the compiled engine: approximate noise where it decides, exact noise where it does not."""

import numpy as np
import pytest

pytest.importorskip("numba", reason="the compiled engine is the extra rl")

from smartplay_tools.games.crafter.compiled.entry import entries
from smartplay_tools.games.crafter.compiled.noise import SLACK, geometry
from smartplay_tools.games.crafter.compiled.terrain import new_terrain
from smartplay_tools.games.crafter.compiled.worlds import CompiledWorlds
from smartplay_tools.games.crafter.stream import Stream, world_seed
from smartplay_tools.games.crafter.worldgen import CELLS, FIELDS, nearness, points
from smartplay_tools.games.crafter.worlds import PlainWorlds
from tests.games.crafter_worlds import compare
from tests.games.marks import COMPILED

pytestmark = COMPILED


def begin(seeds: list[int]) -> tuple[CompiledWorlds, PlainWorlds]:
    made = CompiledWorlds(len(seeds)), PlainWorlds(len(seeds))
    for worlds in made:
        worlds.begin(np.arange(len(seeds)), seeds, [1] * len(seeds))
    return made


@pytest.mark.parametrize("seed", [0, 5, 77])
def test_what_is_compared_is_as_exact_as_promised(seed: int) -> None:
    """The errors are well below the slack, at every cell where a field matters."""
    terrain, drawn = new_terrain(), world_seed(seed, 1)
    entries().begin_terrain(CompiledWorlds(1)._records, 0, drawn, geometry(), terrain, SLACK)
    fields = dict(zip(FIELDS, terrain["fields"][0], strict=True))
    noise = dict(zip(FIELDS, points().values(Stream(drawn).below(2**31 - 1)).reshape(-1, CELLS), strict=True))
    start = nearness(noise["start"])
    water = noise["water"] + 0.15 * noise["water detail"] + 0.1 - 2 * start
    mountain = (noise["mountain"] + 0.3 * noise["mountain detail"]) / 1.3 - (4 * start + 0.3 * water)
    errors = [terrain["start"][0] - start, fields["water"] - water, fields["mountain"] - mountain]
    rock, deep, shore, land = terrain["wanted"][0] != 0
    for where, names in (
        (rock, ("horizontal tunnel", "vertical tunnel", "coal", "iron")),
        (deep, ("cave", "lava")),
        (shore, ("sand",)),
        (land, ("tree",)),
    ):
        assert where.any()
        errors += [(fields[name] - noise[name])[where] for name in names]
    assert max(np.abs(error).max() for error in errors) < SLACK / 4


@pytest.mark.parametrize("slack", [0.02, 10.0])
def test_exact_noise_makes_the_same_worlds(slack: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a larger slack, many or all cells are computed exactly."""
    monkeypatch.setattr("smartplay_tools.games.crafter.compiled.worlds.SLACK", slack)
    compiled, plain = begin([3, 4, 5])
    for number in range(3):
        compare(compiled, plain, number)


def test_noise_on_a_threshold_is_computed_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise is about 0 on the lattice, which decides about coal and trees there: no approximation can."""
    monkeypatch.setattr("smartplay_tools.games.crafter.compiled.worlds.SLACK", 0.0)
    compiled, plain = begin(list(range(10)))
    assert any(compiled.fingerprint(number) != plain.fingerprint(number) for number in range(10))
    monkeypatch.undo()
    compiled, plain = begin(list(range(10)))
    for number in range(10):
        compare(compiled, plain, number)


def test_a_thousand_worlds_are_the_same() -> None:
    for first in range(1000, 2000, 100):
        compiled, plain = begin(list(range(first, first + 100)))
        for number in range(100):
            compare(compiled, plain, number)
