"""The random stream of a compiled world: numpy's Mersenne Twister, with the same draws as `stream.Stream`.

At night every step draws 6,174 words for the noise of its picture, whether or not the picture is used. `skip` advances
the state past them without computing the numbers, which makes nights cheap.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.compiled.jit import inlined, kernel
from smartplay_tools.games.crafter.compiled.layout import KEY

_MIDDLE = 397
_LAG = KEY - _MIDDLE
_ZERO, _ONE = np.uint32(0), np.uint32(1)
_UPPER, _LOWER, _MATRIX = np.uint32(0x80000000), np.uint32(0x7FFFFFFF), np.uint32(0x9908B0DF)
_SHIFTS = np.uint32(11), np.uint32(7), np.uint32(15), np.uint32(18)
_MASKS = np.uint32(0x9D2C5680), np.uint32(0xEFC60000)
_FIVE, _SIX = np.uint32(5), np.uint32(6)
_SEED_FACTOR, _SEED_SHIFT = np.uint32(1812433253), np.uint32(30)


@kernel
def seed_stream(world: Any, seed: int) -> None:
    """Initialise the stream with a seed, as `numpy.random.RandomState(seed)` does."""
    key = world.key
    word = np.uint32(seed)
    for i in range(KEY):
        key[i] = word
        word = np.uint32(_SEED_FACTOR * (word ^ (word >> _SEED_SHIFT)) + np.uint32(i + 1))
    world.word = KEY


@inlined
def _mix(word: Any, following: Any, far: Any) -> Any:
    """The word that replaces `word` in the next state."""
    y = (word & _UPPER) | (following & _LOWER)
    return far ^ (y >> _ONE) ^ (_MATRIX if y & _ONE else _ZERO)


@kernel
def twist(key: Any) -> None:
    """Replace the state's words by the next ones. No loop reads what it has written, so each works on many at once."""
    for i in range(_LAG):
        key[i] = _mix(key[i], key[i + 1], key[i + _MIDDLE])
    for i in range(_LAG, 2 * _LAG):
        key[i] = _mix(key[i], key[i + 1], key[i - _LAG])
    for i in range(2 * _LAG, KEY - 1):
        key[i] = _mix(key[i], key[i + 1], key[i - _LAG])
    key[KEY - 1] = _mix(key[KEY - 1], key[0], key[_MIDDLE - 1])


@inlined
def temper(y: Any) -> Any:
    """The random word that follows from a word of the state."""
    y ^= y >> _SHIFTS[0]
    y ^= (y << _SHIFTS[1]) & _MASKS[0]
    y ^= (y << _SHIFTS[2]) & _MASKS[1]
    return y ^ (y >> _SHIFTS[3])


@inlined
def to_double(first: Any, second: Any) -> float:
    """The double from [0, 1) that is made of two random words."""
    return ((first >> _FIVE) * 67108864.0 + (second >> _SIX)) / 9007199254740992.0


@kernel
def draw_word(world: Any) -> Any:
    """Draw a word of 32 bits."""
    if world.word >= KEY:
        twist(world.key)
        world.word = 0
    y = world.key[world.word]
    world.word += 1
    return temper(y)


@kernel
def uniform(world: Any) -> float:
    """Draw a double from [0, 1)."""
    first = draw_word(world)
    return to_double(first, draw_word(world))


@kernel
def temper_all(key: Any, words: Any) -> None:
    """The random words that follow from all words of the state, for `next_uniform`."""
    for i in range(KEY):
        words[i] = temper(key[i])


@kernel
def _uniform_across(key: Any, words: Any, at: int) -> tuple[float, int]:
    """The next double, of which a word, or both, are from the next state."""
    last = words[KEY - 1]
    twist(key)
    temper_all(key, words)
    if at == KEY:
        return to_double(words[0], words[1]), 2
    return to_double(last, words[0]), 1


@inlined
def next_uniform(key: Any, words: Any, at: int) -> tuple[float, int]:
    """Draw a double from [0, 1) at a position in the state; return the position after it, too.

    The same as `uniform`, but faster if many numbers are drawn: `words` are those of the state, tempered at once.
    """
    if at + 2 > KEY:
        return _uniform_across(key, words, at)
    return to_double(words[at], words[at + 1]), at + 2


@kernel
def below(world: Any, bound: int) -> Any:
    """Draw an integer from 0 to `bound` - 1."""
    highest = bound - 1
    if highest == 0:
        return 0
    mask = 1
    while mask <= highest:
        mask *= 2
    mask -= 1
    value = np.int64(draw_word(world)) & mask
    while value > highest:
        value = np.int64(draw_word(world)) & mask
    return value


@kernel
def skip(world: Any, words: int) -> None:
    """Skip some words."""
    ahead = world.word + words
    while ahead > KEY:
        twist(world.key)
        ahead -= KEY
    world.word = ahead
