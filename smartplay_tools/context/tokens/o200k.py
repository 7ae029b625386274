"""The vocabulary of `o200k_base`, which is part of the package, so counting is exact without a download.

The file holds the tokens in the order of their ranks, which are 0, 1, 2 and so on: first the length of each in a byte,
then their bytes, all compressed by zlib. That is smaller than the published file, a line of base64 for each token, and
is unpacked in a fifth of the time.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import struct
import zlib
from importlib import resources
from typing import TYPE_CHECKING

from smartplay_tools.errors import SmartPlayError
from smartplay_tools.installation import install_command

if TYPE_CHECKING:
    import tiktoken

TOKENS = 199_998
"""The number of tokens of the vocabulary, without its two special tokens."""

UNPACKED_SHA256 = "440741350e7cfa1c0f4869ce742d1b043550adbda5187adcac9e787edac6fba9"
"""The sha256 of the unpacked file."""

VOCABULARY_SHA256 = "446a9538cb6c348e3516120d7c08b09f57c36495e2acfffe59a5bf8b0cfb1a2d"
"""The sha256 of the published file, as returned by `vocabulary`; tiktoken pins the same."""


SPECIAL = {"<|endoftext|>": 199_999, "<|endofprompt|>": 200_018}
"""The special tokens, which texts never give."""

_UPPER, _LOWER = r"[\p{Lu}\p{Lt}\p{Lm}\p{Lo}\p{M}]", r"[\p{Ll}\p{Lm}\p{Lo}\p{M}]"
_START, _SUFFIX = r"[^\r\n\p{L}\p{N}]?", r"(?i:'s|'t|'re|'ve|'m|'ll|'d)?"
PATTERN = "|".join(
    [
        f"{_START}{_UPPER}*{_LOWER}+{_SUFFIX}",
        f"{_START}{_UPPER}+{_LOWER}*{_SUFFIX}",
        r"\p{N}{1,3}",
        r" ?[^\s\p{L}\p{N}]+[\r\n/]*",
        r"\s*[\r\n]+",
        r"\s+(?!\S)",
        r"\s+",
    ]
)
"""The pattern that cuts a text into pieces, which are encoded one by one; a test compares it with tiktoken's."""


@functools.cache
def o200k_base() -> tiktoken.Encoding:
    """Return the encoding: about a quarter of a second and 85 MB, once in a process."""
    import tiktoken

    return tiktoken.Encoding(
        "o200k_base",
        pat_str=PATTERN,
        mergeable_ranks=dict(zip(tokens(), range(TOKENS), strict=True)),
        special_tokens=SPECIAL,
    )


def tokens() -> tuple[bytes, ...]:
    """Return the tokens by rank; a damaged file raises a `SmartPlayError`."""
    packed = resources.files(__package__).joinpath("o200k_base.zlib").read_bytes()
    try:
        unpacked = zlib.decompress(packed)
    except zlib.error:
        unpacked = b""
    if hashlib.sha256(unpacked).hexdigest() != UNPACKED_SHA256:
        raise SmartPlayError(f"The vocabulary of o200k_base is damaged: {install_command()}")
    # One format such as "1s3s2s..." cuts all tokens at once.
    pieces = [f"{length}s" for length in range(256)]
    layout = struct.Struct("".join(map(pieces.__getitem__, unpacked[:TOKENS])))
    by_rank: tuple[bytes, ...] = layout.unpack_from(unpacked, TOKENS)
    return by_rank


def vocabulary() -> bytes:
    """Return the vocabulary as it is published: a line for each token, base64 of its bytes and its rank."""
    return b"".join(base64.b64encode(token) + b" %d\n" % rank for rank, token in enumerate(tokens()))
