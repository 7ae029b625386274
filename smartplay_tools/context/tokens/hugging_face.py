"""Hugging Face tokenizers: a `tokenizer.json` from a file, a folder or the Hub, read by their `tokenizers` library.

Only text is counted, never a chat template: what a template adds depends on the whole conversation, and the window's
definition needs a count that is the sum of its parts.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError, extra_named

if TYPE_CHECKING:
    import tokenizers

FILE = "tokenizer.json"


class HuggingFaceTokenizer:
    """The tokenizer of a `tokenizer.json`; `source` is the file, its folder or its repository on the Hub.

    A path on disk comes first, then the Hub's cache; only a name that is in neither is downloaded.
    """

    def __init__(self, source: str) -> None:
        self.name = f"hf:{source}"
        path = _find(source)
        content = path.read_bytes()
        self.sha256 = hashlib.sha256(content).hexdigest()
        self._tokenizer = _read(path, content)

    def count(self, text: str) -> int:
        """Return the number of tokens of the text, without those that frame a sequence."""
        return len(self._tokenizer.encode(text, add_special_tokens=False))


def _find(source: str) -> Path:
    path = Path(source).expanduser()
    if path.is_dir():
        path /= FILE
    if path.is_file():
        return path
    # A repository is NAME or OWNER/NAME; anything else was meant as a path.
    if path.name == FILE or path.suffix == ".json" or path.is_absolute() or len(path.parts) > 2:
        raise InvalidArgumentError(f"There is no file {path}; hf: takes a {FILE}, a folder that holds one, or a name.")
    return _download(source)


@functools.cache
def _download(name: str) -> Path:
    with extra_named("A Hugging Face tokenizer", "huggingface"):
        from huggingface_hub import hf_hub_download
        from huggingface_hub.errors import LocalEntryNotFoundError
    try:
        # A cached file is used without a request, so that a name always means the same tokenizer.
        with contextlib.suppress(LocalEntryNotFoundError):
            return Path(hf_hub_download(name, FILE, local_files_only=True))
        return Path(hf_hub_download(name, FILE))
    except (OSError, ValueError) as error:  # all of the Hub's errors are one of these
        raise InvalidArgumentError(
            f"hf:{name} is neither a file nor a folder here, and its {FILE} could not be downloaded from the Hugging "
            f"Face Hub ({type(error).__name__}): check the name, run once with a network, or name a local file."
        ) from error


@functools.lru_cache(maxsize=4)  # a large vocabulary takes a second to read
def _read(path: Path, content: bytes) -> tokenizers.Tokenizer:
    with extra_named("A Hugging Face tokenizer", "huggingface"):
        from tokenizers import Tokenizer
    try:
        tokenizer = Tokenizer.from_buffer(content)
    except Exception as error:  # the library raises nothing narrower
        raise InvalidArgumentError(f"{path} is not a file of Hugging Face's tokenizers: {error}") from error
    tokenizer.encode_special_tokens = True  # as text
    # Settings of the file for training and inference would truncate, pad or randomise counts.
    tokenizer.no_truncation()
    tokenizer.no_padding()
    if getattr(tokenizer.model, "dropout", None):
        tokenizer.model.dropout = None
    return tokenizer
