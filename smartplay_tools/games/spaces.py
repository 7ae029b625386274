"""The observation space of text games, which Gymnasium cannot share between processes."""

from __future__ import annotations

from typing import Any, NoReturn

from gymnasium import spaces
from gymnasium.vector.utils import create_shared_memory

from smartplay_tools.errors import InvalidArgumentError


class Words(spaces.Text):
    """Gymnasium's space of texts, except that an `AsyncVectorEnv` with shared memory refuses it.

    That class reads its shared memory once, when it is made. For arrays this gives a view of the memory. For a text it
    gives a copy of the content before the first reset, and every later observation is that copy.
    """


@create_shared_memory.register(Words)
def _refuse(space: Words, n: int = 1, ctx: Any = None) -> NoReturn:
    raise InvalidArgumentError(
        "Gymnasium's AsyncVectorEnv returns wrong texts from shared memory: pass shared_memory=False, in make_vec as "
        'vector_kwargs={"shared_memory": False}.'
    )
