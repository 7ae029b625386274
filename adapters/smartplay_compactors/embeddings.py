"""A memory with vectors of words: WordLlama, whose package brings its vectors along, so that nothing is downloaded."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import wordllama

from smartplay_tools import Message
from smartplay_tools.compactors.retrieval import MOST_TURNS, MemoryCompactor, text_of_turn

DECIMALS = 4
"""The decimals to which similarities are rounded, so that they order turns alike on every machine."""


class VectorMemory(MemoryCompactor):
    """Cosine similarity between the mean vectors of a turn's and the query's words, of 256 dimensions."""

    packages = ("wordllama",)

    def __init__(self, tokens: int = 300) -> None:
        super().__init__(tokens)
        self._texts: list[str] = []
        self._vectors: list[np.ndarray] = []

    def write(self, turn: Sequence[Message]) -> None:
        """Embed the words of the turn."""
        text = text_of_turn(turn)
        self._texts.append(f"Turn {len(self._texts)}:\n{text}")
        self._vectors.append(_vector(text))

    def read(self, query: str) -> str:
        """Return the turns by their similarity to the query, best first; of equal ones the newer."""
        similarities = np.round(np.stack(self._vectors) @ _vector(query), DECIMALS)
        best = sorted(range(len(self._texts)), key=lambda number: (-similarities[number], -number))
        return "\n".join(self._texts[number] for number in best[:MOST_TURNS])


def _vector(text: str) -> np.ndarray:
    return np.asarray(_model().embed([text], norm=True)[0])


@functools.cache
def _model() -> Any:
    # Its own search for its tokenizer looks into a folder that its package does not have.
    return wordllama.WordLlama.load(cache_dir=Path(wordllama.__file__).parent, disable_download=True)
