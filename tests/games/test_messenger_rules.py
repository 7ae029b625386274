"""MESSENGER's rules and observations against transitions that were recorded from the original."""

from __future__ import annotations

import functools
import itertools
import json
import lzma
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from smartplay_tools.games.base import history_text
from smartplay_tools.games.messenger import rules, text
from smartplay_tools.games.messenger.rules import GAMES, Game, State

RECORDED = Path(__file__).parent.parent / "data" / "messenger.jsonl.xz"
ROLES = ("enemy", "message", "goal", "decoy_message", "decoy_goal")


@functools.cache
def recorded() -> list[dict[str, Any]]:
    with lzma.open(RECORDED, "rt", encoding="utf-8") as file:
        return [json.loads(line) for line in file]


def steps(level: int) -> list[dict[str, Any]]:
    return [row for row in recorded() if row["kind"] == "step" and row["level"] == level]


def state_of(row: dict[str, Any], when: str) -> State:
    """The recorded state; a removed thing keeps its movement, which the recording drops, from before the step."""
    before, now = row.get("pre", row["post"])["ents"], row[when]["ents"]
    roles = [role for role in ROLES if role in now]
    avatar = row[when]["avatar"]
    return State(
        tuple(tuple(now[role]["px"]) if now[role] else None for role in roles),
        tuple((now[role] or before[role] or {"type": "immovable"})["type"] for role in roles),
        tuple(avatar["px"]) if avatar else None,
        avatar["has_message"] if avatar else row.get("pre", row["post"])["avatar"]["has_message"],
    )


def names_of(row: dict[str, Any]) -> tuple[str, ...]:
    return text.names_by_role(Game(**row["names"]), len(row["post"]["ents"]))


def outcomes(state: State, action: int) -> dict[rules.StepOutcome, float]:
    """Return every possible outcome of a tick of level 2 or 3, with its probability."""
    if rules.is_over(state):
        return {rules.StepOutcome(state, 0.0, True): 1.0}
    assert state.avatar is not None
    open_to = [rules.choices(m, place, state.avatar) for m, place in zip(state.movements, state.places, strict=True)]
    probability = 1 / math.prod(map(len, open_to))
    table: dict[rules.StepOutcome, float] = {}
    for steps in itertools.product(*open_to):
        outcome = rules.settle(state, action, steps)
        table[outcome] = table.get(outcome, 0.0) + probability
    return table


def seen_of(state: State) -> tuple[Any, ...]:
    """The recorded part of a state, without what a dead avatar carries."""
    return (state.places, state.avatar, state.has_message if state.avatar else None)


@pytest.mark.parametrize("level", [2, 3])
def test_every_recorded_step_is_possible(level: int) -> None:
    for row in steps(level):
        table = outcomes(state_of(row, "pre"), row["action"])
        allowed = {(seen_of(outcome.state), outcome.reward, outcome.ended) for outcome in table}
        assert (seen_of(state_of(row, "post")), row["reward"], row["done"]) in allowed
        assert sum(table.values()) == pytest.approx(1)


def test_every_recorded_step_of_level_1_follows() -> None:
    for row in steps(1):
        outcome = rules.step_level_1(state_of(row, "pre"), row["action"])
        assert (outcome.state, outcome.reward, outcome.ended) == (state_of(row, "post"), row["reward"], row["done"])


def test_observations_equal_the_recorded_ones() -> None:
    for row in recorded():
        assert text.describe(state_of(row, "post"), names_of(row), row.get("action")) == row["obs"]


def test_histories_equal_the_recorded_ones() -> None:
    past: list[tuple[int, str]] = []
    for row in recorded():
        if row["source"] == "natural":
            past = [] if row["kind"] == "reset" else past[-2:]
            assert history_text(past) == row["history"]
            past.append((row["t"], row["obs"]))


def test_recorded_starts_are_possible() -> None:
    for row in recorded():
        if row["kind"] == "reset":
            state = state_of(row, "post")
            assert Game(**row["names"]) in GAMES["test"]
            assert state.movements in rules.MOVEMENT_VARIANTS[row["level"]]
            chance = np.random.default_rng(0)
            slots = set(rules.start(row["level"], chance).places) | {rules.start(row["level"], chance).avatar}
            for _ in range(60):
                drawn = rules.start(row["level"], chance)
                slots |= {*drawn.places, drawn.avatar}
            assert {*state.places, state.avatar} <= slots


@pytest.mark.parametrize("level", [2, 3])
def test_the_seeded_dynamics_follow_the_stated_probabilities(level: int) -> None:
    """Pooled over recorded situations: observed against expected counts of every outcome."""
    chance = np.random.default_rng(11)
    observed, expected = [], []
    for row in steps(level)[::12]:
        state = state_of(row, "pre")
        table = outcomes(state, row["action"])
        if 1 < len(table) <= 8:
            drawn = Counter(rules.step(state, row["action"], chance) for _ in range(400))
            assert set(drawn) <= set(table)
            # The last outcome of a situation follows from the others.
            observed += [drawn[outcome] for outcome in table]
            expected += [400 * probability for probability in table.values()]
    situations = sum(expected) / 400
    statistic = sum((o - e) ** 2 / e for o, e in zip(observed, expected, strict=True))
    assert scipy.stats.chi2.sf(statistic, len(expected) - situations) > 0.001


def test_a_fleeing_thing_in_a_corner_can_lose_its_tick() -> None:
    state = State(((0, 0), (10, 18), (18, 10)), ("fleeing", "immovable", "immovable"), (4, 4))
    assert {outcome.state.places[0] for outcome in outcomes(state, 4)} == {(0, 0)}


def test_death_comes_before_success_and_takes_the_message_along() -> None:
    beside = State(((9, 9), (9, 10), (0, 0)), ("immovable",) * 3, (10, 10))
    (outcome,) = outcomes(beside, 4)
    assert (outcome.reward, outcome.state.avatar, outcome.state.places[1]) == (-1, None, None)


def test_every_enemy_of_level_3_costs_one() -> None:
    state = State(((10, 9), (0, 0), (18, 18), (9, 10), (11, 11)), ("immovable",) * 5, (10, 10))
    (outcome,) = outcomes(state, 4)
    assert (outcome.reward, outcome.ended) == (-3, True)


def test_games_are_those_of_the_splits() -> None:
    assert {split: len(set(games)) for split, games in GAMES.items()} == {"train": 44, "val": 32, "test": 32}
    assert not set(GAMES["val"]) & set(GAMES["test"])
    assert Game("airplane", "dog", "fish") in GAMES["test"]
    assert Game("bird", "robot", "ball") in GAMES["test"]
    assert Game("mage", "sword", "ship") in GAMES["test"]
    assert Game("scientist", "queen", "thief") in GAMES["test"]


@pytest.mark.parametrize(("level", "layouts", "variants"), [(1, 24, 1), (2, 24, 27), (3, 720, 18)])
def test_starts_are_uniform(level: int, layouts: int, variants: int) -> None:
    chance = np.random.default_rng(level)
    number = max(960, 10 * layouts)
    starts = [rules.start(level, chance) for _ in range(number)]
    places = Counter((state.places, state.avatar) for state in starts)
    movements = Counter(state.movements for state in starts)
    assert (len(places), len(movements)) == (layouts, variants)
    assert scipy.stats.chisquare(list(places.values())).pvalue > 0.001
    if variants > 1:
        assert scipy.stats.chisquare(list(movements.values())).pvalue > 0.001
    with_message = sum(state.has_message for state in starts)
    assert scipy.stats.binomtest(with_message, number, 0.2).pvalue > 0.001 if level == 1 else with_message == 0


def test_level_1_is_won_at_the_message_or_with_it_at_the_goal() -> None:
    state = State(((10, 6), (6, 10), (14, 10)), ("immovable",) * 3, (8, 10))
    assert rules.step_level_1(state, 2)[1:] == (1, True)
    holding = State(state.places, state.movements, (12, 10), has_message=True)
    assert rules.step_level_1(holding, 3)[1:] == (1, True)
    assert rules.step_level_1(State(state.places, state.movements, (12, 10)), 3)[1:] == (-1, True)
