"""TokenCounter: budget tokens of texts, messages and prompts, each text tokenised once.

A model's JSON can contain a lone surrogate (half of a character), for which most tokenizers raise an exception. The
counter makes such text well-formed before it is tokenised (`well_formed`), so that all tokenizers count the same text.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from smartplay_tools.context.prompts.history import thoughts_of
from smartplay_tools.context.prompts.wording import VERSION
from smartplay_tools.context.tokens.tokenizers import (
    DEFAULT_RULE,
    DEFAULT_TOKENIZER,
    HUGGING_FACE,
    ApproximateTokenizer,
    PictureTokenizer,
    TiktokenTokenizer,
    Tokenizer,
    get_tokenizer,
    with_pictures,
)
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import ToolSpec
from smartplay_tools.types.arguments import as_text, canonical, well_formed
from smartplay_tools.types.messages import calls_of, text_and_pictures

CACHED_TEXTS = 32_768
"""How many texts a `TokenCounter` remembers: more than the longest episode of the benchmark has."""

LONG_TEXT, CACHED_LONG_TEXTS = 1_024, 512
"""Fewer texts are remembered if they are longer than this: a counter may live as long as its process."""

LONGEST_REMEMBERED = 16_384
"""Longer texts are counted again whenever they come again."""

PRIMING = 3
"""The tokens of a prompt in addition to its messages and tools: the beginning of the reply."""

_CALL = 3 + 8
"""The tokens of a call in addition to those of its name and arguments."""


def _remembered(count: Callable[[str], int]) -> Callable[[str], int]:
    """Return the function with a cache that is bounded by the number and length of its texts."""
    short, long = functools.lru_cache(CACHED_TEXTS)(count), functools.lru_cache(CACHED_LONG_TEXTS)(count)

    def recall(text: str) -> int:
        if len(text) <= LONG_TEXT:
            return short(text)
        return long(text) if len(text) <= LONGEST_REMEMBERED else count(text)

    return recall


def _properties(tool: ToolSpec) -> Mapping[str, Any]:
    properties = tool.parameters.get("properties") if isinstance(tool.parameters, Mapping) else tool.parameters
    if properties is None:
        return {}
    if not isinstance(properties, Mapping):
        raise InvalidArgumentError(f"The parameters of the tool {tool.name!r} are not a JSON Schema of an object.")
    return properties


def _parts(tool: str, key: str, schema: Any) -> tuple[Any, str, Sequence[Any]]:
    """Return type, description and enum of a property; a schema may also be True (anything) or False (nothing)."""
    if isinstance(schema, bool):
        return "", "", ()
    if isinstance(schema, Mapping):
        kind, description, enum = schema.get("type", ""), schema.get("description"), schema.get("enum")
        if isinstance(description, str | None) and isinstance(enum, list | tuple | None):
            return kind, description or "", enum or ()
    raise InvalidArgumentError(
        f"The property {key!r} of the tool {tool!r} is not a JSON Schema: a schema is an object, true or false, "
        "its description a text, its enum a list."
    )


class TokenCounter:
    """Counts budget tokens, with a cache: a text that was counted is not tokenised again."""

    def __init__(self, tokenizer: str | Tokenizer | None = None, version: str = VERSION) -> None:
        """`version` is that of the prompts, which decides what of a reply's thoughts is counted."""
        self.tokenizer, self.version = get_tokenizer(tokenizer), version
        self._thoughts = thoughts_of(version)
        self.text = _remembered(self._count)
        """Count a text."""
        self._arguments = _remembered(lambda text: self.text(canonical(text)))
        words = self.tokenizer.words if isinstance(self.tokenizer, PictureTokenizer) else self.tokenizer
        if not isinstance(words, TiktokenTokenizer):
            self.text("assistant")  # a tokenizer that fails does so here, not in the middle of an episode
        self._pictures: Callable[[int, int], object] | None = getattr(self.tokenizer, "image", None)

    def _count(self, text: str) -> int:
        return self._whole(self.tokenizer.count(well_formed(text)))

    def _whole(self, count: object) -> int:
        try:
            number = int(operator.index(count))  # type: ignore[arg-type]  # whatever a custom tokenizer returns
        except TypeError:
            number = -1
        if number < 0:
            raise InvalidArgumentError(
                f"A tokenizer counts in whole numbers from 0 on; that of {self.tokenizer.name!r} gave {count!r}."
            )
        return number

    @property
    def counts_pictures(self) -> bool:
        """Whether its tokenizer has a rule for pictures."""
        return callable(self._pictures)

    def image(self, width: int, height: int) -> int:
        """Count a picture by its size in pixels; an `InvalidArgumentError` if the tokenizer has no rule for that."""
        if self._pictures is None:
            raise InvalidArgumentError(
                f"The tokenizer {self.tokenizer.name!r} does not count pictures; name a rule with it: "
                f"{self.tokenizer.name}+{DEFAULT_RULE}."
            )
        return self._whole(self._pictures(width, height))

    def content(self, message: Mapping[str, Any]) -> int:
        """Count the text and the pictures of a message."""
        content = message.get("content")
        if content is None or isinstance(content, str):
            return self.text(content or "")
        text, pictures = text_and_pictures(message)
        return self.text(text) + sum([self.image(part["width"], part["height"]) for part in pictures])

    def message(self, message: Mapping[str, Any], arguments: Sequence[str] | None = None) -> int:
        """Count a chat message. Anything in it but text and pictures of the game raises a ValueError.

        `arguments` are those of its calls in canonical form, for callers that have read them.
        """
        role = message["role"]
        count = 3 + self.text(role) + self.content(message)
        if message.get("name"):
            count += 1 + self.text(message["name"])
        if role == "tool":  # a result has neither calls nor thoughts
            return count + 8
        for position, call in enumerate(calls_of(message)):
            function = call["function"]
            count += _CALL + self.text(str(function["name"]))
            if arguments is None:
                count += self._arguments(as_text(function["arguments"]))
            else:
                count += self.text(arguments[position])
        reasoning = self._thoughts(message)
        return count + (self.text(reasoning) if reasoning else 0)

    def call(self, name: str, arguments: str) -> int:
        """Count what a call adds to its message; `arguments` are in canonical form."""
        return _CALL + self.text(name) + self.text(arguments)

    def messages(self, messages: Iterable[Mapping[str, Any]]) -> int:
        """Count messages."""
        return sum(map(self.message, messages))

    def tools(self, tools: Iterable[ToolSpec]) -> int:
        """Count tool schemas: 7 a function, 3 for having properties, 3 a property, 12 at the end, and the texts.

        Any JSON Schema can be counted. A schema that is not one raises an `InvalidArgumentError`.
        """
        count, any_tool = 0, False
        for tool in tools:
            any_tool = True
            count += 7 + self.text(f"{tool.name}:{tool.description.removesuffix('.')}")
            properties = _properties(tool)
            count += 3 if properties else 0
            for key, schema in properties.items():
                kind, description, enum = _parts(tool.name, key, schema)
                count += 3 + self.text(f"{key}:{kind}:{description.removesuffix('.')}")
                if enum:
                    count += -3 + sum(3 + self.text(str(item)) for item in enum)
        return count + 12 if any_tool else 0

    def prompt(self, messages: Iterable[Mapping[str, Any]], tools: Iterable[ToolSpec] = ()) -> int:
        """Count a whole prompt."""
        return self.messages(messages) + PRIMING + self.tools(tools)


def shared_counter(tokenizer: str | Tokenizer | None = None, version: str = VERSION) -> TokenCounter:
    """Return a counter for an episode: one for all episodes with this tokenizer, if its name says what it counts.

    `version` is that of the episode's prompts.

    Episodes of a setting repeat the same head, tools and manual. A file of Hugging Face can change, and two tokenizer
    objects may have the same name: with those, every episode has its own counter.
    """
    if tokenizer is None or (isinstance(tokenizer, str) and not tokenizer.startswith(HUGGING_FACE)):
        return _counter_of(DEFAULT_TOKENIZER if tokenizer is None else tokenizer, version)
    return TokenCounter(tokenizer, version)


def picture_counter(counter: TokenCounter) -> TokenCounter:
    """Return a counter that counts pictures, too: the same if it does, or else with the default rule."""
    if counter.counts_pictures:
        return counter
    tokenizer = with_pictures(counter.tokenizer)
    is_named = isinstance(counter.tokenizer, TiktokenTokenizer | ApproximateTokenizer)
    return shared_counter(tokenizer.name if is_named else tokenizer, counter.version)


_counter_of = functools.lru_cache(8)(TokenCounter)
