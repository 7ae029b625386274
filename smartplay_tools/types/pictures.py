"""A picture that a model is shown, and the part of a message that stands for it.

Messages stay plain JSON: a part names a picture by its sha256, with its size, and a prompt has the pictures themselves
beside its messages (`Prompt.pictures`). Base64 exists on the wire only.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

__all__ = ["NO_PICTURES", "Picture", "is_picture", "picture_part"]


@dataclass(frozen=True)
class Picture:
    """A picture as a PNG file."""

    png: bytes = field(repr=False)
    width: int
    """In pixels."""
    height: int

    @cached_property
    def sha256(self) -> str:
        """The sha256 of the file, in hex."""
        return hashlib.sha256(self.png).hexdigest()

    @cached_property
    def base64(self) -> str:
        """The file in base64, as providers take it."""
        return base64.b64encode(self.png).decode("ascii")

    @property
    def data_url(self) -> str:
        """The file as a `data:` URL."""
        return f"data:image/png;base64,{self.base64}"

    @property
    def facts(self) -> dict[str, Any]:
        """Its sha256, width and height, which a record holds instead of the file."""
        return {"sha256": self.sha256, "width": self.width, "height": self.height}


NO_PICTURES: Mapping[str, Picture] = {}
"""The pictures of a prompt of words. It is a plain dictionary, so that prompts can be pickled."""


def picture_part(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a message that stands for a picture with these facts."""
    return {"type": "image", **facts}


def is_picture(part: Any) -> bool:
    """Whether a part of a message stands for a picture of the game."""
    return isinstance(part, dict) and part.get("type") == "image" and isinstance(part.get("sha256"), str)
