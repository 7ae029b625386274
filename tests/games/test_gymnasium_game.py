"""GymnasiumGame: any environment with named actions as a text game; what it declares is on record and never shown."""

import copy
import enum
import pickle
import random

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

import smartplay_tools as sp
from smartplay_tools.games import GymnasiumGame, TextGame
from smartplay_tools.testing import check_game


class Coins(gymnasium.Env):
    """Guess a coin that is thrown with the global streams; it cannot be copied, and does not show its state."""

    action_space = spaces.Discrete(2)
    observation_space = spaces.Discrete(2)

    def __init__(self):
        self.uncopied = (number for number in range(3))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.throws, self.coin = 0, random.randrange(2)
        return self.coin, {"throws": 0}

    def step(self, action):
        self.throws += 1
        right = action == self.coin
        self.coin = random.randrange(2) ^ int(np.random.random() < 0.5)
        return self.coin, 1.0 if right else -1.0, self.throws == 12, False, {"throws": self.throws}


class CoinsGame(GymnasiumGame):
    """The coins in words."""

    actions = ("Heads", "Tails")
    manual = "Say how the coin lies."

    def make_env(self):
        return Coins()

    def describe(self, observation, info):
        return f"Throw {info['throws']}: {self.actions[observation]}."

    @property
    def needs(self):
        return [self.env_info["throws"]]

    @property
    def breaks(self):
        return [1 - self.env_observation]


COINS = sp.GameSpec(
    id="Coins-v0", family="coins", entry_point=CoinsGame, history=5, rollout=20, trials=3, score_bounds=(-12, 12),
    memory=0, worst_step=-1,
)  # fmt: skip


@pytest.mark.slow
def test_an_environment_in_a_few_lines_keeps_the_contract_of_games():
    check_game(COINS)


def test_the_score_is_the_sum_of_the_rewards_and_a_rewarded_end_completes_it():
    game = COINS.make()
    game.reset(seed=1)
    for _ in range(12):
        *_, reward, terminated, truncated = game.advance(game.env_observation)
    assert (game.score, reward, terminated, truncated, game.completed) == (12, 1, True, False, True)


def test_the_global_streams_of_the_program_are_neither_read_nor_moved():
    def play():
        game = COINS.make()
        game.reset(seed=3)
        return [game.step(0)[0] for _ in range(12)]

    first = play()
    random.seed(5)
    np.random.seed(5)
    np.random.standard_normal()  # keeps the second of two numbers, which is not part of the bit generator's state
    before, drawn = random.getstate(), np.random.get_state()
    assert play() == first
    assert random.getstate() == before
    assert all(np.array_equal(one, other) for one, other in zip(np.random.get_state(), drawn, strict=True))


def test_a_game_whose_environment_cannot_be_copied_is_copied_by_playing_again():
    game = COINS.make()
    game.reset(seed=3)
    game.step(0)
    copies = [copy.deepcopy(game), pickle.loads(pickle.dumps(game))]
    after = [[each.step(action) for action in (0, 1, 1)] for each in (game, *copies)]
    assert after == [after[0]] * 3
    assert len({each.state_hash() for each in (game, *copies)}) == 1


def test_what_a_game_declares_about_an_action_is_on_record_and_in_no_prompt():
    record = []
    with sp.Episode(COINS, seed=1, transcript=record) as episode:
        coin = episode.game.env_observation
        result = episode.call("act", {"action": "Heads"})
        assert (result.data["action"], result.data["needs"], result.data["breaks"]) == (0, [0], [1 - coin])
        assert "needs" not in result.text
    with sp.Episode("Hanoi3Disk-v0", seed=1) as episode:
        assert not {"action", "needs", "breaks"} & episode.call("act", {"action": "1"}).data.keys()


class Levers(gymnasium.Env):
    """Two levers at once."""

    observation_space = spaces.Discrete(1)

    def __init__(self, action_space):
        self.action_space = action_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return 0, {}

    def step(self, action):
        assert action in self.action_space
        parts = action.values() if isinstance(action, dict) else action
        return 0, 0.0, False, False, {"pulled": tuple(int(number) for part in parts for number in np.ravel(part))}


def levers(space, actions=(("up", "down"), ("left", "middle", "right")), **more):
    given = {"make_env": lambda: Levers(space), "actions": actions, "manual": "Pull.", "history": 0, **more}
    return GymnasiumGame(describe=lambda observation, info: str(info.get("pulled", "none")), **given)


@pytest.mark.parametrize(
    "space",
    [
        spaces.MultiDiscrete([2, 3]),
        spaces.Tuple([spaces.Discrete(2), spaces.Discrete(3)]),
        spaces.Tuple([spaces.MultiBinary(1), spaces.MultiDiscrete([3])]),
        spaces.Dict({"a": spaces.Discrete(2), "b": spaces.Tuple([spaces.Discrete(3)])}),
    ],
    ids=str,
)
def test_actions_of_several_parts_have_every_combination_of_their_names(space):
    game = levers(space)
    assert game.actions[:4] == ("up, left", "up, middle", "up, right", "down, left")
    assert "\n4. down, left" in game.manual
    game.reset(seed=1)
    assert game.step(game.actions.index("down, middle"))[0] == "(1, 1)"


def test_actions_that_are_no_list_are_named_by_action_of():
    box = spaces.Box(-1, 1, (1,))
    game = levers(box, ("back", "forward"), action_of=lambda name: np.float32([-1 if name == "back" else 1]))
    game.reset(seed=1)
    assert game.step(1)[0] == "(1,)"


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: levers(spaces.Box(-1, 1, (2,))), "is not a list of choices: define action_of"),
        (lambda: levers(spaces.MultiDiscrete([2, 2])), "names 6 actions, and its environment has 4"),
        (lambda: levers(spaces.Discrete(257), list(map(str, range(257)))), "257 actions cannot be listed by name"),
        (lambda: levers(None, (("a", "b"),) * 9), "512 actions cannot be listed by name, only up to 256"),
        (lambda: levers(spaces.Discrete(3), ("Go", "go.", "Stay")), "Two actions of GymnasiumGame have the name 'go.'"),
        (lambda: levers(None, (("a", "a, b"), ("b, c", "c"))), "Two actions of GymnasiumGame have the name 'a, b, c'"),
        (lambda: levers(None, (("up", "down"), "left")), "actions are names, which are texts, members of an Enum or"),
        (lambda: levers(None, ("a", "b")).reset(seed=1), "are None, which is not a list of choices"),
        (lambda: GymnasiumGame(manual="Play.", history=0), "GymnasiumGame has no actions: a game around"),
        (lambda: GymnasiumGame(actions=["Go"], manual="Play.", history=0), "GymnasiumGame has no make_env"),
        (lambda: type("Silent", (CoinsGame,), {"describe": GymnasiumGame.describe})(history=0).reset(), "no describe"),
    ],
)
def test_what_cannot_be_played_is_refused_in_one_sentence(make, sentence):
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        make()


class Moves(enum.IntEnum):
    """Actions as MiniGrid and others name them."""

    LEFT = 0
    RIGHT = 1


@pytest.mark.parametrize(
    ("actions", "names"),
    [
        (Moves, ("LEFT", "RIGHT")),
        (tuple(Moves), ("LEFT", "RIGHT")),
        (range(2), ("0", "1")),
        (tuple(np.arange(2)), ("0", "1")),
    ],
)
def test_members_of_an_enum_and_numbers_are_names(actions, names):
    assert levers(spaces.Discrete(2), actions).actions == names


class Foreign(gymnasium.Env):
    """An environment with another interface: what its reset and its step return is given."""

    observation_space = action_space = spaces.Discrete(2)

    def __init__(self, reset=(0, {}), step=(0, 1.0, False, False, {}), *, has_seed=True):
        self.given, self.returned = reset, step
        if not has_seed:
            self.reset = lambda: 0

    def reset(self, *, seed=None, options=None):
        return self.given

    def step(self, action):
        return self.returned


@pytest.mark.parametrize(
    ("env", "sentence"),
    [
        (Foreign(0), "reset does not return an observation and an info: wrap one of Gym 0.21 in shimmy.GymV21Compat"),
        (Foreign(np.zeros(2)), "Foreign is no Gymnasium environment, since its reset does not return"),
        (Foreign(has_seed=False), "its reset takes no seed: wrap one of Gym 0.21"),
        (Foreign(step=(0, 1.0, True, {})), "its step returns 4 values instead of 5: wrap one of Gym 0.21 in shimmy"),
        (Foreign(step=(0, 1.0, 0.0, True, False, {})), "6 values instead of 5.*SafetyGymnasium2Gymnasium"),
        (Foreign(step=(0, np.ones(3), True, False, {})), "step 1 is of the type ndarray, with 3 parts.*LinearReward"),
        (Foreign(step=(0, [1.0, 2.0], True, False, {})), r"type list, with 2 parts.*TransformReward\(env, sum\)"),
    ],
)
def test_an_environment_with_another_interface_is_refused_with_its_wrapper(env, sentence):
    game = levers(None, ("a", "b"), make_env=lambda: env)
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        game.reset(seed=1), game.step(0)


def test_a_space_that_a_reset_makes_is_read_then():
    class Late(Levers):
        def reset(self, *, seed=None, options=None):
            self.action_space = spaces.MultiDiscrete([2, 3])
            return super().reset(seed=seed)

    game = levers(None, make_env=lambda: Late(None))
    game.reset(seed=1)
    assert game.step(game.actions.index("down, middle"))[0] == "(1, 1)"


def test_a_text_game_need_not_bound_its_texts():
    class Echo(TextGame):
        actions, manual = ("Call",), "Call."

        def _reset(self):
            return "…"

        def _step(self, action):
            return "é" * 4_000, 0, False, False

        def _state(self):
            return 0

    game = Echo(history=0)
    assert game.reset(seed=1)[0] in game.observation_space
    assert game.step(0)[0] in game.observation_space
    assert "a" * 4_001 not in game.observation_space
    assert game.observation_space.sample() in game.observation_space
