"""Code that runs an event loop of its own, called in a thread that already runs one, as a notebook does."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

Given = ParamSpec("Given")
T = TypeVar("T")


def apart_from_event_loop(call: Callable[Given, T], /, *args: Given.args, **kwargs: Given.kwargs) -> T:
    """Call a function that runs its own event loop; if this thread already runs one, in another thread.

    A notebook runs its cells on an event loop. Signals still reach this thread while it waits, so Ctrl-C and the
    notebook's stop button stop a run between two turns as they do elsewhere.
    """
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return call(*args, **kwargs)
    thread = ThreadPoolExecutor(1, "smartplay-tools run")
    try:
        return thread.submit(call, *args, **kwargs).result()
    finally:
        thread.shutdown(wait=False)
