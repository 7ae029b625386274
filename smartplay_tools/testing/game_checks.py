"""Contract tests of games: what tools, budgets, records and replays rely on, for everybody who adds a game.

`CHECKS` are functions that take a setting, its id or a `GameSpec`, and raise an `AssertionError` that says what the
game does wrong. With pytest:

    import pytest
    from smartplay_tools.testing import CHECKS

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
    def test_contract(check):
        check("HigherOrLower-v0")

`check_game` calls them all. Every game of the benchmark is held to the same checks. Nothing here needs pytest.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import itertools
import json
import math
import multiprocessing
import os
import pickle
import random
import re
import sys
import warnings
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np

from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.conversation.loop import play
from smartplay_tools.episode.episode import Episode
from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import ClosingWarning, GameValueError, InvalidArgumentError
from smartplay_tools.games.base import TextGame
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.games.specs import GAMES, IN_FILES, get_spec
from smartplay_tools.players import get_player
from smartplay_tools.records.replays import replay
from smartplay_tools.testing.hostile import require
from smartplay_tools.transcript.events import Event
from smartplay_tools.types.arguments import read

__all__ = ["CHECKS", "check_game", "random_walk"]

LONGEST_WALK = 100
"""Steps of random play in a check."""

SCORED_EPISODES = 20
"""Episodes of random play whose scores are compared with the bounds."""

RESETS = 6
"""How often the same episode is played by one instance."""

SECONDS = 60.0
"""What another process may take for two short walks."""

COMMON = ("step", "advance", "recent", "_info")
"""What only `TextGame` defines."""

NO_SEEDS = ("x", "1", -1, 1.5, True, [3], b"1")

Setting = str | GameSpec

CHECKS: list[Callable[[Setting], None]] = []
"""All checks in their order; each is a function of a setting, and its name completes the sentence "The game ..."."""


def check_game(game: Setting) -> None:
    """Hold a game to every check of `CHECKS`."""
    for check in CHECKS:
        check(game)


def _check(function: Callable[[GameSpec], None]) -> Callable[[Setting], None]:
    """Make a function a check, the next of `CHECKS`; what the game raises in it is a mistake of the game's, too."""

    @functools.wraps(function)
    def check(game: Setting) -> None:
        spec = get_spec(game)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", ClosingWarning)  # a run would only warn of a failing close
                function(spec)
        except AssertionError:
            raise
        except Exception as error:
            about = (function.__doc__ or "").partition("\n")[0]
            raised = f"{type(error).__name__}: {error}".removesuffix(".")
            raise AssertionError(f"It raises {raised}. The rule: {about}") from error

    CHECKS.append(check)
    return check


def random_walk(
    game: TextGame, steps: int, seed: int = 0, *, look: Callable[[TextGame], object] | None = None
) -> list[tuple[Any, ...]]:
    """Play random actions until the game's end; return what each step gave, with the state hash after it.

    `look` is called with the game before every step.
    """
    rng = np.random.default_rng(seed)
    seen = []
    for _ in range(steps):
        if look is not None:
            look(game)
        observation, reward, terminated, truncated, info = game.step(int(rng.integers(len(game.actions))))
        seen.append((observation, reward, terminated, truncated, info, game.state_hash()))
        if terminated or truncated:
            break
    return seen


@_check
def names_its_actions(spec: GameSpec) -> None:
    """Actions are texts that differ in more than case and a full stop; `action_count` is their number."""
    actions = spec.make().actions
    for name in actions:
        require(bool(name.strip()), f"{name!r} is not the name of an action")
    counted = spec.count_actions()
    require(counted == len(actions), f"action_count is {counted}, and the game has {len(actions)} actions")


@_check
def gives_texts_numbers_and_json(spec: GameSpec) -> None:
    """Observations are texts, rewards and scores finite numbers, ends truth values, and `_state` is JSON or bytes."""
    made, rng = _begun(spec), np.random.default_rng(0)
    for step in range(_steps(spec)):
        if not isinstance(state := made._state(), bytes):
            _require_json("_state", state)
        try:
            _, _, *ends = made.advance(int(rng.integers(len(made.actions))))
        except GameValueError:
            raise
        except (TypeError, ValueError) as error:
            raise AssertionError(
                f"Step {step + 1} raises {type(error).__name__}: {error}. `_step` returns a text, a number and two "
                "truth values: whether the episode is terminated, and truncated."
            ) from error
        if any(ends):
            break


@_check
def says_only_what_its_observation_space_holds(spec: GameSpec) -> None:
    """Every observation is within the observation space: no longer, and of no other characters."""
    made = _begun(spec)
    first = made.observation
    for observation in (first, *(step[0] for step in random_walk(made, _walk(spec)))):
        require(
            observation in made.observation_space,
            f"an observation is empty, longer, or of other characters than its observation space: {observation!r}",
        )


@_check
def leaves_the_global_random_streams_alone(spec: GameSpec) -> None:
    """The game draws from `self.np_random`; `random` and `numpy.random` belong to the program."""
    before = random.getstate(), repr(np.random.get_state())
    made = _begun(spec)
    random_walk(made, _steps(spec))
    for name, was, now in zip(
        ("random", "numpy.random"), before, (random.getstate(), repr(np.random.get_state())), strict=True
    ):
        require(now == was, f"the game moves the global stream of {name}: draw from self.np_random alone")


@_check
def is_decided_by_seed_and_actions(spec: GameSpec) -> None:
    """Equal seeds and equal actions give equal observations, rewards and state hashes."""
    made, other = spec.make(), spec.make()
    require(
        made.reset(seed=9) == other.reset(seed=9),
        "the same seed gives another first observation: the seed alone decides it",
    )
    require(
        made.state_hash() == other.state_hash(), "the same seed gives another state hash: the seed alone decides it"
    )
    pairs = zip(random_walk(made, 40), random_walk(other, 40), strict=True)
    for step, (was, now) in enumerate(pairs, start=1):
        require(was == now, f"the same seed and actions differ at step {step}: {was} and {now}")


@_check
def starts_anew_at_every_reset(spec: GameSpec) -> None:
    """What happened before a reset changes nothing after it."""
    made, steps = spec.make(), _steps(spec)
    first = None
    for _ in range(RESETS):
        now = [made.reset(seed=9), *random_walk(made, steps)]
        first = first or now
        require(
            now == first,
            "the same seed and actions give another episode after a reset: something survives it, such as a counter",
        )


@_check
def is_not_changed_by_looking_at_it(spec: GameSpec) -> None:
    """`drawing`, `needs` and `breaks` are JSON, and asking for them before every step changes nothing."""
    drawn, plain, steps = _begun(spec), _begun(spec), _steps(spec)
    seen = random_walk(drawn, steps, look=lambda game: _look(game, spec))
    _look(drawn, spec)
    require(
        seen == random_walk(plain, steps) and drawn.state_hash() == plain.state_hash(),
        "asking for `drawing`, `needs` or `breaks` changes the game",
    )


def _look(game: TextGame, spec: GameSpec) -> None:
    """Require what a record needs of the facts that a game declares about its state."""
    facts: dict[str, Any] = {}
    for name in ("drawing", "needs", "breaks"):
        try:
            facts[name] = game.drawing() if name == "drawing" else getattr(game, name)
        except Exception as error:
            raise AssertionError(f"Asking for `{name}` raises {type(error).__name__}: {error}.") from error
    _require_json("drawing", facts["drawing"])
    steps, actions = game._steps, range(len(game.actions))
    for name, numbers, allowed in (("needs", facts["needs"], range(steps + 1)), ("breaks", facts["breaks"], actions)):
        wrong = [number for number in numbers or () if type(number) is not int or number not in allowed]
        require(not wrong, f"`{name}` has {wrong} after step {steps}: it is of {allowed.start} to {allowed.stop - 1}")
    if isinstance(facts["needs"], Mapping):
        texts = facts["needs"].values()
        require(all(isinstance(text, str) for text in texts), f"`needs` has {[*texts]}: contents are texts")
    if isinstance(spec.memory, int) and facts["needs"]:
        back = steps - min(facts["needs"])
        require(back <= spec.memory, f"`needs` goes {back} steps back, and memory is {spec.memory}")


@_check
def has_a_state_hash_that_changes_with_play(spec: GameSpec) -> None:
    """The state hash is 128 bits, is the same when asked again, and changes with a step."""
    made = _begun(spec)
    before = made.state_hash()
    require(re.fullmatch("[0-9a-f]{32}", before) is not None, f"{before!r} is not a hash of 128 bits")
    require(made.state_hash() == before, "asking for the state hash changes it")
    made.step(0)
    require(made.state_hash() != before, "a step does not change the state hash")


@_check
def has_a_future_that_its_state_hash_decides(spec: GameSpec) -> None:
    """Where two ways lead to the same state hash, the same action has the same outcome: `_state` misses nothing."""
    made, rng = spec.make(), np.random.default_rng(0)
    seeds, walks, steps = (1, 2, 8) if made.hash_every > 1 else (4, 16, 12)  # their states are large
    for seed in range(seeds):
        few = rng.permutation(len(made.actions))[:3]  # so that walks meet
        outcomes: dict[tuple[str, int], Any] = {}
        for _ in range(walks):
            made.reset(seed=seed)
            for _ in range(steps):
                before, action = made.state_hash(), int(rng.choice(few))
                outcome = (*made.advance(action), made.score, made.completed, made.state_hash())
                require(
                    outcomes.setdefault((before, action), outcome) == outcome,
                    f"{made.actions[action]!r} has two outcomes at the same state hash: `_state` misses something that "
                    "decides the future",
                )
                if outcome[2] or outcome[3]:
                    break


@_check
def differs_between_seeds(spec: GameSpec) -> None:
    """Other seeds are other episodes."""
    made, hashes = spec.make(), set()
    for seed in (*range(8), 2**32, 2**64, 10**40):
        made.reset(seed=seed)
        hashes.add(made.state_hash())
    require(len(hashes) == 11, "several seeds give the same state hash")


@_check
def is_a_gymnasium_environment(spec: GameSpec) -> None:
    """Gymnasium's own checker finds nothing wrong; a registered setting is made, and truncated, by Gymnasium.

    `np_random_seed` after a reset without a seed is the seed of its world.
    """
    from gymnasium.utils.env_checker import check_env

    game = spec.make()
    played = game.reset(), game.state_hash()
    again = game.reset(seed=game.np_random_seed), game.state_hash()
    require(played == again, "np_random_seed after a reset without a seed brings another world: draw from np_random")
    if spec.id not in GAMES:
        check_env(spec.make(), skip_render_check=True)  # it asks Gymnasium's registry for the render modes
        return
    made = gymnasium.make(f"smartplay/{spec.id}")
    check_env(made.unwrapped)
    steps = None if made.spec is None else made.spec.max_episode_steps
    require(steps in (None, spec.rollout), f"gymnasium.make ends it after {steps} steps, not {spec.rollout}")


@_check
def leaves_to_text_game_what_all_games_have_in_common(spec: GameSpec) -> None:
    """Actions, `info` and the history are `TextGame`'s: a game defines `_reset`, `_step` and `_state`."""
    kind = spec.load()
    own = [name for name in COMMON if getattr(kind, name) is not getattr(TextGame, name)]
    require(not own, f"{kind.__name__} overrides {', '.join(own)} of TextGame: define `_step` instead")


@_check
def goes_on_alike_after_copy_and_pickle(spec: GameSpec) -> None:
    """A deep copy and a pickle of a game in play go on as the game does."""
    made = _begun(spec)
    *_, last = random_walk(made, 3)
    twins = {"a deep copy": copy.deepcopy(made), "a pickle": pickle.loads(pickle.dumps(made))}
    for name, twin in twins.items():
        require(twin.state_hash() == made.state_hash(), f"{name} has another state hash")
    _, _, terminated, truncated, *_ = last
    if not (terminated or truncated):
        walk = random_walk(made, 20, seed=1)
        for name, twin in twins.items():
            require(random_walk(twin, 20, seed=1) == walk, f"{name} continues differently")


@_check
def refuses_what_is_no_seed(spec: GameSpec) -> None:
    """What is not a whole number from 0 up raises one sentence and changes nothing."""
    made = _begun(spec)
    made.step(0)
    before = made.state_hash()
    for seed in NO_SEEDS:
        try:
            made.reset(seed=seed)  # type: ignore[arg-type]
        except InvalidArgumentError as error:
            told = "seed must be a whole number, 0 or more, not " in str(error)
            require(told, f"the seed {seed!r} is refused with {str(error)!r}")
        else:
            raise AssertionError(f"The seed {seed!r} is not refused.")
    require(made.state_hash() == before, "a refused seed has changed the game")


@_check
def numbers_its_actions_as_its_manual_does(spec: GameSpec) -> None:
    """Each number in the manual is the action it names, and the tool `act` lists them alike."""
    made = _begun(spec)
    tools = Tools(made, Wording.of(VERSION))
    act = next(spec for spec in tools.specs if spec.name == "act")
    for number, name in enumerate(made.numbered_actions, start=1):
        require(f"\n{number}. {name}" in made.manual, f"the manual has no line '{number}. {name}'")
        require(f"\n{number}. {name}" in act.description, f"the tool `act` has no line '{number}. {name}'")
        for sent in (f"{number}", f"{number}.", f" {number}. {name} ", name.upper(), f"{name.removesuffix('.')}."):
            action = tools.parse("act", read({"action": sent})).action
            require(action is not None and made.actions[action] == name, f"{sent!r} is not taken as {name!r}")


@_check
def is_played_and_replayed_through_its_tools(spec: GameSpec) -> None:
    """Random play through the tools ends by the game or its rollout, and its record is replayed identically."""
    spec = dataclasses.replace(spec, rollout=min(spec.rollout, LONGEST_WALK))
    record: list[Event] = []
    with Episode(spec, seed=2, transcript=record) as episode:
        result = play(episode, get_player("random", seed=2))
    require(result.end_reason in ("terminated", "rollout"), f"it ended as {result.end_reason}: {result.error}")
    require(result.steps <= spec.rollout, f"it took {result.steps} steps of {spec.rollout}")
    mistakes = result.illegal_actions + result.malformed_calls
    require(mistakes == 0, f"{mistakes} legal actions were taken for mistakes")
    if spec.id in GAMES:  # a record names its setting
        replayed = replay(json.loads(json.dumps(record)))
        require(replayed.identical, f"its record is not replayed identically: {replayed.differences[:1]}")


@_check
def scores_within_its_bounds(spec: GameSpec) -> None:
    """Every score of random play is within `score_bounds`, and one of the two if the setting is `two_valued`."""
    require(spec.score_bounds is not None or not spec.two_valued, "it is two-valued and declares no score_bounds")
    if spec.score_bounds is None:
        return
    low, high = spec.score_bounds
    for seed in range(2 if spec.load().is_slow else SCORED_EPISODES):
        for score in _scores(spec, seed):
            require(low <= score <= high, f"it scores {score:g}, outside of {low:g} to {high:g}")
            require(
                not spec.two_valued or score in (low, high),
                f"it is two_valued, and scores {score:g}, which is neither bound",
            )


@_check
def adds_no_less_than_its_worst_step(spec: GameSpec) -> None:
    """No step adds less to the score than `worst_step`, nor more than `best_step`."""
    if spec.worst_step is None and spec.best_step is None:
        return
    for seed in range(SCORED_EPISODES):
        added = [after - before for before, after in itertools.pairwise(_scores(spec, seed))]
        for name, end, sign in (("worst_step", min(added), 1), ("best_step", max(added), -1)):
            declared = getattr(spec, name)  # a sum of floats is rounded
            holds = declared is None or sign * end >= sign * declared or math.isclose(end, declared)
            require(holds, f"a step adds {end:g} to the score, and {name} is {declared}")


@_check
def is_the_same_in_another_process(spec: GameSpec) -> None:
    """Another process, in which sets have another order, plays the same seeds and actions alike."""
    defined_here = getattr(spec.entry_point, "__module__", None) == "__main__"
    if defined_here and not hasattr(sys.modules["__main__"], "__file__"):
        return  # no other process can import a notebook
    path = None if spec.file is None else IN_FILES.recorded(spec.file, spec.sha256).path
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    named = spec if spec.file is None else f"{path}:{spec.file.rpartition(':')[2]}"
    process = context.Process(target=_tell, args=(theirs, named), daemon=True)
    other_order = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    with patch.dict(os.environ, PYTHONHASHSEED=other_order):  # of sets
        process.start()
    theirs.close()
    try:
        require(ours.poll(SECONDS), f"another process has not played two short walks in {SECONDS:g} seconds")
        there = ours.recv()
    except EOFError:
        raise AssertionError("Another process cannot import the game: have its class in a module or a file.") from None
    finally:
        process.kill()
        process.join()
    require(
        there == _played(spec),
        "the same seed and actions play differently in another process: is the order of a set used, or anything of the "
        "machine?",
    )


def _tell(connection: Connection, game: Setting) -> None:
    """Send what is seen in a game; runs in the other process."""
    connection.send(_played(game))


def _played(game: Setting) -> list[str]:
    """Play some steps of two seeds; return what was seen, and the text that explains it."""
    spec = get_spec(game)
    made, seen = spec.make(), []
    for seed in (1, 2):
        seen += [repr(made.reset(seed=seed)), *map(repr, random_walk(made, _steps(spec))), repr(made.drawing())]
    return [made.manual, *made.actions, *seen]


def _begun(spec: GameSpec) -> TextGame:
    made = spec.make()
    made.reset(seed=5)
    return made


def _scores(spec: GameSpec, seed: int) -> list[float]:
    """Return the score before the first step of random play, and after each."""
    made, scores = spec.make(), list[float]()
    made.reset(seed=seed)
    random_walk(made, _walk(spec), seed, look=lambda game: scores.append(game.score))
    return [*scores, made.score]


def _walk(spec: GameSpec) -> int:
    """The length of a walk."""
    return min(spec.rollout, LONGEST_WALK)


def _steps(spec: GameSpec) -> int:
    """The length of a short walk."""
    return 8 if spec.load().is_slow else min(spec.rollout, 40)


def _require_json(name: str, value: Any) -> None:
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise AssertionError(
            f"`{name}` is not JSON: {error}. It is of Python's numbers, texts, lists and dictionaries."
        ) from error
