"""Episodes for trainers of language models: seed by seed, with a reward."""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.training.factory import (
        EpisodeFactory as EpisodeFactory,
        RewardName as RewardName,
        reward_of as reward_of,
    )

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
