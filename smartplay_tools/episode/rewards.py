"""The reward of an episode for training: three choices, the same in every training framework."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

from smartplay_tools.errors import InvalidArgumentError, check_choice

if TYPE_CHECKING:
    from smartplay_tools.episode.episode import Episode

RewardName = Literal["normalized", "score", "return"]
"""The score on the scale where 0 is the worst and 1 the human's, the score itself, or the sum of the game's rewards."""


def reward_of(episode: Episode, reward: RewardName) -> float:
    """Return an episode's reward so far; `InvalidArgumentError` if its score has no normalised form."""
    check_choice("reward", reward, get_args(RewardName))
    progress = episode.progress
    match reward:
        case "score":
            return float(progress.score)
        case "return":
            return float(progress.reward)
    if progress.normalized_score is None:
        raise InvalidArgumentError(
            f"{episode.spec.id} has no human score here, so its score is not normalised; "
            'use reward="score" or reward="return".'
        )
    return float(progress.normalized_score)
