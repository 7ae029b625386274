"""The tokens of a prompt as its provider reports them, read from an answer while it passes.

A reader is given copies of pieces that have been sent on already, so that no byte waits for it and none is changed. An
answer that it cannot read, in an encoding or a form that it does not know, has no count.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any

from smartplay_tools.players import read_usage
from smartplay_tools.types.arguments import object_in

LARGEST = 32 * 1024 * 1024
"""The most bytes of an answer, or of a line of a stream, that are kept to be read."""


class PromptTokens:
    """Reads how many tokens the prompt of an answer had.

    Arguments:
        form: the form of the request.
        headers: those of the answer, by their names in lower case.
    """

    def __init__(self, form: str, headers: Mapping[str, str]) -> None:
        self._interface: Any = "messages" if form == "anthropic" else form
        self._is_stream = headers.get("content-type", "").startswith("text/event-stream")
        encoding = headers.get("content-encoding", "identity").strip().lower()
        self._is_read = encoding in ("identity", "gzip", "deflate", "")
        self._unpack = zlib.decompressobj(wbits=47) if encoding in ("gzip", "deflate") else None
        self._kept = bytearray()
        self._found: int | None = None

    def take(self, piece: bytes) -> None:
        """Read a piece of the answer."""
        if not self._is_read or self._found is not None:
            return
        if self._unpack is not None:
            try:
                piece = self._unpack.decompress(piece, LARGEST)
            except zlib.error:
                self._is_read = False
        self._kept += piece
        if self._is_stream:
            *lines, rest = self._kept.split(b"\n")
            self._kept = bytearray(rest)
            for line in lines:
                self._read(line)
        if len(self._kept) >= LARGEST:
            self._is_read = False
        if not self._is_read:
            self._kept.clear()

    def count(self) -> int | None:
        """Return the tokens that were reported so far; None if none were."""
        if self._is_read and self._found is None:
            self._read(self._kept)
        return self._found

    def _read(self, text: bytes | bytearray) -> None:
        """Look for the count in a whole answer, or in a line of a stream; the first that there is, is the prompt's."""
        if self._found is not None or b"_tokens" not in text:
            return
        value = object_in(bytes(text).removeprefix(b"data:"))
        # Responses have it in `response.completed`, Anthropic's streams in `message_start`.
        for holder in () if value is None else (value, value.get("response"), value.get("message")):
            told = holder.get("usage") if isinstance(holder, Mapping) else None
            if isinstance(told, Mapping):
                # What Anthropic's compactions have read is billed, and is not this prompt.
                usage = read_usage({**told, "iterations": None}, self._interface)
                if usage is not None and usage.prompt > 0:
                    self._found = usage.prompt
