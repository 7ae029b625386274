"""The vocabulary of a GGUF file as a tokenizer: counts what the model's own engine counts.

The file holds the tokens and merges of a byte-pair encoding, which the library `tokenizers` runs, and the name of the
rule by which text is first split. llama.cpp has these rules in its code. The counts of those supported here were
compared with its own; for a model with another rule, `hf:` takes the `tokenizer.json` that was published with it.
"""

from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from smartplay_local.gguf_header import GGUF, read_gguf
from smartplay_local.model_files import find_model, name_of
from smartplay_tools.errors import InvalidArgumentError, extra_named

if TYPE_CHECKING:
    import tokenizers

PREFIX = "tokenizer.ggml."

SPLITS = ("smollm",)
"""The rules for splitting text whose counts were compared with llama.cpp's."""


class GgufTokenizer:
    """The vocabulary of a model file; `source` is a known model's name or a path."""

    def __init__(self, source: str) -> None:
        self.name = f"gguf:{source}"
        self.sha256, self._tokenizer = _read(find_model(source))

    def count(self, text: str) -> int:
        """Return the number of tokens of the text, without those that frame a sequence."""
        return len(self._tokenizer.encode(text, add_special_tokens=False))


@functools.lru_cache(maxsize=4)
def _read(path: Path) -> tuple[str, tokenizers.Tokenizer]:
    """Return the digest of a model's vocabulary, and its tokenizer."""
    model = read_gguf(path)
    kind, split = model.facts.get(f"{PREFIX}model"), model.facts.get(f"{PREFIX}pre")
    if kind != "gpt2" or split not in SPLITS:
        raise InvalidArgumentError(
            f"The vocabulary of {name_of(str(path))} is of a kind ({kind}, {split}) that was not compared with its "
            "engine; take hf:PATH with the tokenizer.json that was published with the model."
        )
    vocabulary = [model.facts[f"{PREFIX}tokens"], model.facts[f"{PREFIX}merges"], split]
    digest = hashlib.sha256(json.dumps(vocabulary).encode()).hexdigest()
    return digest, _tokenizer(model)


def _tokenizer(model: GGUF) -> Any:
    with extra_named("The vocabulary of a model file", "local"):
        from tokenizers import Tokenizer, models, pre_tokenizers
    tokens = {token: at for at, token in enumerate(model.facts[f"{PREFIX}tokens"])}
    merges = [tuple(merge.split(" ", 1)) for merge in model.facts[f"{PREFIX}merges"]]
    tokenizer = Tokenizer(models.BPE(vocab=tokens, merges=merges))
    # Every digit is a token of its own; then GPT-2's rule, which `ByteLevel` has.
    digits = pre_tokenizers.Digits(individual_digits=True)
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence([digits, pre_tokenizers.ByteLevel(add_prefix_space=False)])
    return tokenizer
