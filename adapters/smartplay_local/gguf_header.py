"""What a GGUF file says of itself: the beginning of the file, without the weights.

The format: a magic word, the version, the number of tensors and of facts; then the facts (name, type, value), then for
each tensor its name, its shape, its type and where its weights begin. Numbers are little-endian.
https://github.com/ggml-org/ggml/blob/master/docs/gguf.md
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from smartplay_tools.errors import InvalidArgumentError

MAGIC = b"GGUF"
VERSIONS = (2, 3)

STRING, ARRAY = 8, 9
NUMBERS = {0: "B", 1: "b", 2: "H", 3: "h", 4: "I", 5: "i", 6: "f", 7: "?", 10: "Q", 11: "q", 12: "d"}
"""The types of numbers, as `struct` spells them."""

LONGEST = 10_000_000
"""No intact file has a text of more bytes, or a list of more values."""

CACHE_BYTES = 2
"""Bytes of a number in the cache of keys and values, which is kept in half precision."""

WORK_BYTES = 300 * 2**20
"""What the engine takes in addition to weights and cache: its buffers, for a model of 135 million parameters."""


@dataclass(frozen=True)
class GGUF:
    """A model file's facts."""

    path: Path
    facts: dict[str, Any]
    """The metadata, such as `general.architecture` and `tokenizer.ggml.tokens`."""
    bytes: int
    """The file's size."""

    def fact(self, name: str, default: int = 0) -> int:
        """Return a number of the model's architecture, such as `context_length`."""
        value = self.facts.get(f"{self.facts.get('general.architecture')}.{name}", default)
        return max(value) if isinstance(value, list) else int(value)

    @property
    def context_length(self) -> int:
        """The longest prompt and reply, in tokens, that the model was trained on."""
        return self.fact("context_length")

    def memory(self, context: int) -> int:
        """Return about how many bytes it takes to play with a context of this many tokens."""
        heads = self.fact("attention.head_count", 1)
        width = self.fact("attention.key_length") or self.fact("embedding_length") // heads
        of_a_token = 2 * self.fact("block_count") * self.fact("attention.head_count_kv", heads) * width * CACHE_BYTES
        return self.bytes + context * of_a_token + WORK_BYTES


def read_gguf(path: str | Path) -> GGUF:
    """Return what a model file says of itself; a file that is missing, truncated or in another format is refused."""
    file = Path(path).expanduser()
    try:
        size = file.stat().st_size
        with file.open("rb") as stream:
            facts, last = _read(stream)
    except (FileNotFoundError, IsADirectoryError):
        raise InvalidArgumentError(f"There is no model file {path}.") from None
    except OSError as error:
        raise InvalidArgumentError(f"The model file {path} cannot be read: {error.strerror}.") from None
    except (struct.error, ValueError, KeyError):
        raise InvalidArgumentError(f"{path} is not a complete GGUF file; download it again.") from None
    if size <= last:
        raise InvalidArgumentError(f"{path} ends before its last weights; download it again.")
    return GGUF(file, facts, size)


def _read(stream: BinaryIO) -> tuple[dict[str, Any], int]:
    """Return the facts, and where the last tensor begins."""
    if stream.read(4) != MAGIC or _number(stream, "I") not in VERSIONS:
        raise ValueError("another format")
    tensors, count = _number(stream, "Q"), _number(stream, "Q")
    facts = {_text(stream): _value(stream, _number(stream, "I")) for _ in range(_limited(count))}
    offsets = [0]
    for _ in range(_limited(tensors)):
        _text(stream)
        for _ in range(_limited(_number(stream, "I"))):
            _number(stream, "Q")
        _number(stream, "I")
        offsets.append(_number(stream, "Q"))
    return facts, stream.tell() + max(offsets)


def _value(stream: BinaryIO, kind: int) -> Any:
    if kind == STRING:
        return _text(stream)
    if kind != ARRAY:
        return _number(stream, NUMBERS[kind])
    inner, length = _number(stream, "I"), _limited(_number(stream, "Q"))
    if inner in NUMBERS:
        letters = f"<{length}{NUMBERS[inner]}"
        return list(struct.unpack(letters, stream.read(struct.calcsize(letters))))
    return [_value(stream, inner) for _ in range(length)]


def _text(stream: BinaryIO) -> str:
    length = _limited(_number(stream, "Q"))
    text = stream.read(length)
    if len(text) < length:
        raise ValueError("the file ends within a text")
    return text.decode("utf-8", "replace")


def _number(stream: BinaryIO, letter: str) -> Any:
    return struct.unpack(f"<{letter}", stream.read(struct.calcsize(f"<{letter}")))[0]


def _limited(count: int) -> int:
    if count > LONGEST:
        raise ValueError("a number that no file has")
    return count
