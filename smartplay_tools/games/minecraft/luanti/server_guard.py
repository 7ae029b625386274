"""The guard: a program that starts the server in a temporary folder and cleans up after it in every case.

It runs as a separate process and outlives the process that uses the server, so nothing is left behind even if that
process is killed. That process holds the guard's standard input open; when it is closed, the guard cleans up. If the
server ends by itself, the guard prints the reason to standard output. Two more files, given as file descriptors, are
passed on to the server: the commands as its standard input, and the answers under the same descriptor.

It uses only the standard library.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

PREFIX = "smartplay-luanti-"
"""The prefix of the folders' names."""

PATIENCE = 0.5
"""Seconds between two checks of the server and of the process that uses it."""

HERE = Path(__file__).parent


def main(commands: int, answers: int, seed: str, program: str, game: str, mod: str) -> None:
    """Serve until standard input or the server ends."""
    parent = os.getppid()
    for ending in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, ending):
            signal.signal(getattr(signal, ending), lambda *_: sys.exit(1))
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as folder:
        home = Path(folder)
        settings = (HERE / "server.conf").read_text(encoding="utf-8")
        _furnish(home, Path(game), Path(mod), settings.format(answers=answers, seed=seed, port=_free_port()))
        server = _start(home, program, commands, answers)
        try:
            # Only the server may hold these, so that their end is noticed.
            os.close(commands)
            os.close(answers)
            while server.poll() is None and os.getppid() == parent:
                if select.select([0], [], [], PATIENCE)[0]:
                    return
            sys.stdout.write(_last_words(home))
        finally:
            server.kill()
            server.wait()


def _furnish(home: Path, game: Path, mod: Path, settings: str) -> None:
    world = home / "world"
    shutil.copytree(mod, world / "worldmods" / "smartplay")
    (world / "game").symlink_to(game)
    shutil.copyfile(HERE / "world.mt", world / "world.mt")
    (home / "server.conf").write_text(settings, encoding="utf-8", newline="\n")


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _start(home: Path, program: str, commands: int, answers: int) -> subprocess.Popen[bytes]:
    files = {"--world": home / "world", "--config": home / "server.conf", "--logfile": home / "log"}
    options = [word for name, file in files.items() for word in (name, str(file))]
    with (home / "errors").open("wb") as errors:
        return subprocess.Popen(
            [program, *options, "--quiet"],
            cwd=home,
            env=_environment(home),
            stdin=commands,
            stdout=errors,
            stderr=errors,
            pass_fds=[answers],
        )


def _environment(home: Path) -> dict[str, str]:
    """The variables of this process, without those that lead to the user's own settings, mods and games."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("MINETEST_", "LUANTI_"))}
    return {**kept, "HOME": str(home)}


def _last_words(home: Path) -> str:
    """The first line of the log that reports an error, or else its last line."""
    texts = [
        (home / name).read_text(encoding="utf-8", errors="replace")
        for name in ("errors", "log")
        if (home / name).exists()
    ]
    lines = [line.strip() for text in texts for line in text.splitlines() if line.strip()]
    return next((line for line in lines if "ERROR" in line), lines[-1] if lines else "")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
