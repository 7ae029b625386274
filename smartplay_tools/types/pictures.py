"""A picture that a model is shown, and the part of a message that stands for it.

Messages stay plain JSON: a part names a picture by its sha256, with its size, and a prompt has the pictures themselves
beside its messages (`Prompt.pictures`). PNG and base64 exist on the wire only.
"""

from __future__ import annotations

import base64
import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["NO_PICTURES", "Picture", "is_picture", "picture_part"]


@dataclass(frozen=True)
class Picture:
    """A picture of red, green and blue pixels, each of which is enlarged to a square."""

    pixels: bytes = field(repr=False)
    """Red, green and blue of every pixel before it is enlarged, row by row from the top left."""
    columns: int
    """How many pixels a row has before it is enlarged."""
    rows: int
    scale: int = 1
    """The side of the square to which a pixel is enlarged."""
    recorded_sha256: str | None = None
    """The name of the picture in a record whose digests are of files; None if it is named by its pixels."""

    @classmethod
    def from_array(cls, pixels: NDArray[np.uint8], scale: int = 1) -> Self:
        """Return the picture of an array, rows x columns x red, green and blue, with every pixel enlarged."""
        rows, columns, _ = pixels.shape
        return cls(pixels.tobytes(), columns, rows, scale)

    @property
    def width(self) -> int:
        """The width in pixels, as it is shown."""
        return self.columns * self.scale

    @property
    def height(self) -> int:
        """The height in pixels, as it is shown."""
        return self.rows * self.scale

    @property
    def array(self) -> NDArray[np.uint8]:
        """The pixels as they are shown: height x width x red, green and blue."""
        # Only pictures need NumPy, which takes longer to import than all that is imported with this module.
        import numpy as np

        pixels = np.frombuffer(self.pixels, np.uint8).reshape(self.rows, self.columns, 3)
        return pixels.repeat(self.scale, 0).repeat(self.scale, 1)

    @cached_property
    def sha256(self) -> str:
        """The name of the picture: the sha256, in hex, of its size and its pixels as they are shown.

        The bytes that are hashed are the ASCII text `WIDTH HEIGHT`, a line break, and one byte each for red, green and
        blue of every pixel, row by row from the top left. The PNG file is no part of it: its bytes depend on the
        version of the library that compresses it, its pixels do not.
        """
        if self.recorded_sha256 is not None:
            return self.recorded_sha256
        return hashlib.sha256(b"%d %d\n" % (self.width, self.height) + self.array.tobytes()).hexdigest()

    @cached_property
    def png(self) -> bytes:
        """The picture as a PNG file."""
        from PIL import Image

        file = io.BytesIO()
        Image.fromarray(self.array).save(file, "PNG")
        return file.getvalue()

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
        """Its sha256, width and height, which a record holds instead of the picture."""
        return {"sha256": self.sha256, "width": self.width, "height": self.height}


NO_PICTURES: Mapping[str, Picture] = {}
"""The pictures of a prompt of words. It is a plain dictionary, so that prompts can be pickled."""


def picture_part(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a message that stands for a picture with these facts."""
    return {"type": "image", **facts}


def is_picture(part: Any) -> bool:
    """Whether a part of a message stands for a picture of the game."""
    return isinstance(part, dict) and part.get("type") == "image" and isinstance(part.get("sha256"), str)
