"""Crafter's textures, from PyPI `crafter`, as one small image for the page."""

from __future__ import annotations

import base64
import functools
import io
import math
from pathlib import Path
from typing import Any

SIDE = 16
"""Pixels along the side of a texture."""

COLUMNS = 8


@functools.cache
def sheet() -> dict[str, Any]:
    """Return the image as a PNG data URI, the index of every texture in it, row by row, and Crafter's lists."""
    from crafter import constants
    from PIL import Image

    from smartplay_tools.games.crafter.facts import ITEMS, MATERIALS, MOST, VITALS

    files = [file for file in sorted(Path(constants.root / "assets").glob("*.png")) if "debug" not in file.stem]
    canvas = Image.new("RGBA", (COLUMNS * SIDE, math.ceil(len(files) / COLUMNS) * SIDE))
    for at, file in enumerate(files):
        with Image.open(file) as texture:
            canvas.paste(texture.convert("RGBA"), (at % COLUMNS * SIDE, at // COLUMNS * SIDE))
    data = io.BytesIO()
    canvas.save(data, "PNG", optimize=True)
    image = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode("ascii")
    facts = {"materials": MATERIALS, "vitals": VITALS, "items": ITEMS, "most": MOST}
    places = {file.stem: at for at, file in enumerate(files)}
    return {"image": image, "side": SIDE, "columns": COLUMNS, "places": places, **facts}
