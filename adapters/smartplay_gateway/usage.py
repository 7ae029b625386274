"""The tokens of a prompt as its provider reports them, read from an answer once it has passed.

A reader is given pieces that have been sent on already, so that no byte waits for it and none is changed. An answer
that it cannot read, in an encoding or a form that it does not know, has no count.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

from smartplay_tools.players import read_usage
from smartplay_tools.types.arguments import object_in

LARGEST = 32 * 1024 * 1024
"""The most bytes of an answer that are kept to be read."""


class PromptTokens:
    """Reads how many tokens the prompt of an answer had.

    Arguments:
        form: the form of the request.
        headers: those of the answer, by their names in lower case.
    """

    def __init__(self, form: str, headers: Mapping[str, str]) -> None:
        self._interface: Any = "messages" if form == "anthropic" else form
        self._is_stream = headers.get("content-type", "").startswith("text/event-stream")
        self._is_packed = headers.get("content-encoding", "").strip().lower() in ("gzip", "deflate")
        self._kept = bytearray()

    def take(self, piece: bytes) -> None:
        """Keep a piece of the answer."""
        if len(self._kept) < LARGEST:
            self._kept += piece

    def count(self) -> int | None:
        """Return the tokens that the answer has reported; None if it has not. The first count is the prompt's."""
        text = bytes(self._kept)
        if self._is_packed:
            try:
                text = zlib.decompressobj(wbits=47).decompress(text, LARGEST)
            except zlib.error:
                return None
        parts = (part for part in (text.split(b"\n") if self._is_stream else [text]) if b"_tokens" in part)
        return next(filter(None, map(self._reported, parts)), None)

    def _reported(self, part: bytes) -> int | None:
        """The count in a whole answer, or in a line of a stream."""
        value = object_in(part.removeprefix(b"data:"))
        # Responses have it in `response.completed`, Anthropic's streams in `message_start`.
        for holder in () if value is None else (value, value.get("response"), value.get("message")):
            told = holder.get("usage") if isinstance(holder, Mapping) else None
            if isinstance(told, Mapping):
                # What Anthropic's compactions have read is billed, and is not this prompt.
                usage = read_usage({**told, "iterations": None}, self._interface)
                if usage is not None and usage.prompt > 0:
                    return usage.prompt
        return None
