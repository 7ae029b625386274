"""`check_game` names the mistakes that are planted in a text game and in a game around a Gymnasium environment.

Each is a change of one or two places, and the sentence that names the rule.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from smartplay_tools.errors import UnknownNameError
from smartplay_tools.games import specs
from smartplay_tools.testing import check_game
from tests.games.test_contract import IN_THIS_PROCESS
from tests.games.test_gymnasium_game import COINS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "add-a-game.md").read_text(encoding="utf-8")
TEXT_GAME = re.findall(r"^```python\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)[0]
GYMNASIUM_GAME = (ROOT / "tests" / "data" / "treasure.py").read_text(encoding="utf-8")

SEED = "the seed alone decides it"
DIFFERS = "The same seed and actions differ at step"
SURVIVES = "something survives it, such as a counter"
MISSES = "`_state` misses something that decides the future"
LOOKING = "Asking for `drawing`, `needs` or `breaks` changes the game"
PROCESS = "play differently in another process"
SPACE = "An observation is empty, longer, or of other characters than its observation space"

RETURNS = 'return describe(guess, verdict), verdict == "right", self.completed, False'
THINKS = "self._secret = self._think()\n        return START"
DRAWS = 'line = "".join'
DRAWN = 'return {"text": f"{line}  {self.score} of {GOAL} found"}'
BOUNDS = "score_bounds=(0, GOAL),"
INTEGERS = "int(self.np_random.integers(1, HIGHEST + 1))"
THINK = "    def _think(self)"


def counting(returns: str) -> list[tuple[str, str]]:
    """Have each instance count its steps, in `self.n`."""
    return [(RETURNS, f"self.n = getattr(self, 'n', 0) + 1; {returns}")]


def thinking(more: str) -> list[tuple[str, str]]:
    """Have a reset do more than draw a number."""
    return [(THINKS, f"self._secret = self._think()\n        {more}\n        return START")]


def overriding(head: str, value: str, decorator: str = "") -> tuple[str, str]:
    return THINK, f"{decorator}    def {head}:\n        return {value}\n\n{THINK}"


def declaring(name: str, value: str) -> tuple[str, str]:
    return overriding(f"{name}(self)", value, "    @property\n")


IN_A_TEXT_GAME = {
    "another source of randomness": (
        [(INTEGERS, "__import__('random').randint(1, HIGHEST)")],
        "global stream of random",
    ),
    "a clock in the text": (
        [(RETURNS, RETURNS.replace("describe(guess", "describe(1 + __import__('time').time_ns() // 100 % 9"))],
        DIFFERS,
    ),
    "a text over its bound": ([("max(map(len, texts))", "max(map(len, texts)) - 5")], SPACE),
    "an empty text": ([("START = f", "START = '' and f")], SPACE),
    "characters that are not named": ([('"".join(texts) + "0123456789"', '"abc"')], SPACE),
    "an observation that is no text": ([(RETURNS, RETURNS.replace("describe(guess, verdict)", "guess"))], "not a text"),
    "an action that the manual misses": (
        [("(MANUAL, ACTIONS)", "(MANUAL, ACTIONS[:-1])")],
        "has no line '16. Guess 16'",
    ),
    "two actions of one name": (
        [('f"Guess {number}"', 'f"Guess {max(2, number)}"')],
        "Two actions of HigherOrLower have the name 'Guess 2'",
    ),
    "another number of actions": (
        [(BOUNDS, f"{BOUNDS} action_count=4,")],
        "ction_count is 4, and the game has 16 actions",
    ),
    "bounds that are too low": ([(BOUNDS, "score_bounds=(0, 1),")], "It scores 2, outside of 0 to 1"),
    "scores between two values": ([(BOUNDS, f"{BOUNDS} two_valued=True,")], "It is two_valued, and scores 1"),
    "a best step that is too small": (
        [(BOUNDS, f"{BOUNDS} best_step=0,")],
        "A step adds 1 to the score, and best_step is 0",
    ),
    "a step below the worst": (
        [("self.score += 1\n", "self.score -= 3\n"), (BOUNDS, "worst_step=-1,")],
        "adds -3 to the",
    ),
    "a seed that is not refused": (
        [overriding("reset(self, *, seed=None, options=None)", "super().reset(seed=0 if seed == 'x' else seed)")],
        "The seed 'x' is not refused",
    ),
    "a hash without the seed": (
        [(INTEGERS, "3"), overriding("state_hash(self)", "f'{self._steps:016}{self.score:016}'")],
        "everal seeds give the same state hash",
    ),
    "a step of its own": (
        [overriding("step(self, action)", "super().step(0)")],
        "HigherOrLower overrides step of TextGame: define `_step` instead",
    ),
    "a state that changes when asked": (
        [("return self._secret\n", f"return {INTEGERS}\n")],
        "sking for the state hash changes it",
    ),
    "a drawing that changes the game": ([(DRAWS, f"self._secret = 1 + self._secret % HIGHEST; {DRAWS}")], LOOKING),
    "a drawing that raises": ([(DRAWS, f"1 / 0; {DRAWS}")], "Asking for `drawing` raises ZeroDivisionError"),
    "a drawing that is no JSON": ([(DRAWN, "return {'text': {1, 2}}")], "`drawing` is not JSON"),
    "needs that are not yet": (
        [declaring("needs", "[self._steps + 1]")],
        r"`needs` has \[1\] after step 0: it is of 0 to 0",
    ),
    "needs that draw numbers": ([declaring("needs", "[0 * int(self.np_random.integers(3))]")], LOOKING),
    "needs beyond the memory": (
        [declaring("needs", "[0]"), (BOUNDS, "memory=2,")],
        "`needs` goes 3 steps back, and memory",
    ),
    "a name of what breaks": ([declaring("breaks", "['Guess 1']")], "`breaks` has \\['Guess 1'\\] after step 0"),
    "a step limit of the game's own": (
        counting(RETURNS.replace("False", "self.n >= 7")),
        SURVIVES,
    ),
    "a counter of the class": (
        thinking("type(self).n = getattr(self, 'n', 0) + 1; self._secret = 1 + (self._secret + self.n) % HIGHEST"),
        SEED,
    ),
    "guesses that the state misses": (
        [
            ("guess = action + 1\n", "guess = action + 1; self.n += guess; self._secret *= bool(self.n % 5)\n"),
            ("return self._secret\n", "return 0\n"),
            *thinking("self.n = 0"),
        ],
        MISSES,
    ),
    "the order of a set": ([('START = f"', "START = ' '.join({*map(str, range(20))}) + f\"")], PROCESS),
}

COUNTS = "self.n = getattr(self, 'n', 0) + 1"
LINE = 'return f"You are on square {place}.'

IN_A_GYMNASIUM_GAME = {
    "an environment for all instances": (
        [("class TreasureGame", "ENV = Treasure()\n\n\nclass TreasureGame"), ("return Treasure()", "return ENV")],
        DIFFERS,
    ),
    "a description that counts": ([(LINE, f"{COUNTS}\n        {LINE} {{self.n}}")], SURVIVES),
    "a description that is no text": (
        [(LINE, f"return place\n        {LINE}")],
        "What `describe` says of the reset is 0, and not a text",
    ),
    "no manual": ([('manual = "Find', 'words = "Find')], "has no manual: a game around"),
    "a state that is what was seen": (
        [
            ("    def drawing", "    def _state(self):\n        return [0]\n\n    def drawing"),
            ("found = action", "self.treasure = 1 + (self.treasure + action) % 4\n        found = action"),
        ],
        MISSES,
    ),
}


@pytest.fixture(autouse=True)
def _alone(monkeypatch, tmp_path):
    """Files of games are known for one test."""
    monkeypatch.setattr(specs.IN_FILES, "read", {})
    monkeypatch.chdir(tmp_path)


def planted(code: str, changes: list[tuple[str, str]]) -> str:
    """Write a game with mistakes to a file; return its name."""
    for before, after in changes:
        assert before in code, before
        code = code.replace(before, after)
    Path("planted.py").write_text(code, encoding="utf-8")
    return "planted.py:SPEC"


@pytest.mark.slow
@pytest.mark.parametrize("code", [TEXT_GAME, GYMNASIUM_GAME], ids=["text", "gymnasium"])
def test_a_game_without_a_mistake_passes(code):
    check_game(planted(code, []))


def rows(mistakes: dict[str, tuple[list[tuple[str, str]], str]]) -> list[Any]:
    """A row for each mistake; those that another process shows are for the slow tests."""
    marks = {True: pytest.mark.slow, False: ()}
    return [pytest.param(*mistake, id=name, marks=marks[mistake[1] == PROCESS]) for name, mistake in mistakes.items()]


@pytest.mark.parametrize(("changes", "sentence"), rows(IN_A_TEXT_GAME))
def test_a_mistake_in_a_text_game_is_named(changes, sentence):
    with pytest.raises(AssertionError, match=sentence):
        check_game(planted(TEXT_GAME, changes))


@pytest.mark.parametrize(("changes", "sentence"), rows(IN_A_GYMNASIUM_GAME))
def test_a_mistake_in_a_game_around_gymnasium_is_named(changes, sentence):
    with pytest.raises(AssertionError, match=sentence):
        check_game(planted(GYMNASIUM_GAME, changes))


def test_an_environment_that_draws_from_the_global_streams_needs_streams_of_its_own(monkeypatch):
    monkeypatch.setattr(COINS.entry_point, "uses_global_streams", False)
    with pytest.raises(AssertionError, match="moves the global stream of random"):
        check_game(COINS)


def test_a_state_that_the_random_stream_decides_may_leave_it_out():
    """The stream is part of the hash, so what it decided needs no other place."""
    game = planted(TEXT_GAME, [("return self._secret\n", "return 0\n")])
    for check in IN_THIS_PROCESS:
        check(game)


def test_an_unknown_game_is_no_mistake_of_a_game():
    with pytest.raises(UnknownNameError):
        check_game("Nowhere-v0")
