"""Counting: what each message of an agent costs, whole and in every shorter way in which a prompt can show it.

Tokens are budget tokens, as docs/budgets.md defines them: those of games, counted on what is sent. Arguments count as
they are sent, since nobody writes them again. Encrypted thoughts cannot be counted; they have an estimate, and the
messages that hold some are named (`FittedPrompt.uncertain`). A message is counted once for each text that it has.
"""

from __future__ import annotations

import base64
import binascii
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.context.tokens.counter import TokenCounter
from smartplay_tools.context.tokens.truncation import Cut, cut_end, cut_middle
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.forms import Content, Given, MessageForm, Said, without_pictures
from smartplay_tools.manager.plain import as_json
from smartplay_tools.providers.reply_fields import ENCRYPTED, texts_in
from smartplay_tools.types.tables import read_table

Tokens = int | Callable[[Given], int]
"""The tokens of a part: a number, or a function of the part."""

CUTS: Mapping[str, Cut] = {"end": cut_end, "middle": cut_middle}
"""The ways to cut a result, by name."""

SENTENCES: Mapping[str, str] = read_table(__package__, "sentences.toml")
RESULT_LEFT, PICTURE_LEFT, NO_RESULT = (SENTENCES[name] for name in ("result_left", "picture_left", "no_result"))
"""What stands in place of a result that is too old, of a picture that is left out, and of a result that never came."""

REMEMBERED = 200_000
"""How many messages a counter remembers."""


@dataclass(frozen=True, slots=True)
class Cost:
    """The tokens of a message in every way in which a prompt can show it."""

    whole: int
    """As it is shown first: with its results cut to their cap."""
    cut: Sequence[str | None] | None = None
    """The texts of its results where they were cut; None if none was."""
    masked: int = 0
    """With a line in place of each result; 0 for a message without results."""
    unpictured: int = 0
    """With a line in place of each picture of its results; 0 for a message without results."""
    pictures: int = 0
    """How many pictures its results have."""
    trimmed: int = 0
    """With its calls alone; 0 for a message that goes then, or is no reply."""
    is_uncertain: bool = False
    """Whether it holds what cannot be counted exactly."""

    @property
    def is_result(self) -> bool:
        """Whether it holds results."""
        return self.masked > 0


class MessageCounter:
    """Counts the messages of agents, and remembers what it has counted by what the messages say."""

    def __init__(
        self,
        counter: TokenCounter,
        cut: str,
        pictures: Tokens | None,
        sealed: Tokens | None,
        extra: Tokens | None,
    ) -> None:
        self.counter, self.extra, self._cut = counter, extra, CUTS[cut]
        self._pictures, self._sealed = pictures, sealed
        self._known: dict[Any, Cost] = {}

    def cost(
        self,
        message: Given,
        form: MessageForm,
        most: int | None,
        key: object,
        *,
        opens: bool = True,
        opens_calls: bool = True,
    ) -> Cost:
        """Return the cost of a message; `most` is the cap on a result, and `key` stands for what the message says.

        `opens` says whether a reply begins with it, and `opens_calls` whether one does that has its calls alone.
        """
        known = form.name, most, opens, opens_calls, key
        cost = self._known.get(known)
        if cost is None:
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            cost = self._known[known] = self._counted(message, form, most, opens, opens_calls)
        return cost

    def tokens(self, message: Given, form: MessageForm, *, opens: bool = True) -> int:
        """Count a message as it is."""
        return sum(map(self._said, form.said(message, opens=opens)))

    def text(self, text: str) -> int:
        """Count a text."""
        return self.counter.text(text)

    def cut(self, text: str, cap: int) -> str:
        """Return the text of a result, cut to a cap."""
        return self._cut(text, cap, self.counter.text, notice_of_cut)

    def _counted(self, message: Given, form: MessageForm, most: int | None, opens: bool, opens_calls: bool) -> Cost:
        as_json(message)
        tokens, sealed = self.tokens(message, form, opens=opens), any(True for _ in sealed_in(message))
        kind = form.kind(message)
        if kind == "word":
            return Cost(tokens, is_uncertain=sealed)
        if kind == "reply":
            shorter = form.trimmed(message)
            calls = self.tokens(shorter, form, opens=opens_calls) if shorter else 0
            return Cost(tokens, trimmed=calls, is_uncertain=sealed)
        contents = form.results(message)
        given = [Content.of(content).text for content in contents]
        texts = [None if most is None or self.text(text) <= most else self.cut(text, most) for text in given]
        shown = message if all(text is None for text in texts) else form.cut(message, texts)
        masked = form.with_results(message, [RESULT_LEFT] * len(contents))
        bare = form.with_results(shown, [without_pictures(each, PICTURE_LEFT) for each in form.results(shown)])
        assert masked is not None
        assert bare is not None
        return Cost(
            tokens if shown is message else self.tokens(shown, form),
            None if shown is message else texts,
            masked=self.tokens(masked, form),
            unpictured=self.tokens(bare, form),
            pictures=sum(len(Content.of(c).pictures) for c in contents),
            is_uncertain=sealed,
        )

    def _said(self, said: Said) -> int:
        count, content = self.counter.text, said.content
        tokens = 3 + count(said.role) if said.opens else 0
        tokens += count(content.text) + (1 + count(said.name) if said.name else 0) + (8 if said.role == "tool" else 0)
        tokens += sum(self.counter.call(*call) for call in said.calls)
        tokens += sum(map(self._picture, content.pictures))
        for part in content.closed:
            if self.extra is None:
                raise InvalidArgumentError(
                    f"has a part of the type {part.get('type')!r}, whose tokens only its provider can count; "
                    "name them with extra_tokens"
                )
            tokens += _of(self.extra, part)
        others = [other for other in (*said.others, *content.others) if other]
        tokens += count("".join(text for other in others for text in texts_in(dict(other))))
        return tokens + sum(self._seal(part, text) for other in others for part, text in sealed_in(other))

    def _seal(self, part: Given, text: str) -> int:
        return math.ceil(len(text) / 4) if self._sealed is None else _of(self._sealed, part)

    def _picture(self, part: Given) -> int:
        if self._pictures is not None:
            return _of(self._pictures, part)
        if not self.counter.counts_pictures:
            raise InvalidArgumentError(
                "has a picture, which the tokenizer does not count; name a rule for pictures with the tokenizer, "
                "as in o200k_base+claude-28, or their tokens with picture_tokens"
            )
        size = size_of(part)
        if size is None:
            raise InvalidArgumentError("has a picture that is not in the message; name its tokens with picture_tokens")
        return self.counter.image(*size)


def sealed_in(value: Any) -> Iterator[tuple[Given, str]]:
    """Yield every encrypted text of plain data, with the part that holds it."""
    if isinstance(value, Mapping):
        name = ENCRYPTED.get(str(value.get("type")), "encrypted_content")
        if isinstance(value.get(name), str):
            yield value, value[name]
    values = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
    for inner in values:
        if not isinstance(inner, str):
            yield from sealed_in(inner)


def size_of(part: Given) -> tuple[int, int] | None:
    """Return width and height of a picture that is in a message; None if it is elsewhere, or cannot be read."""
    source, url = part.get("source"), part.get("image_url")
    if isinstance(source, Mapping):
        data = source.get("data") if source.get("type") == "base64" else None
    else:
        address = url.get("url") if isinstance(url, Mapping) else url
        data = address.partition(",")[2] if isinstance(address, str) and address.startswith("data:") else None
    if not isinstance(data, str):
        return None
    from PIL import Image  # slow to import, and most agents have no pictures

    try:
        with Image.open(io.BytesIO(base64.b64decode(data))) as picture:
            return picture.size
    except (binascii.Error, OSError):
        return None


def notice_of_cut(missing: int) -> str:
    """Say how many tokens of a text are missing."""
    return SENTENCES["cut"].format(missing=missing)


def _of(tokens: Tokens, part: Given) -> int:
    return tokens(part) if callable(tokens) else tokens
