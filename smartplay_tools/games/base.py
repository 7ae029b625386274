"""TextGame: the base class of every game of the benchmark.

A text game is a Gymnasium environment whose observation is the text that a player reads. A subclass defines rules and
texts (`_reset`, `_step`, `_state`); the base class provides what all games share: the score, the history text as the
original prints it (past observations in one message, oldest first), the `info` dictionary and the state hash that
replays compare. Its observation space is `Words`, which Gymnasium cannot share between processes. Games do not count
steps: the rollout limit is enforced by Gymnasium's `TimeLimit` and by `Episode`.
"""

from __future__ import annotations

import functools
import hashlib
from abc import abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any, ClassVar, NoReturn, Protocol, runtime_checkable

import gymnasium
from gymnasium import spaces
from gymnasium.vector.utils import create_shared_memory

from smartplay_tools.errors import InvalidArgumentError, ResetNeededError, check_choice
from smartplay_tools.games import values
from smartplay_tools.games.seeds import check_seed, whole
from smartplay_tools.types.arguments import canonical_text
from smartplay_tools.types.pictures import Picture


def history_text(observations: Sequence[tuple[int, str]]) -> str:
    """Print past observations, (step, text) oldest first, as the original does; empty when there are none.

    Step 0 is the observation of the reset. The current observation is not part of its own history.
    """
    if not observations:
        return ""
    items = [f"Player Observation Step {step}:\n{text}" for step, text in observations]
    return "\n\n".join([f"Most recent {len(items)} steps of the player's in-game observation:", *items]).strip()


class Words(spaces.Text):
    """Gymnasium's space of texts, except that an `AsyncVectorEnv` with shared memory refuses it.

    That class reads its shared memory once, when it is made. For arrays this gives a view of the memory. For a text it
    gives a copy of the content before the first reset, and every later observation is that copy.
    """


class AnyWords(Words):
    """A space of texts of any characters; those that it samples are letters and digits."""

    def contains(self, x: Any) -> bool:
        """Return whether a text has a length of the space."""
        return isinstance(x, str) and self.min_length <= len(x) <= self.max_length


@create_shared_memory.register(Words)
def _refuse(space: Words, n: int = 1, ctx: Any = None) -> NoReturn:
    raise InvalidArgumentError(
        "Gymnasium's AsyncVectorEnv returns wrong texts from shared memory: pass shared_memory=False, in make_vec as "
        'vector_kwargs={"shared_memory": False}.'
    )


@functools.cache
def read_text(package: str, name: str) -> str:
    """Return a text file from a game's package, without the newline at its end."""
    return resources.files(package).joinpath(name).read_text(encoding="utf-8").removesuffix("\n")


def check_action(action: Any, actions: Sequence[str], game: str) -> int:
    """Return an action as an int; raise `InvalidArgumentError` unless it is the index of one of the actions."""
    index = action if type(action) is int else whole(action)
    if index is None or not 0 <= index < len(actions):
        raise InvalidArgumentError(
            f"An action of {game} is a whole number from 0 to {len(actions) - 1}, not {action!r}."
        )
    return index


def check_names(actions: Sequence[str], game: str) -> None:
    """Raise an `InvalidArgumentError` unless actions have names that calls can tell apart."""
    named: dict[str, str] = {}
    for name in actions:
        if not isinstance(name, str):
            raise InvalidArgumentError(f"The names of the actions of {game} are texts, and {name!r} is none.")
        if (plain := values.plain_name(name)) in named:
            raise InvalidArgumentError(
                f"Two actions of {game} have the name {name!r}, and a call could not choose between them: give each a "
                "name of its own, other than in case."
            )
        named[plain] = name


def with_action_list(manual: str, actions: Sequence[str]) -> str:
    """Append the numbered list of actions with which every manual except Crafter's ends."""
    lines = [f"{number}. {action}" for number, action in enumerate(actions, start=1)]
    return "\n".join([f"{manual}\n", "List of all actions:", *lines])


class TextGame(gymnasium.Env[str, Any]):
    """A game whose observations are texts and whose actions have names.

    Attributes:
        actions: the names of the actions; the index is the action of `step`, in the order of the original.
        numbered_actions: the names in the order in which the manual numbers them, from 1.
        manual: the text that explains the game, as the original prints it.
        score: the benchmark's score of the episode so far (paper, section 4.2).
        completed: whether the game's objective has been reached.
        observation: the current observation, the text that `reset` or `step` returned last.
        before_reset: what the original's history contains before the observation of the reset, oldest first; only the
            paper's protocol prints it.
        history: how many past observations `info["history"]` holds at most; None for all.
        hash_every: the number of steps from one state hash of a record to the next, a constant of the game.
        is_slow: whether a step may take so long that an event loop should not wait for it.
        options: the names of the keyword arguments that users of a setting may give.
        places: those of them that name a file or a folder; what a record names with them is not opened.
        engines: the engines that can run the game, the default first; empty if there is only one.
        picture_engines: the engines on which an observation can be a picture; (None,) for a game without engines.
        shows_pictures: whether observations are pictures, too, which is set before the first reset.
        engine: the engine that runs it, one of `engines`; None if there is only one.
        comparable: whether scores may be compared with the paper's human score, which depends on the engine.

    The only source of randomness is the seed of `reset`: games draw from `self.np_random` and nothing else.
    """

    metadata: dict[str, Any] = {"render_modes": ["ansi"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's attribute
    hash_every: ClassVar[int] = 1
    is_slow: ClassVar[bool] = False
    options: ClassVar[tuple[str, ...]] = ()
    places: ClassVar[tuple[str, ...]] = ()
    engines: ClassVar[tuple[str, ...]] = ()
    picture_engines: ClassVar[tuple[str | None, ...]] = ()

    actions: tuple[str, ...]
    manual: str
    before_reset: tuple[str, ...] = ()
    engine: str | None = None
    comparable: bool = True
    shows_pictures: bool = False

    def __init__(
        self,
        *,
        history: int | None,
        longest_observation: int = 4_000,
        characters: str | None = None,
        render_mode: str | None = None,
        observation: str = "text",
    ) -> None:
        """`longest_observation` (in characters) and `characters` (None for any) bound the observation space.

        `observation` is "text"; a picture in addition, or instead, is up to Gymnasium's wrapper.
        """
        if observation != "text":
            raise InvalidArgumentError(
                f'The observation of a text game is its text, not "{observation}"; gymnasium.wrappers.'
                'AddRenderObservation adds the picture of a game that has the render mode "rgb_array".'
            )
        if history is not None and history < 0:
            raise InvalidArgumentError(f"history must be 0 or more, or None for all steps, not {history}.")
        if render_mode is not None:
            check_choice("render_mode", render_mode, self.metadata["render_modes"])
        check_names(self.actions, type(self).__name__)
        self.history = history
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(len(self.actions))
        self._longest_observation, self._characters = longest_observation, characters
        self.score: float = 0
        self.completed = False
        self.observation = ""
        self._steps = 0
        self._playing = False
        self._past: deque[tuple[int, str]] = deque(maxlen=history)

    @functools.cached_property
    def observation_space(self) -> spaces.Text:  # type: ignore[override]  # created at first use: agents never use it
        """Texts of the game's characters, up to its longest observation."""
        if self._characters is None:
            return AnyWords(min_length=1, max_length=self._longest_observation)
        characters = "".join(sorted(set(self._characters)))
        return Words(min_length=1, max_length=self._longest_observation, charset=characters)

    @property
    def numbered_actions(self) -> tuple[str, ...]:
        """The actions in the manual's order; the same as `actions` unless a game overrides it."""
        return self.actions

    # Options as a config holds them.

    @classmethod
    def options_to_record(cls, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return a user's options with the values that they take from this machine, such as from a variable."""
        return dict(options)

    @classmethod
    def options_from_record(cls, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return recorded options as keyword arguments that leave nothing to this machine."""
        return dict(options)

    # What a game defines.

    @abstractmethod
    def _reset(self) -> str:
        """Start an episode from `self.np_random`; return the first observation."""

    @abstractmethod
    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        """Play an action; return observation, reward, terminated and truncated. Updates score and completed."""

    @abstractmethod
    def _state(self) -> Any:
        """The whole state of the game's rules as JSON, or as bytes; the random stream is added by `state_hash`."""

    @property
    def optimal_action(self) -> int | None:
        """The best action given the whole state; None if no optimum is known, or the game is over."""
        return None

    @property
    def needs(self) -> Sequence[int] | Mapping[int, str] | None:
        """The steps whose observations the next right action depends on, step 0 being the reset; None if unknown.

        With the steps as keys, each value is the *content* that is needed of its observation: a few words, such as
        `5 hearts`, by which it is found in whatever a prompt says. It is on record with each action, and never shown.
        """
        return None

    @property
    def breaks(self) -> Sequence[int] | None:
        """The actions, as `step` takes them, that break the game's rules in this state; None if it declares none.

        It is on record with each action, and never shown to the player.
        """
        return None

    def deviations(self) -> dict[str, Any]:
        """The differences from the paper that the game's options cause: name -> {"paper": ..., "played": ...}."""
        return {}

    def versions(self) -> Mapping[str, str]:
        """Name to version of the programs outside of Python that run the game, for the result."""
        return {}

    @classmethod
    def refused_pictures(cls, engine: str | None, options: Mapping[str, Any]) -> str | None:
        """Return why observations cannot be pictures on an engine with these options; None if they can be."""
        if not cls.picture_engines:
            return "it has no picture"
        if engine not in cls.picture_engines:
            return f"only its engine {' or '.join(map(str, cls.picture_engines))} draws pictures"
        return None

    @property
    def picture_shape(self) -> tuple[int, int]:
        """Width and height of its pictures in pixels, all of the same size."""
        raise NotImplementedError(f"{type(self).__name__} has no pictures.")

    def picture(self) -> Picture:
        """Return the current observation as a picture: the same for the same state, to the pixel.

        It shows the state of the latest step, and looking changes nothing. Only with `shows_pictures`.
        """
        raise NotImplementedError(f"{type(self).__name__} has no pictures.")

    def drawing(self) -> dict[str, Any]:
        """The state as JSON for a drawing on the replay page, including facts that the player cannot see.

        Empty if there is nothing to draw. A game that the page cannot draw may return `{"text": ...}`, a picture
        made of characters.
        """
        return {}

    # What every game has.

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[str, dict[str, Any]]:
        """Start an episode. Without a seed the random stream continues, as in all Gymnasium environments."""
        super().reset(seed=None if seed is None else check_seed(seed))
        self.score, self.completed, self._steps, self._playing = 0, False, 0, False
        self._past.clear()
        self.observation = values.text("The observation", self._reset(), 0)
        self._take_score(0)
        self._playing = True
        return self.observation, self._info()

    def step(self, action: Any) -> tuple[str, float, bool, bool, dict[str, Any]]:
        """Play `actions[action]`.

        The action is an integer, Python's or numpy's; any other raises `InvalidArgumentError`. A step before the
        first reset or after the game's own end, which a rollout limit is not, raises `ResetNeededError`.
        """
        return (*self.advance(action), self._info())

    def advance(self, action: Any) -> tuple[str, float, bool, bool]:
        """Play an action as `step` does, but without `info`, for callers that keep their own history."""
        if not self._playing:
            raise ResetNeededError(
                f"{type(self).__name__} takes no step before its reset, nor after its end: call reset()."
            )
        index = check_action(action, self.actions, type(self).__name__)
        if self.history != 0:
            self._past.append((self._steps, self.observation))
        observation, reward, terminated, truncated = self._step(index)
        step = self._steps + 1
        self.observation = values.text("The observation", observation, step)
        reward = float(values.number("The reward", reward, step))
        terminated = values.flag("`terminated`", terminated, step)
        truncated = values.flag("`truncated`", truncated, step)
        self._take_score(step)
        self._steps = step
        self._playing = not (terminated or truncated)
        return self.observation, reward, terminated, truncated

    def _take_score(self, step: int) -> None:
        self.score = values.number("The score", self.score, step)
        self.completed = values.flag("`completed`", self.completed, step)

    def render(self) -> Any:
        """Return the current observation (render mode `ansi`), or what the game's other render mode returns."""
        return self.observation

    def recent(self, steps: int | None = None) -> str:
        """The history text of at most `steps` past observations; None for as many as `history` keeps."""
        past = list(self._past)
        return history_text(past if steps is None else past[max(0, len(past) - steps) :])

    def state_hash(self) -> str:
        """The 32 hex digits of blake2b-128 over the whole state, random stream included.

        Equal hashes mean that the same actions lead to the same future, in any process and on any machine.
        """
        state = self._state()
        if not isinstance(state, bytes):
            state = values.json_text("`_state`", state, self._steps).encode()
        digest = hashlib.blake2b(state, digest_size=16)
        counts = canonical_text([self._steps, self.score, self.completed])
        digest.update(f"{counts[:-1]},{self._random_state()}]".encode())
        return digest.hexdigest()

    def _random_state(self) -> str:
        """The state of the game's random stream as canonical JSON."""
        return canonical_text(self.np_random.bit_generator.state)

    def _info(self) -> dict[str, Any]:
        return {
            "obs": self.observation,
            "manual": self.manual,
            "history": history_text(self._past) if self._past else "",
            "score": self.score,
            "completed": int(self.completed),
        }


@runtime_checkable
class ReadableGame(Protocol):
    """A game whose right actions follow from what was seen. The player `reader` plays by them."""

    @classmethod
    def right_actions(cls, seen: Mapping[int, str], actions: Sequence[str]) -> Sequence[str]:
        """Return the legal `actions` that are right, as far as these observations by step tell; none if they do not.

        The newest observation is the current one.
        """
        ...
