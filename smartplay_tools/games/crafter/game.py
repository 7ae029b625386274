"""Crafter as a text game."""

from __future__ import annotations

from typing import Any, ClassVar

from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.games.base import TextGame, read_text
from smartplay_tools.games.crafter.facts import LENGTH, NOOP, VIEW
from smartplay_tools.games.crafter.fast import FastEngine
from smartplay_tools.games.crafter.text import ACTIONS, NUMBERED_ACTIONS, describe
from smartplay_tools.games.seeds import check_seed
from smartplay_tools.types.pictures import Picture

TEXTS = ("original", "corrected")
SMALLEST_PICTURE = 64
LARGEST_CELL = 28
"""The pixels of a cell up to which a picture that a model is shown is enlarged: a patch of Claude's."""

FORMER = "crafter"
"""The engine that records of earlier versions name where PyPI's package ran, whose worlds are equal: it is played again
as they are."""


class Crafter(TextGame):
    """Crafter, an open world of survival.

    Action space: `Discrete(17)`, in the order of `actions`; the manual numbers them as `numbered_actions` does.
    Observation: the action taken, what can be seen (the nearest of each kind), what is in front, the player's vitals
    and its inventory. Reward: a tenth of the change in health, and 1 in a step that unlocks achievements. Score: the
    achievements unlocked so far, of 22, summed over all steps. Terminates at death, truncates at step 10,000 of the
    engine; the reset takes the first of them (a noop), so that an episode has at most 9,999 steps. There is no
    objective, and so no completion.

    `reset(seed=s)` begins the first episode of the original's `Crafter(seed=s)`, and each further reset without a seed
    begins its next one. If the first reset has no seed, `np_random_seed` is the seed of its world.

    Arguments: `engine`, "fast"; `text`, "original" or "corrected" (see `text.py`); `picture_size`, the side of
    pictures in pixels (`render_mode="rgb_array"`); at 64 they are the original's. Pictures that a model is shown are
    their cells without the border, enlarged by the largest whole number with which a cell has at most 28 pixels:
    252 x 252.
    """

    metadata: dict[str, Any] = {"render_modes": ["ansi", "rgb_array"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's attribute
    hash_every: ClassVar[int] = 100
    options: ClassVar[tuple[str, ...]] = ("text", "render_mode", "picture_size")
    engines: ClassVar[tuple[str, ...]] = ("fast",)
    picture_engines: ClassVar[tuple[str | None, ...]] = (*engines, FORMER)
    actions = ACTIONS
    numbered_actions = NUMBERED_ACTIONS

    def __init__(
        self, *, engine: str = "fast", text: str = "original", picture_size: int = SMALLEST_PICTURE, **options: Any
    ) -> None:
        if engine != FORMER:
            check_choice("engine", engine, self.engines)
        check_choice("text", text, TEXTS)
        if picture_size < SMALLEST_PICTURE:
            raise InvalidArgumentError(f"picture_size must be {SMALLEST_PICTURE} or more, not {picture_size}.")
        self.manual = read_text(__package__, "manual.txt")
        super().__init__(**options)
        self.engine = engine
        self._corrected = text == "corrected"
        self._picture_size = picture_size
        self._seed: int | None = None
        self._episode = 0
        self._world: FastEngine

    def deviations(self) -> dict[str, Any]:
        """The corrected text, if it is played; the engine plays the paper's game."""
        return {"text": {"paper": "original", "played": "corrected"}} if self._corrected else {}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[str, dict[str, Any]]:
        """Start the first episode of a seed or, without one, the next episode."""
        if seed is not None:
            self._seed, self._episode = check_seed(seed), 0
        return super().reset(seed=seed, options=options)

    def _reset(self) -> str:
        if self.np_random_seed < 0:  # what Gymnasium says of a generator that a user has set
            self._seed, self._episode = int(self.np_random.integers(2**31 - 1)), 0
        elif self._seed is None:
            self._seed, self._episode = self.np_random_seed, 0
        self._episode += 1
        self.score = 0.0
        self._world = FastEngine(self._seed, self._episode)
        self._world.step(NOOP)
        # The original records this step twice: as a step of the agent, and as the observation of the reset.
        self.before_reset = (self._describe(NOOP),)
        return self._describe(None)

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        world = self._world
        reward = world.step(action)
        self.score += world.unlocked
        return self._describe(action), reward, world.health <= 0, world.steps >= LENGTH

    def _describe(self, action: int | None) -> str:
        world = self._world
        return describe(world.sight(), action, dead=world.health <= 0, corrected=self._corrected)

    def render(self) -> Any:
        """Return the observation or, with `render_mode="rgb_array"`, the picture of the current state."""
        if self.render_mode != "rgb_array":
            return super().render()
        from smartplay_tools.games.crafter.pictures import draw

        return draw(self._world.scene(), self._picture_size)

    @property
    def picture_shape(self) -> tuple[int, int]:
        """The side of a picture that a model is shown, twice."""
        unit, scale = self._cell
        side = VIEW[0] * unit * scale
        return side, side

    @property
    def _cell(self) -> tuple[int, int]:
        """The pixels of a cell as it is drawn, and how many times they are enlarged."""
        unit = self._picture_size // VIEW[0]
        return unit, max(1, LARGEST_CELL // unit)

    def picture(self) -> Picture:
        """Return the picture of the current state, as the original draws it, enlarged."""
        from smartplay_tools.games.crafter.pictures import draw

        unit, scale = self._cell
        return Picture.from_array(draw(self._world.scene(), unit * VIEW[0]), scale)

    def drawing(self) -> dict[str, Any]:
        """The part of the scene that the player sees: ground and things by cell, body, inventory, light."""
        from smartplay_tools.games.crafter.views import surroundings

        return surroundings(self._world.scene())

    def _state(self) -> Any:
        return self._world.state()

    def _random_state(self) -> str:
        return f'[{self._seed},{self._episode},"{self._world.fingerprint().hex()}"]'
