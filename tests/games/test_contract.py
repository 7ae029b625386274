"""The contract of all games. A setting is tested as soon as it is listed in GAMES.

The promises are those of `smartplay_tools.testing`, which everybody who adds a game runs, too.
"""

from __future__ import annotations

import contextlib
import functools
import pickle
import re
from collections.abc import Callable
from typing import Any

import gymnasium
import pytest
from hypothesis import given, settings, strategies as st

import smartplay_tools as sp
from smartplay_tools.games.base import TextGame
from smartplay_tools.testing import CHECKS, check_game, plays_to_its_end
from smartplay_tools.testing.game_checks import (
    is_played_and_replayed_through_its_tools,
    is_the_same_in_another_process,
    refuses_a_step_after_its_own_end,
    scores_within_its_bounds,
)

FIRST = {spec.family: name for name, spec in reversed(list(sp.GAMES.items()))}.values()
"""The first setting of each family."""
IN_THIS_PROCESS = [check for check in CHECKS if check is not is_the_same_in_another_process]
"""The checks that start no process."""


def takes_long(name: str, check: Callable[[str], None]) -> bool:
    """Worlds of Minecraft, and other processes, take long to make, so `make test` has one of them."""
    if check is is_the_same_in_another_process:
        return name != "Hanoi3Disk-v0"
    whole_episodes = (
        is_played_and_replayed_through_its_tools,
        refuses_a_step_after_its_own_end,
        scores_within_its_bounds,
    )
    return sp.GAMES[name].family == "minecraft" and (name not in FIRST or check in whole_episodes)


@pytest.mark.parametrize(
    ("game", "check"),
    [
        pytest.param(name, check, marks=[pytest.mark.slow] * takes_long(name, check), id=f"{name}-{check.__name__}")
        for name in sp.GAMES
        for check in CHECKS
    ],
)
def test_it_keeps_the_contract(game, check):
    check(game)


def test_which_games_have_no_end_of_their_own():
    """They need not refuse steps after it."""
    families = {spec.family: spec for spec in sp.GAMES.values() if spec.family != "minecraft"}
    endless = set()
    for family, spec in families.items():
        game = spec.make()
        game.reset(seed=5)
        if not plays_to_its_end(game):
            endless.add(family)
    assert endless == {"bandit", "rock_paper_scissors"}


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.binary(max_size=5),
    st.lists(st.nothing()),
)


@settings(max_examples=settings().max_examples // 6, deadline=None)
@given(st.lists(ANYTHING | st.integers(0, 20), max_size=8), ANYTHING)
@pytest.mark.parametrize("family", {spec.family: name for name, spec in sp.GAMES.items()}.values())
def test_whatever_is_sent_is_played_or_refused_on_purpose(family, actions, seed):
    game = made(family)
    with contextlib.suppress(sp.SmartPlayError):
        game.reset(seed=seed)
    for action in actions:
        with contextlib.suppress(sp.SmartPlayError):
            observation, *_ = game.step(action)
            assert type(action) is int
            assert observation in game.observation_space


@functools.cache
def made(name: str) -> TextGame:
    return sp.GAMES[name].make()


def test_the_module_prefix_registers_on_its_own():
    assert isinstance(gymnasium.make("smartplay_tools:smartplay/Hanoi3Disk-v0").unwrapped, TextGame)


# The checks find faults.

HANOI = sp.GAMES["Hanoi3Disk-v0"]


class Wrong(HANOI.load()):  # type: ignore[misc] - the base class is loaded at run time
    """Hanoi, but with one fault at a time."""

    fault = ""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if self.fault == "seeds" and not isinstance(seed, int | None):
            seed = 0
        return super().reset(seed=seed, options=options)

    def _step(self, action: int) -> Any:
        observation, *rest = super()._step(action)
        if self.fault == "random":
            self.calls = Wrong.calls = getattr(Wrong, "calls", 0) + 1
            observation = f"{observation} {self.calls % 7}"
        return {"long": observation * 100}.get(self.fault, observation), *rest

    def state_hash(self) -> str:
        return "0" * 32 if self.fault == "hash" else super().state_hash()

    @property
    def numbered_actions(self) -> Any:
        return tuple(reversed(self.actions)) if self.fault == "numbers" else self.actions

    def __reduce__(self) -> Any:
        return (pickle.loads, (None,)) if self.fault == "pickle" else super().__reduce__()


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("seeds", "'x' is not refused"),
        ("random", "The same seed and actions differ at step 1"),
        ("long", "longer, or of other characters"),
        ("hash", "several seeds give the same state hash"),
        ("numbers", "the manual has no line"),
    ],
)
def test_a_game_that_breaks_the_contract_is_told_what_is_wrong(fault, sentence):
    kind = type("Fault", (Wrong,), {"fault": fault})
    spec = sp.GAMES[HANOI.id].__class__(**{**vars(HANOI), "id": "Wrong-v0", "entry_point": kind})
    errors = []
    for check in IN_THIS_PROCESS:
        try:
            check(spec)
        except Exception as error:
            errors.append(str(error))
    assert any(sentence.lower() in one.lower() for one in errors), errors
    if fault == "seeds":
        with pytest.raises(AssertionError, match=re.escape(errors[0])):
            check_game(spec)


def test_a_game_that_is_not_registered_is_checked_as_well():
    for check in IN_THIS_PROCESS:
        check(HANOI.__class__(**{**vars(HANOI), "id": "Mine-v0"}))
