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
import itertools
import json
import pickle
import re
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np

from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.conversation.loop import play
from smartplay_tools.episode.episode import Episode
from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import InvalidArgumentError, ResetNeededError
from smartplay_tools.games.base import TextGame
from smartplay_tools.games.specs import GAMES, GameSpec, get_spec
from smartplay_tools.players import get_player
from smartplay_tools.records.replays import replay
from smartplay_tools.transcript.events import Event
from smartplay_tools.types.arguments import read

__all__ = ["CHECKS", "check_game", "random_walk"]

LONGEST_WALK = 100
"""Steps of random play in a check."""

LONGEST_EPISODE = 2_000
"""Steps after which a game is taken never to end by itself, unless its rollout is so short that fewer tell."""

SCORED_EPISODES = 3
"""Episodes of random play whose scores are compared with the bounds."""

NO_ACTIONS = (-1, 10**30, "1", "Noop", True, np.True_, 1.5, np.float32(1), None, [0], b"0")
NO_SEEDS = ("x", "1", -1, 1.5, True, [3], b"1")

Setting = str | GameSpec


def check_game(game: Setting) -> None:
    """Hold a game to every check of `CHECKS`."""
    for check in CHECKS:
        check(game)


def random_walk(game: TextGame, steps: int, seed: int = 0) -> list[tuple[Any, ...]]:
    """Play random actions until the game's end; return what each step gave, with the state hash after it."""
    rng = np.random.default_rng(seed)
    seen = []
    for _ in range(steps):
        observation, reward, terminated, truncated, info = game.step(int(rng.integers(len(game.actions))))
        seen.append((observation, reward, terminated, truncated, info, game.state_hash()))
        if terminated or truncated:
            break
    return seen


def is_a_gymnasium_environment(game: Setting) -> None:
    """Gymnasium's own checker finds nothing wrong; a registered setting is made, and truncated, by Gymnasium."""
    from gymnasium.utils.env_checker import check_env

    spec = get_spec(game)
    if not _is_registered(spec):
        check_env(spec.make(), skip_render_check=True)  # it asks Gymnasium's registry for the render modes
        return
    made = gymnasium.make(f"smartplay/{spec.id}")
    check_env(made.unwrapped)
    steps = None if made.spec is None else made.spec.max_episode_steps
    _require(steps in (None, spec.rollout), f"gymnasium.make ends it after {steps} steps, not {spec.rollout}")


def gives_the_info_of_the_original(game: Setting) -> None:
    """`info` has the fields of the original, and its history is the text of past observations."""
    made = get_spec(game).make()
    observation, info = made.reset(seed=1)
    expected = {"obs": observation, "manual": made.manual, "history": "", "score": 0, "completed": 0}
    _require(info == expected, f"info after the reset is {info}, not {expected}")
    following, *_, info = made.step(0)
    _require(list(info) == list(expected), f"info has the fields {list(info)}, not {list(expected)}")
    _require(info["obs"] == following == made.observation, "info['obs'] is not the observation")
    history = (
        f"Most recent 1 steps of the player's in-game observation:\n\nPlayer Observation Step 0:\n{observation}"
        if made.history != 0
        else ""
    )
    _require(info["history"] == history, f"info['history'] is {info['history']!r}, not {history!r}")


def keeps_as_much_history_as_it_is_given(game: Setting) -> None:
    """With `history=2` the history text holds the two observations before the current one."""
    made = get_spec(game).make(history=2)
    first, _ = made.reset(seed=3)
    observations = [first, *(step[0] for step in random_walk(made, 4))]
    if len(observations) == 5:  # short games end before the history is full
        expected = (
            "Most recent 2 steps of the player's in-game observation:\n\n"
            f"Player Observation Step 2:\n{observations[2]}\n\nPlayer Observation Step 3:\n{observations[3]}"
        )
        _require(made.recent() == expected, f"the history is {made.recent()!r}, not {expected!r}")
        _require(made.recent(0) == "", "the history of no steps is not empty")


def is_decided_by_seed_and_actions(game: Setting) -> None:
    """Equal seeds and equal actions give equal observations, rewards and state hashes."""
    made, other = get_spec(game).make(), get_spec(game).make()
    _require(made.reset(seed=9) == other.reset(seed=9), "the same seed gives another first observation")
    _require(made.state_hash() == other.state_hash(), "the same seed gives another state hash")
    pairs = zip(random_walk(made, 40), random_walk(other, 40), strict=True)
    for step, (was, now) in enumerate(pairs, start=1):
        _require(was == now, f"the same seed and actions differ at step {step}: {was} and {now}")


def differs_between_seeds(game: Setting) -> None:
    """Other seeds are other episodes."""
    made, hashes = get_spec(game).make(), set()
    for seed in (*range(8), 2**32, 2**64, 10**40):
        made.reset(seed=seed)
        hashes.add(made.state_hash())
    _require(len(hashes) == 11, "several seeds give the same state hash")


def goes_on_alike_after_copy_and_pickle(game: Setting) -> None:
    """A deep copy and a pickle of a game in play go on as the game does."""
    made = _begun(game)
    random_walk(made, 3)
    twins = {"a deep copy": copy.deepcopy(made), "a pickle": pickle.loads(pickle.dumps(made))}
    for name, twin in twins.items():
        _require(twin.state_hash() == made.state_hash(), f"{name} has another state hash")
    if made.observation and _is_playing(made):
        walk = random_walk(made, 20, seed=1)
        for name, twin in twins.items():
            _require(random_walk(twin, 20, seed=1) == walk, f"{name} continues differently")


def refuses_a_step_before_the_reset(game: Setting) -> None:
    """A step before the first reset raises `ResetNeededError`."""
    made = get_spec(game).make()
    for action in (0, "x"):
        _refuses(ResetNeededError, r"call reset\(\)", made.step, action)


def refuses_a_step_after_its_own_end(game: Setting) -> None:
    """A step after the game's own end raises `ResetNeededError` and changes nothing; a game without an end passes."""
    made = _begun(game)
    if not plays_to_its_end(made, min(LONGEST_EPISODE, get_spec(game).rollout + 60)):
        return
    last = made.state_hash(), made.observation, made.score, made.recent()
    for step in (made.step, made.advance):
        _refuses(ResetNeededError, r"call reset\(\)", step, 0)
    now = made.state_hash(), made.observation, made.score, made.recent()
    _require(now == last, "a refused step has changed the game")
    made.reset()
    made.step(0)


def plays_to_its_end(game: TextGame, most_steps: int = LONGEST_EPISODE) -> bool:
    """Play a begun game, as well as it knows how or at random; return whether it has ended by itself."""
    rng = np.random.default_rng(1)
    for _ in range(most_steps):
        best = game.optimal_action
        _, _, terminated, truncated = game.advance(int(rng.integers(len(game.actions))) if best is None else best)
        if terminated or truncated:
            return True
    return False


def refuses_what_is_no_action(game: Setting) -> None:
    """What is not the number of an action raises one sentence and changes nothing."""
    made = _begun(game)
    before = made.state_hash(), made.recent()
    numbers = f"whole number from 0 to {len(made.actions) - 1}, not "
    for step, action in itertools.product((made.step, made.advance), (*NO_ACTIONS, len(made.actions))):
        _refuses(InvalidArgumentError, numbers, step, action)
    _require((made.state_hash(), made.recent()) == before, "a refused action has changed the game")


def refuses_what_is_no_seed(game: Setting) -> None:
    """What is not a whole number from 0 up raises one sentence and changes nothing."""
    made = _begun(game)
    made.step(0)
    before = made.state_hash()
    for seed in NO_SEEDS:
        _refuses(InvalidArgumentError, "seed must be a whole number, 0 or more, not ", _reset(made), seed)
    _require(made.state_hash() == before, "a refused seed has changed the game")


def takes_seeds_and_actions_of_numpy(game: Setting) -> None:
    """Seeds and actions may be numpy's integers."""
    made, played = _begun(game), []
    for seed, action in [(6, 0), (np.uint64(6), np.uint8(0)), (np.int32(6), np.array(0))]:
        played.append((made.reset(seed=seed), made.step(action), made.state_hash()))  # type: ignore[arg-type]
    _require(played == [played[0]] * 3, "numpy's integers play another game than Python's")


def says_only_what_its_observation_space_holds(game: Setting) -> None:
    """Every observation is within the observation space: no longer, and of no other characters."""
    made = _begun(game)
    walk = random_walk(made, min(get_spec(game).rollout, LONGEST_WALK))
    for observation in (made.observation, *(step[0] for step in walk)):
        _require(
            observation in made.observation_space,
            f"an observation is longer, or of other characters, than its observation space says: {observation!r}",
        )


def has_a_state_hash_that_changes_with_play(game: Setting) -> None:
    """The state hash is 128 bits, is the same when asked again, and changes with a step."""
    made = _begun(game)
    before = made.state_hash()
    _require(re.fullmatch("[0-9a-f]{32}", before) is not None, f"{before!r} is not a hash of 128 bits")
    _require(made.state_hash() == before, "asking for the state hash changes it")
    made.step(0)
    _require(made.state_hash() != before, "a step does not change the state hash")


def numbers_its_actions_as_its_manual_does(game: Setting) -> None:
    """Each number in the manual is the action it names, and the tool `act` lists them alike."""
    made = _begun(game)
    tools = Tools(made, Wording.of(VERSION))
    act = next(spec for spec in tools.specs if spec.name == "act")
    for number, name in enumerate(made.numbered_actions, start=1):
        _require(f"\n{number}. {name}" in made.manual, f"the manual has no line '{number}. {name}'")
        _require(f"\n{number}. {name}" in act.description, f"the tool `act` has no line '{number}. {name}'")
        for sent in (f"{number}", f"{number}.", f" {number}. {name} ", name.upper(), f"{name.removesuffix('.')}."):
            action = tools.parse("act", read({"action": sent})).action
            _require(action is not None and made.actions[action] == name, f"{sent!r} is not taken as {name!r}")


def is_played_and_replayed_through_its_tools(game: Setting) -> None:
    """Random play through the tools ends by the game or its rollout, and its record is replayed identically."""
    spec = get_spec(game)
    spec = dataclasses.replace(spec, rollout=min(spec.rollout, LONGEST_WALK))
    record: list[Event] = []
    with Episode(spec, seed=2, transcript=record) as episode:
        result = play(episode, get_player("random", seed=2))
    _require(result.end_reason in ("terminated", "rollout"), f"it ended as {result.end_reason}: {result.error}")
    _require(result.steps <= spec.rollout, f"it took {result.steps} steps of {spec.rollout}")
    mistakes = result.illegal_actions + result.malformed_calls
    _require(mistakes == 0, f"{mistakes} legal actions were taken for mistakes")
    if _is_registered(spec):  # a record names its setting
        replayed = replay(json.loads(json.dumps(record)))
        _require(replayed.identical, f"its record is not replayed identically: {replayed.differences[:1]}")


def scores_within_its_bounds(game: Setting) -> None:
    """Scores of random play are within `score_bounds`, and one of the two if the setting is `two_valued`."""
    spec = get_spec(game)
    _require(spec.score_bounds is not None or not spec.two_valued, "it is two-valued and declares no score_bounds")
    if spec.score_bounds is None:
        return
    low, high = spec.score_bounds
    for seed in range(SCORED_EPISODES):
        made = spec.make()
        made.reset(seed=seed)
        random_walk(made, min(spec.rollout, LONGEST_WALK), seed)
        _require(low <= made.score <= high, f"it scores {made.score:g}, outside of {low:g} to {high:g}")
        _require(not spec.two_valued or made.score in (low, high), f"it scores {made.score:g}, which is neither bound")


def refuses_an_option_that_it_does_not_know(game: Setting) -> None:
    """An option that the game does not name raises one sentence."""

    def begin(option: str) -> None:
        given: dict[str, Any] = {option: "red"}
        Episode(game, seed=0, **given).close()

    _refuses(InvalidArgumentError, "has no option colour_of_nothing", begin, "colour_of_nothing")


CHECKS: Sequence[Callable[[Setting], None]] = (
    is_a_gymnasium_environment,
    gives_the_info_of_the_original,
    keeps_as_much_history_as_it_is_given,
    is_decided_by_seed_and_actions,
    differs_between_seeds,
    goes_on_alike_after_copy_and_pickle,
    refuses_a_step_before_the_reset,
    refuses_a_step_after_its_own_end,
    refuses_what_is_no_action,
    refuses_what_is_no_seed,
    takes_seeds_and_actions_of_numpy,
    says_only_what_its_observation_space_holds,
    has_a_state_hash_that_changes_with_play,
    numbers_its_actions_as_its_manual_does,
    is_played_and_replayed_through_its_tools,
    scores_within_its_bounds,
    refuses_an_option_that_it_does_not_know,
)
"""All checks; each is a function of a setting, and its name completes the sentence "The game ..."."""


def _begun(game: Setting) -> TextGame:
    made = get_spec(game).make()
    made.reset(seed=5)
    return made


def _is_registered(spec: GameSpec) -> bool:
    return spec.id in GAMES


def _is_playing(game: TextGame) -> bool:
    try:
        copy.deepcopy(game).step(0)
    except ResetNeededError:
        return False
    return True


def _reset(game: TextGame) -> Callable[[Any], Any]:
    return lambda seed: game.reset(seed=seed)


def _require(holds: bool, sentence: str) -> None:
    if not holds:
        raise AssertionError(f"{sentence[0].upper()}{sentence[1:]}.")


def _refuses(error: type[Exception], pattern: str, function: Callable[[Any], Any], argument: Any) -> None:
    """Raise unless a call raises the error, with one sentence that matches the pattern."""
    try:
        function(argument)
    except error as raised:
        _require(re.search(pattern, str(raised)) is not None, f"{argument!r} is refused with {str(raised)!r}")
    except Exception as raised:
        raise AssertionError(f"{argument!r} raises {type(raised).__name__}, not {error.__name__}.") from raised
    else:
        raise AssertionError(f"{argument!r} is not refused with {error.__name__}.")
