"""Playing a run from a thread that already runs an event loop, as a notebook does."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from threading import Thread
from typing import ParamSpec

Given = ParamSpec("Given")


def apart_from_event_loop(call: Callable[Given, None], /, *args: Given.args, **kwargs: Given.kwargs) -> None:
    """Call a function that runs its own event loop; if this thread already runs one, in another thread.

    A notebook runs its cells on an event loop. Signals still reach this thread while it waits, so Ctrl-C and the
    notebook's stop button stop a run between two turns as they do elsewhere.
    """
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        call(*args, **kwargs)
        return
    raised: list[BaseException] = []

    def guarded() -> None:
        try:
            call(*args, **kwargs)
        except BaseException as error:
            raised.append(error)

    thread = Thread(target=guarded, name="smartplay-tools run")
    thread.start()
    thread.join()
    if raised:
        raise raised[0]
