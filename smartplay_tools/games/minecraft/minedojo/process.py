"""WorkerProcess: the parent's side of a worker, a process that answers calls within a time limit or is ended."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, cast

from smartplay_tools.errors import EngineError, InvalidArgumentError
from smartplay_tools.games.minecraft.minedojo.worker import FAMILY, end_family
from smartplay_tools.types.arguments import object_in

CLOSE_SECONDS = 20.0
"""Seconds that an orderly close may take: MineDojo gives its client a few seconds."""

EXIT_SECONDS = 3.0
"""Seconds to wait for the exit code of a worker that has closed its pipes."""

LOG_LINES = 40
"""How much of a failed worker's log is recorded."""

_UNWANTED = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP", "VIRTUAL_ENV")
"""Variables that would make another interpreter import the modules of this one."""


class WorkerProcess:
    """A child process that answers lines of JSON. It has its own directory, which is removed when it ends.

    Nothing is left behind: a call that fails or exceeds its time limit ends the worker with all processes that it has
    started, and so does the end of this object or of this process.
    """

    def __init__(self, command: Sequence[str], *, log: Path | None = None, **environment: str) -> None:
        """Start the command with additional variables; its log is appended to the file `log`, or deleted at the end."""
        folder = Path(tempfile.mkdtemp(prefix="smartplay-minedojo-"))
        mark = secrets.token_hex(16)
        outside = {name: value for name, value in os.environ.items() if name not in _UNWANTED}
        inside = {FAMILY: mark, "TMPDIR": str(folder), **environment}
        self._log = log or folder / "worker.log"
        try:
            with self._log.open("ab") as log_file:
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=log_file,
                    cwd=folder,
                    env=outside | inside,
                    bufsize=0,
                    start_new_session=True,  # Ctrl-C goes to this process, which then cleans up
                )
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            what = "written" if str(error.filename) == str(self._log) else "run"
            raise InvalidArgumentError(f"{error.filename} cannot be {what}: {error.strerror}.") from None
        self.end = weakref.finalize(self, _end, self._process, mark, folder, os.getpid())
        """Kill it; may be called more than once."""

    @property
    def alive(self) -> bool:
        """Whether it still runs and can be called."""
        return bool(self.end.alive) and self._process.poll() is None

    def call(self, name: str, *, seconds: float, **arguments: Any) -> Any:
        """Return the answer to a call. If it fails or takes longer, end the worker and raise an `EngineError`."""
        try:
            self._send({"call": name, **arguments})
            answer = self._receive(time.monotonic() + seconds)
            if answer is None:
                raise EngineError(f"MineDojo has not answered {name!r} within {seconds:g} seconds; it was ended.")
            if "error" in answer:
                raise EngineError(f"MineDojo has failed in {name!r}: {str(answer['error']).rstrip('.')}.")
            return answer["ok"]
        except BaseException as error:  # an interrupt, too, would leave an unread answer
            error.add_note(f"The end of the worker's log:\n{self._log_tail()}")
            self.end()
            raise

    def close(self) -> None:
        """Ask it to end, and kill it if it does not."""
        if self.alive:
            with contextlib.suppress(EngineError):
                self.call("close", seconds=CLOSE_SECONDS)
        self.end()

    def _send(self, request: dict[str, Any]) -> None:
        try:
            cast(IO[bytes], self._process.stdin).write(json.dumps(request).encode() + b"\n")
        except (BrokenPipeError, ValueError):
            raise self._gone() from None

    def _receive(self, deadline: float) -> dict[str, Any] | None:
        """The next line, or None after the deadline."""
        source, data = cast(IO[bytes], self._process.stdout), bytearray()
        with selectors.DefaultSelector() as selector:
            selector.register(source, selectors.EVENT_READ)
            while not data.endswith(b"\n"):
                if not selector.select(max(0.0, deadline - time.monotonic())):
                    return None
                more = source.read(1 << 20)
                if not more:
                    raise self._gone()
                data += more
        answer = object_in(data)
        if answer is None or not answer.keys() & {"ok", "error"}:
            raise EngineError(f"MineDojo's worker has sent an invalid answer: {bytes(data[:80])!r}.")
        return answer

    def _gone(self) -> EngineError:
        """The error for a worker that has closed its pipes."""
        try:
            code: int | str = self._process.wait(EXIT_SECONDS)
        except subprocess.TimeoutExpired:
            code = "unknown"
        return EngineError(f"MineDojo's worker has ended (exit code {code}).")

    def _log_tail(self) -> str:
        try:
            lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:
            return ""
        return "\n".join(lines[-LOG_LINES:])


def _end(process: subprocess.Popen[bytes], mark: str, folder: Path, owner: int) -> None:
    """Kill the worker and the processes that it started, and remove its directory."""
    if os.getpid() != owner:  # only the process that made the object may end it, not a fork
        return
    if process.poll() is None:  # else its id may belong to another process by now
        if sys.platform == "win32":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
    end_family(mark)
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            cast(IO[bytes], pipe).close()
    shutil.rmtree(folder, ignore_errors=True)
