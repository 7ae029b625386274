"""A window endpoint, and a server behind context endpoints, for the tests of their clients."""

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


@pytest.fixture
def upstream() -> Iterator[Any]:
    """A server that notes what it is sent."""
    from tests.adapters.test_context_endpoint import Upstream

    server = Upstream()
    yield server
    server.close()
