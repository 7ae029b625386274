"""A window endpoint for the tests of its clients."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import smartplay_tools as sp


@pytest.fixture
def endpoint() -> Iterator[Any]:
    """The rule player behind a window endpoint."""
    sg = pytest.importorskip("smartplay_gateway")
    with sg.WindowEndpoint(sp.get_player("rule")) as running:
        yield running
