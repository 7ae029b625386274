"""What many tests share: a tokenizer, a tool of the host's, digests of pictures, and what every record promises."""

from __future__ import annotations

import functools
import hashlib
import io
import json
import re
from typing import Any

import numpy as np
from PIL import Image

import smartplay_tools as sp
from smartplay_tools.records import Record, replay, resume
from smartplay_tools.records.accounts import Accounts

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0", "Hanoi3Disk-v0")
NOTE = sp.ToolSpec(
    "note",
    "Keep a note.",
    {
        "type": "object",
        "properties": {
            "text": {"type": "string", "description": "What to keep."},
            "kind": {"type": "string", "description": "Its kind.", "enum": ["plan", "fact"]},
        },
        "required": ["text", "kind"],
        "additionalProperties": False,
    },
)


def pixels_of(png: bytes) -> np.ndarray:
    """The pixels of a PNG file: rows x columns x red, green and blue."""
    with Image.open(io.BytesIO(png)) as image:
        return np.array(image)


def picture_digest(png: bytes) -> str:
    """The digest of a picture, from its file alone and as `Picture.sha256` defines it."""
    pixels = pixels_of(png)
    height, width, _ = pixels.shape
    return hashlib.sha256(b"%d %d\n" % (width, height) + pixels.tobytes()).hexdigest()


class Words:
    """A tokenizer for tests: a token for a word of up to eight letters, and one for every sign."""

    name = "words"

    def count(self, text: str) -> int:
        return _words(text)


@functools.lru_cache(20_000)
def _words(text: str) -> int:
    return len(re.findall(r"\w{1,8}|[^\w\s]", text))


def as_json(value: Any) -> Any:
    return json.loads(json.dumps(value))


def check_record(events: list[dict[str, Any]], tokenizer: Any = None) -> None:
    """Whatever the strategy: a record replays, can be continued from its middle, and says where every token went."""
    assert replay(events, tokenizer=tokenizer).identical
    with resume(events[: len(events) // 2], transcript=[], tokenizer=tokenizer) as resumed:
        assert resumed.conversation is not None
    record = Record(events)
    assert all(sent.sha256 == sent.recorded_sha256 for sent in record.sent_prompts())
    if tokenizer is not None:  # then the package has none that counts the parts
        return
    accounts = Accounts.of(record)
    assert all(sum(accounts.parts(view)) == view["tokens"] for view in record.views)
    list(accounts.departures())
