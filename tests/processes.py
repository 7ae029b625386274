"""Programs as a user starts them, from tests that may themselves run in the background."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


def needs_unix() -> None:
    """Skip the calling test or module on systems without Unix's signals and pipes."""
    if os.name != "posix":
        pytest.skip("needs the signals and pipes of Unix", allow_module_level=True)


def needs_proc() -> None:
    """Skip tests that read /proc on systems without it."""
    if not Path("/proc").is_dir():
        pytest.skip("looks at processes through /proc", allow_module_level=True)


def heed_interrupts() -> None:
    """As `preexec_fn` of a program: let Ctrl-C reach it.

    What is started in the background, test workers included, ignores it and hands that down to its children; a program
    that a user starts on a terminal does not.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def is_running(pid: int) -> bool:
    """Whether a process exists and is not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def is_soon(condition: Callable[[], bool], seconds: float = 30) -> bool:
    """Wait for a condition; return whether it has come true."""
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    return condition()


def printed_by(*command: Any, **options: Any) -> str:
    """Run a program, which has to succeed; return what it prints."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=900, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
