"""A running Luanti server, which takes commands line by line.

Commands and answers go through two pipes, of which this process holds one end each. However this process ends, its ends
are closed, and the guard then stops the server and removes its folder.
"""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import time
import weakref
from pathlib import Path
from typing import Any

from smartplay_tools.errors import EngineError
from smartplay_tools.games.minecraft.luanti import server_guard as guard
from smartplay_tools.games.minecraft.luanti.install import Installation

START_SECONDS = 60.0
"""The time limit for a start, which takes half a second on an idle machine."""

ANSWER_SECONDS = 180.0
"""The time limit for a command: a new world takes some seconds, an action up to two."""

CLOSE_SECONDS = 10.0

_MOD = Path(__file__).with_name("mod")


class LuantiServer:
    """A server with the world of a seed. The constructor waits until it takes commands."""

    def __init__(self, installation: Installation, seed: int) -> None:
        commands, self._commands = os.pipe()
        self._answers, answers = os.pipe()
        self._unread = b""
        arguments = map(str, [commands, answers, seed, installation.program, installation.game, _MOD])
        try:
            self._guard = subprocess.Popen(
                [sys.executable, "-I", "-S", guard.__file__, *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=[commands, answers],
                start_new_session=True,  # Ctrl-C goes to this process, which then cleans up
            )
        finally:
            os.close(commands)
            os.close(answers)
        self._finalizer = weakref.finalize(self, _stop, self._guard, self._commands, self._answers)
        facts = self._read("start", START_SECONDS)
        self.version: str = facts["version"]
        """The engine's version."""
        self.decorations: str = facts["decorations"]
        """A digest of the map's decorations in order; worlds are reproducible only if it is the same in every run."""

    @property
    def process(self) -> int:
        """The id of the guard's process."""
        return self._guard.pid

    def ask(self, command: str, **arguments: Any) -> Any:
        """Send a command and return its answer; raise `EngineError`, and stop the server, if it does not answer."""
        if not self._finalizer.alive:
            raise EngineError("The Luanti server has been stopped: reset starts another one.")
        line = json.dumps({"command": command, **arguments}).encode() + b"\n"
        try:
            while line:
                line = line[os.write(self._commands, line) :]
        except BrokenPipeError:
            pass  # it has ended; reading the answer reports why
        return self._read("answer", ANSWER_SECONDS)

    def close(self) -> None:
        """Stop the server and remove its folder; may be called more than once."""
        self._finalizer()

    def _read(self, what: str, seconds: float) -> Any:
        try:
            answer = json.loads(self._read_line(what, time.monotonic() + seconds, seconds))
        except BaseException:
            # A late answer would be mistaken for the answer to the next command.
            self.close()
            raise
        if "error" in answer:
            self.close()
            raise EngineError(f"The Luanti server failed: {answer['error']}")
        return answer

    def _read_line(self, what: str, deadline: float, seconds: float) -> bytes:
        while b"\n" not in self._unread:
            if not _is_readable(self._answers, deadline - time.monotonic()):
                raise EngineError(f"The Luanti server did not {what} within {seconds:g} s and was stopped.")
            read = os.read(self._answers, 65536)
            if not read:
                raise EngineError(f"The Luanti server ended: {self._last_words()}")
            self._unread += read
        line, _, self._unread = self._unread.partition(b"\n")
        return line

    def _last_words(self) -> str:
        assert self._guard.stdout is not None
        readable = _is_readable(self._guard.stdout.fileno(), CLOSE_SECONDS)
        words = self._guard.stdout.read().decode(errors="replace") if readable else ""
        return words or "it gave no reason."


def _is_readable(file: int, seconds: float) -> bool:
    with selectors.DefaultSelector() as selector:
        selector.register(file, selectors.EVENT_READ)
        return bool(selector.select(max(seconds, 0)))


def _stop(process: subprocess.Popen[bytes], commands: int, answers: int) -> None:
    """Close all pipes, whereupon the guard cleans up, and wait for it."""
    assert process.stdin is not None
    assert process.stdout is not None
    for end in (commands, answers):
        os.close(end)
    process.stdin.close()
    try:
        process.wait(CLOSE_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    process.stdout.close()
