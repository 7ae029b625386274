"""Tokenizers, which count the tokens of a text; each is given by name or as an object of your own.

o200k_base        the default; its vocabulary ships inside the package and loads when the first text is counted
cl100k_base, ...  any encoding of tiktoken, which downloads its vocabulary at first use
hf:PATH_OR_NAME   a `tokenizer.json` of Hugging Face tokenizers: a file, a folder or a name on the Hub
approximate       four characters a token

A name may end with the rule by which pictures are counted, as in o200k_base+claude-28: see
`smartplay_tools.context.tokens.pictures`.
"""

from __future__ import annotations

import base64
import contextlib
import functools
import hashlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from smartplay_tools.context.tokens.o200k import VOCABULARY_SHA256, o200k_base
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, UnknownNameError

if TYPE_CHECKING:
    import tiktoken

    from smartplay_tools.context.tokens.pictures import PictureRule

DEFAULT_TOKENIZER = "o200k_base"

DEFAULT_RULE = "claude-28"
"""The rule of an episode with pictures whose tokenizer names none."""

HUGGING_FACE = "hf:"
"""The prefix of the names of Hugging Face tokenizers."""

LONGEST_PIECE = 50_000
"""Text is counted in pieces of at most this many characters, because longer ones can overflow tiktoken's stack."""


@runtime_checkable
class Tokenizer(Protocol):
    """Anything that counts tokens.

    It may also have the attribute `sha256`, the digest of its vocabulary as 64 hex digits, which records then name
    beside it: two tokenizers of one name need not be the same. For episodes with pictures it may have a method
    `image(width, height)`, which returns the tokens of a picture; without one they are counted by a rule.
    """

    @property
    def name(self) -> str:
        """The name that is written into records."""
        ...

    def count(self, text: str) -> int:
        """Return the number of tokens of a text, which has no surrogates; special-token strings are text."""
        ...


class TiktokenTokenizer:
    """An encoding of tiktoken. `o200k_base` is loaded when it counts for the first time, any other at once."""

    def __init__(self, name: str) -> None:
        self.name = name
        if name != DEFAULT_TOKENIZER:
            _downloaded(name)

    @property
    def sha256(self) -> str:
        """The digest of the vocabulary in tiktoken's file form: a line for each token, base64 and rank."""
        return VOCABULARY_SHA256 if self.name == DEFAULT_TOKENIZER else _sha256(self.name)

    def count(self, text: str) -> int:
        """Return the number of tokens of the text, counted in pieces of at most `LONGEST_PIECE` characters."""
        encoding = o200k_base() if self.name == DEFAULT_TOKENIZER else _downloaded(self.name)
        if len(text) <= LONGEST_PIECE:
            return len(encoding.encode_ordinary(text))
        pieces = (text[at : at + LONGEST_PIECE] for at in range(0, len(text), LONGEST_PIECE))
        return sum(len(encoding.encode_ordinary(piece)) for piece in pieces)


class ApproximateTokenizer:
    """Four characters a token, rounded up: wrong for game text by up to a factor of eight. For rough plans only."""

    name = "approximate"

    def count(self, text: str) -> int:
        """Return a quarter of the characters, rounded up."""
        return -(-len(text) // 4)


class PictureTokenizer:
    """A tokenizer of words, with a rule for pictures; its name has both."""

    def __init__(self, words: Tokenizer, rule: PictureRule) -> None:
        self.words, self.rule = words, rule
        self.name = f"{words.name}+{rule.name}"

    @property
    def sha256(self) -> str | None:
        """The digest of the vocabulary; None if the tokenizer of words has none."""
        digest: str | None = getattr(self.words, "sha256", None)
        return digest

    def count(self, text: str) -> int:
        """Return the number of tokens of the text."""
        return self.words.count(text)

    def image(self, width: int, height: int) -> int:
        """Return the number of tokens of a picture."""
        return self.rule.count(width, height)


def picture_rules() -> Mapping[str, PictureRule]:
    """Return the rules by name, which only episodes with pictures load."""
    from smartplay_tools.context.tokens.pictures import RULES

    return RULES


def split_rule(name: str) -> tuple[str, str | None]:
    """Return the name of a tokenizer of words, and of the rule for pictures, if the whole name ends with one."""
    words, plus, rule = name.rpartition("+")
    return (words, rule) if plus and rule in picture_rules() else (name, None)


def with_pictures(tokenizer: Tokenizer, rule: str | None = None) -> Tokenizer:
    """Return a tokenizer that counts pictures: the same if it does already, or else with a rule, by default Claude's.

    A tokenizer that counts them by a rule other than the one that is asked for is an `InvalidArgumentError`.
    """
    if not callable(getattr(tokenizer, "image", None)):
        return PictureTokenizer(tokenizer, picture_rules()[rule or DEFAULT_RULE])
    if rule is not None and (not isinstance(tokenizer, PictureTokenizer) or tokenizer.rule.name != rule):
        raise InvalidArgumentError(f"The tokenizer {tokenizer.name!r} does not count pictures by the rule {rule}.")
    return tokenizer


_NAMED: dict[tuple[str, str | None], Tokenizer] = {}
"""The tokenizers that do not ship and that the user has named in this process, by name and digest."""


def named_tokenizers() -> list[str]:
    """Return the names of the tokenizers that the user has named, for processes that read records for this one."""
    return list(dict.fromkeys(name for name, _ in _NAMED))


def open_tokenizers(names: Iterable[str]) -> None:
    """Open in this process what was named in another; a file that is gone counts as not named."""
    for name in set(names).difference(named_tokenizers()):
        with contextlib.suppress(SmartPlayError):
            get_tokenizer(name)


def get_tokenizer(tokenizer: str | Tokenizer | None = None) -> Tokenizer:
    """Return a tokenizer by name, or the object itself if it already is one; None is `o200k_base`.

    A name that is unknown, or whose vocabulary is not available and cannot be downloaded, raises here, so that it does
    not end an episode later.
    """
    if tokenizer is None:
        return TiktokenTokenizer(DEFAULT_TOKENIZER)
    if not isinstance(tokenizer, str):
        return _checked(tokenizer)
    words, rule = split_rule(tokenizer)
    if rule is not None:
        return PictureTokenizer(get_tokenizer(words), picture_rules()[rule])
    if tokenizer == ApproximateTokenizer.name:
        return ApproximateTokenizer()
    if tokenizer == DEFAULT_TOKENIZER:
        return TiktokenTokenizer(tokenizer)
    found = _found(tokenizer)
    _NAMED[tokenizer, getattr(found, "sha256", None)] = found
    return found


def _found(tokenizer: str) -> Tokenizer:
    """Return a tokenizer that does not ship with this package: a file, or an encoding that tiktoken downloads."""
    if tokenizer.startswith(HUGGING_FACE):
        from smartplay_tools.context.tokens.hugging_face import HuggingFaceTokenizer

        return HuggingFaceTokenizer(tokenizer.removeprefix(HUGGING_FACE))
    import tiktoken

    _, plus, asked = tokenizer.partition("+")
    if plus:
        raise UnknownNameError("rule for pictures", asked, list(picture_rules()))
    if tokenizer not in tiktoken.list_encoding_names():
        names = [*tiktoken.list_encoding_names(), ApproximateTokenizer.name, f"{HUGGING_FACE}PATH_OR_NAME"]
        raise UnknownNameError("tokenizer", tokenizer, names)
    return TiktokenTokenizer(tokenizer)


def ships(name: str) -> bool:
    """Return whether a tokenizer is part of this package, so that its name opens no file and downloads nothing."""
    return split_rule(name)[0] in (DEFAULT_TOKENIZER, ApproximateTokenizer.name)


def recorded_tokenizer(name: str, sha256: str | None) -> str | Tokenizer:
    """Return the tokenizer that a record names, with the digest of its vocabulary, without opening anything for it.

    A record can come from a stranger: its tokenizer ships with this package, or the user has named one with that
    digest, or with that name, in this process.
    """
    if ships(name):
        return name
    words, rule = split_rule(name)
    same = [found for (_, digest), found in _NAMED.items() if sha256 is not None and digest == sha256]
    found = next(iter([*same, *(found for (known, _), found in _NAMED.items() if known == words)]), None)
    if found is None:
        digest = "" if sha256 is None else f" (sha256 {sha256[:16]})"
        raise InvalidArgumentError(
            f"The record was counted with the tokenizer {name!r}{digest}, which is not part of this package; name it "
            "with --tokenizer (in Python tokenizer=), and it is opened."
        )
    return found if rule is None else with_pictures(found, rule)


def _checked(tokenizer: Tokenizer) -> Tokenizer:
    """Return the object if it counts tokens; raise otherwise, before an episode begins with it."""
    if isinstance(tokenizer, type) or not isinstance(tokenizer, Tokenizer) or not isinstance(tokenizer.name, str):
        raise InvalidArgumentError(
            f"A tokenizer is an object with a text `name` and a method `count(text)`; {tokenizer!r} does not have them."
        )
    return tokenizer


@functools.cache
def _downloaded(name: str) -> tiktoken.Encoding:
    import tiktoken

    try:
        return tiktoken.get_encoding(name)
    except (OSError, ValueError) as error:  # requests' errors are OSErrors; a wrong digest is a ValueError
        raise InvalidArgumentError(
            f"The vocabulary of {name} could not be downloaded ({type(error).__name__}): run once with a network, set "
            f"TIKTOKEN_CACHE_DIR to a folder that has it, or take {DEFAULT_TOKENIZER}, which needs no download."
        ) from error


@functools.cache
def _sha256(name: str) -> str:
    encoding = _downloaded(name)
    ranks = sorted((encoding.encode_single_token(token), token) for token in encoding.token_byte_values())
    lines = (b"%s %d\n" % (base64.b64encode(token), rank) for rank, token in ranks)
    return hashlib.sha256(b"".join(lines)).hexdigest()
