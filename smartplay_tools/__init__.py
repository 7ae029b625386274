"""smartplay-tools: the SmartPlay benchmark's games as three tools for any tool-calling agent."""

from __future__ import annotations

import gymnasium as _gymnasium

from smartplay_tools.specs import GAMES

for _spec in GAMES.values():
    _gymnasium.register(
        id=f"smartplay/{_spec.id}",
        entry_point=_spec.entry_point,
        kwargs={"history": _spec.history, **_spec.kwargs},
        max_episode_steps=_spec.rollout,
    )
