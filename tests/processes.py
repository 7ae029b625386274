"""Programs as a user starts them, from tests that may themselves run in the background."""

from __future__ import annotations

import signal


def heed_interrupts() -> None:
    """As `preexec_fn` of a program: let Ctrl-C reach it.

    What is started in the background, test workers included, ignores it and hands that down to its children; a program
    that a user starts on a terminal does not.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
