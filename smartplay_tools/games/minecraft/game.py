"""The Minecraft environment: one task of creative navigation on one engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, get_args

from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.games.base import TextGame, read_text, with_action_list
from smartplay_tools.games.minecraft.engines import ENGINES, Engine, load_engine
from smartplay_tools.games.minecraft.observation import VIEW, Observation, TextMode
from smartplay_tools.games.minecraft.rules import ACTIONS, CORRECTED_GOALS, PAPER_GOALS, strides, turn
from smartplay_tools.games.minecraft.text import LONGEST, describe
from smartplay_tools.types.pictures import Picture

PAPER_ENGINE = "minedojo"
"""The engine of the paper, Minecraft itself."""

Start = Literal["far", "anywhere"]
"""`far` is outside the goal and a walk away from it; `anywhere` is the original's, not checked for the goal."""


class Minecraft(TextGame):
    """Find a biome.

    Action space: `Discrete(4)`, see `ACTIONS`; one action turns and then walks for up to 2.5 seconds of game time.
    Observation: where the player is, the blocks around and the view. Reward: always 0. Score: 1 once the player stands
    in a biome of the goal, which ends the episode; a rollout has 200 steps.

    Arguments: `task`, the number of the creative task; `engine`, the world behind it; `text`, "paper" for the
    original's output and goals with their bugs, "corrected" for true directions, None for the engine's default;
    `start`, "far" for a start at a distance from the goal, "anywhere" for one that is not checked for the goal, as in
    the original, None for the engine's default: MineDojo starts where the game does, and the others far.
    """

    actions = ACTIONS
    hash_every = 100
    is_slow = True
    options = ("text", "start")
    engines = tuple(ENGINES)
    picture_engines = ("voxel",)

    def __init__(
        self,
        *,
        task: int,
        engine: str = "voxel",
        text: TextMode | None = None,
        start: Start | None = None,
        **options: Any,
    ) -> None:
        for name, value, values in (("text", text, get_args(TextMode)), ("start", start, get_args(Start))):
            if value is not None:
                check_choice(name, value, values)
        if engine == PAPER_ENGINE and start == "far":
            raise InvalidArgumentError(
                f"The engine {engine!r} does not support start='far': leave out the option, or choose another engine."
            )
        world = load_engine(engine)
        self.engine = engine
        # The human scores are from the real game, so only its scores may be compared with them.
        self.comparable = engine == PAPER_ENGINE
        self.text: TextMode = text or world.default_text
        self._start: Start = start or ("anywhere" if engine == PAPER_ENGINE else "far")
        self.goal = (PAPER_GOALS if self.text == "paper" else CORRECTED_GOALS)[task]
        """The goal of the task."""
        self.manual = with_action_list(read_text(__package__, "manual.txt").format(goal=self.goal.name), ACTIONS)
        super().__init__(longest_observation=LONGEST, **options)
        self.world: Engine = world(text=self.text)
        """The engine, which holds the world."""
        self._seen: Observation

    def _reset(self) -> str:
        # An engine keeps the start away from the goal's biomes; without any, it begins anywhere.
        avoided = self.goal if self._start == "far" else replace(self.goal, biomes=frozenset())
        self._seen = self.world.reset(int(self.np_random.integers(2**32)), avoided)
        return describe(self._seen, self.text)

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        self._seen = self.world.act(turn(action, self._seen.yaw), strides(self.np_random), self.goal)
        # As in the original, only the end of a walk counts, so a start inside the goal is not a success.
        self.completed = self._seen.biome in self.goal.biomes
        self.score = int(self.completed)
        return describe(self._seen, self.text, ACTIONS[action]), 0, self.completed, False

    @classmethod
    def refused_pictures(cls, engine: str | None, options: Mapping[str, Any]) -> str | None:
        """Return why observations cannot be pictures: the paper's text sees along rays that are bent."""
        if options.get("text") == "paper":
            return 'the view of text="paper" is turned upside down by its bugs'
        return super().refused_pictures(engine, options)

    @property
    def picture_shape(self) -> tuple[int, int]:
        """Width and height of the view, enlarged."""
        from smartplay_tools.games.minecraft.pictures import SCALE

        return VIEW * SCALE, VIEW * SCALE

    def picture(self) -> Picture:
        """Return the view as a picture."""
        from smartplay_tools.games.minecraft.pictures import SCALE, draw

        return Picture.from_array(draw(self._seen), SCALE)

    def deviations(self) -> dict[str, Any]:
        """Engine, text and start, if they differ from the paper's."""
        played = {
            "engine": (PAPER_ENGINE, self.engine),
            "text": ("paper", self.text),
            "start": ("anywhere", self._start),
        }
        return {name: {"paper": paper, "played": ours} for name, (paper, ours) in played.items() if ours != paper}

    def versions(self) -> Mapping[str, str]:
        """The versions of the engine's programs."""
        return self.world.versions

    def _state(self) -> bytes:
        return self.world.state()

    def close(self) -> None:
        """Close the engine."""
        self.world.close()
