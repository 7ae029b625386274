"""The places that the MESSENGER rule player infers, and its model of movements."""

from __future__ import annotations

import numpy as np
import pytest

from smartplay_tools.games.messenger.rules import LAST, MOVEMENTS, choices
from smartplay_tools.players.rules.messenger import player as messenger
from smartplay_tools.players.rules.messenger.belief import ENEMY, believe
from smartplay_tools.players.rules.messenger.board import (
    CELLS,
    CHASER,
    FLEEING,
    IMMOVABLE,
    PLACES,
    WIDTH,
    Floats,
    SeenEntities,
    board,
)
from smartplay_tools.players.rules.messenger.casts import Part
from smartplay_tools.players.rules.messenger.manual import Claim

LINES = "You took action {}.\n\nYou (agent) don't have the message.\n\nYou see:\n- {}"


@pytest.mark.parametrize(
    ("observations", "movement"),
    [
        (["dog 6 steps to your north", "dog 5 steps to your north", "dog 5 steps to your north"], CHASER),
        (["dog 6 steps to your north", "dog 6 steps to your north", "dog 6 steps to your north"], IMMOVABLE),
        (["dog 5 steps to your north", "dog 5 steps to your north", "dog 6 steps to your north"], FLEEING),
    ],
)
def test_it_tells_movements_apart_by_what_it_sees(observations: list[str], movement: int) -> None:
    views = [SeenEntities.of(LINES.format("Do Nothing", line)) for line in observations]
    possible = tuple((1 / 3, {"dog": (Part("enemy", movement),)}) for movement in range(len(MOVEMENTS)))
    cases = believe(possible, views)
    assert cases is not None
    assert np.bincount(cases.movements[ENEMY]).argmax() == movement


def test_what_cannot_be_is_not_believed() -> None:
    lines = ("dog 4 steps to your east", "dog 9 steps to your west")
    views = [SeenEntities.of(LINES.format("Do Nothing", line)) for line in lines]
    assert believe(((1.0, {"dog": (Part("enemy", IMMOVABLE),)}),), views) is None
    assert messenger.choose((Claim("dog", "enemy", "immovable"),), views), "and then the older view is forgotten"


MOVERS_AND_PLACES = [
    (movement, cell, place)
    for movement in (CHASER, FLEEING)
    for cell in ((0, 0), (4, 7), (9, 5))
    for place in ((0, 0), (3, 14), (18, 10), (8, 18), (18, 18), (9, 14), (11, 10))
]


def by_the_rules(movement: int, cell: tuple[int, int], place: tuple[int, int]) -> dict[tuple[int, int], float]:
    """The places to which the game's own rules move a thing in a tick, with probabilities."""
    ways = choices(MOVEMENTS[movement], place, (2 * cell[0], 2 * cell[1]))
    after: dict[tuple[int, int], float] = {}
    for dx, dy in ways:
        to = (place[0] + dx, place[1] + dy)
        to = to if min(to) >= 0 and max(to) <= LAST else place
        after[to] = after.get(to, 0) + 1 / len(ways)
    return after


@pytest.mark.parametrize(("movement", "cell", "place"), MOVERS_AND_PLACES)
def test_things_are_believed_to_move_as_they_do(movement: int, cell: tuple[int, int], place: tuple[int, int]) -> None:
    belief: Floats = np.zeros((1, PLACES), dtype=np.float32)
    belief[0, WIDTH * place[0] + place[1]] = 1
    moved = board().advance(belief, movement, np.array([CELLS * cell[0] + cell[1]]))[0]
    believed = {divmod(int(to), WIDTH): float(moved[to]) for to in np.flatnonzero(moved)}
    assert believed == pytest.approx(by_the_rules(movement, cell, place))
