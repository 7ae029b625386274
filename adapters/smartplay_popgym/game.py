"""What POPGym's games have in common."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from smartplay_tools.games import GymnasiumGame


class PopgymGame(GymnasiumGame):
    """A game of POPGym: its score is the sum of its rewards, from -1 to 1."""

    uses_global_streams = False
    env: Any

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        text, reward, terminated, truncated = super()._step(action)
        # The rewards of a whole episode add up to 1 or to -1, but for the rounding of floats.
        self.score = min(1.0, max(-1.0, self.score))
        self.completed = self._is_completed(terminated)
        return text, reward, terminated, truncated

    def _is_completed(self, terminated: bool) -> bool:
        """Return whether the objective is reached."""
        return terminated

    @property
    def played(self) -> int:
        """How many steps have been played, the latest one included."""
        return len(self._played)

    def versions(self) -> Mapping[str, str]:
        """The version of POPGym, which makes the worlds."""
        return {"popgym": version("popgym")}
