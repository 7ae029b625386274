"""MESSENGER as an environment: seeds, scores, ends, options."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.games.base import TextGame
from smartplay_tools.games.messenger import text

LEVELS = (1, 2, 3)


def make(level: int, **options: object) -> TextGame:
    return sp.GAMES[f"MessengerL{level}-v0"].make(**options)


@pytest.mark.parametrize("level", LEVELS)
def test_the_score_is_the_last_reward_and_a_win_completes(level: int) -> None:
    game = make(level)
    rewards = set()
    for seed in range(150):
        game.reset(seed=seed)
        for number in range(40):
            _, reward, terminated, _, info = game.step((seed + number // 3) % 4)
            rewards.add(reward)
            assert info["score"] == reward
            assert info["completed"] == (terminated and reward == 1)
            if terminated:
                break
    assert rewards >= ({-1, 0, 1} if level == 1 else {-1, 0, 0.5})


def dead(level: int, **options: object) -> TextGame:
    """A game whose avatar has just died."""
    game = make(level, **options)
    for seed in range(100):
        game.reset(seed=seed)
        for _ in range(60):
            _, reward, terminated, *_ = game.step(seed % 5)
            if terminated and reward < 0:
                return game
    raise AssertionError("nobody died")


def test_death_shows_the_originals_accident_unless_corrected() -> None:
    assert dead(2).observation == "Environment Error."
    corrected = dead(2, text="corrected")
    assert corrected.observation.endswith(text.CAUGHT)
    assert corrected.deviations()["text"] == {"paper": "original", "played": "corrected"}
    assert "Environment Error." not in dead(1).observation  # level 1 keeps its avatar


@pytest.mark.parametrize("split", ["train", "val", "test"])
@pytest.mark.parametrize("level", LEVELS)
def test_every_split_can_be_played(split: str, level: int) -> None:
    game = make(level, split=split)
    manuals = set()
    for seed in range(80):
        game.reset(seed=seed)
        manuals.add(game.manual)
    assert len(manuals) == 80
    assert game.deviations().get("split", {"played": "test"})["played"] == split


@pytest.mark.parametrize("option", [{"split": "dev"}, {"text": "fixed"}])
def test_an_option_that_cannot_be_gets_one_sentence(option: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(option))} must be"):
        make(1, **option)
