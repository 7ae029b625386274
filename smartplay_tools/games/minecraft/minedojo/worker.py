"""The script that runs MineDojo. It runs in MineDojo's interpreter, so it imports nothing from this package.

A request is a line of JSON on the standard input, {"call": name, ...}; the answer is a line of JSON on what was the
standard output, {"ok": result} or {"error": sentence}. The calls are the methods of `Minedojo`.

The worker ends with the process that started it: when the standard input closes, or the parent has ended (even if it
was killed), it kills every process that it has started and removes its working directory, even in the middle of a call.
Minecraft runs in its own session, and MineDojo's watchdog in another; they are recognised by a variable in their
environment.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import queue
import select
import shutil
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

FAMILY = "SMARTPLAY_MINEDOJO_FAMILY"
"""The variable whose value all processes of one worker share, and no other process has."""

KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
"""The signal that cannot be ignored; on Windows that is SIGTERM."""

PARENT_CHECK_SECONDS = 1.0
"""Seconds between two checks for the parent: other children of a killed parent can hold the pipe open."""

SCAN_SECONDS = 0.1
"""Seconds between two scans for processes: while a program is being loaded, its environment is empty."""


def end_family(mark: str) -> None:
    """Kill every process that has this mark in its environment, except this one; needs /proc."""
    wanted = f"{FAMILY}={mark}".encode()
    empty_scans = 0
    for _ in range(10):
        members = [pid for pid in _processes() if wanted in _environment(pid)]
        for pid in members:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, KILL)
        empty_scans = 0 if members else empty_scans + 1
        if empty_scans == 2:
            return
        time.sleep(SCAN_SECONDS)


def _processes() -> list[int]:
    folder = Path("/proc")
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    return [int(name) for name in names if name.isdigit() and int(name) != os.getpid()]


def _environment(pid: int) -> list[bytes]:
    try:
        return Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:  # it has ended, or belongs to another user
        return []


class Minedojo:
    """The calls that the game needs, on MineDojo's environment."""

    def __init__(self) -> None:
        self._environment: Any = None

    def make(self, task: int, settings: dict[str, Any]) -> dict[str, str]:
        """Make the environment of a creative task, without starting the client; return the versions."""
        minedojo = importlib.import_module("minedojo")
        self._environment = minedojo.make(f"creative:{task}", **settings)
        return {name: metadata.version(name) for name in ("minedojo", "gym")}

    def reset(self, world_seed: str) -> dict[str, Any]:
        """Make a new world of that seed; the first call also starts the client."""
        # MineDojo takes a world seed only when an environment is made, and another environment is another client.
        # Unless told otherwise, it continues in the existing world.
        (generator,) = self._environment.unwrapped._sim_spec._world_generator_handlers
        generator.world_seed, generator.force_reset = world_seed, True
        return _observation(self._environment.reset())

    def act(self, actions: list[list[int]], goal: list[int]) -> dict[str, Any]:
        """Play actions, a tick each; stop after any but the first that ends in a goal biome."""
        array = importlib.import_module("numpy").array
        seen: dict[str, Any] = {}
        for number, action in enumerate(actions):
            seen, _, done, _ = self._environment.step(array(action))
            if done:  # no task ends by itself: MineDojo reports this when it has lost the client
                raise RuntimeError("the game's client has ended the episode or is gone")
            if number and int(seen["location_stats"]["biome_id"]) in goal:
                break
        return _observation(seen)

    def close(self) -> None:
        """End the client as MineDojo does."""
        if self._environment is not None:
            self._environment.close()
            self._environment = None


def _observation(seen: dict[str, Any]) -> dict[str, Any]:
    place, rays = seen["location_stats"], seen["rays"]
    names = ("block_name", "block_distance", "entity_name", "entity_distance")
    return {
        "position": place["pos"].tolist(),
        "yaw": float(place["yaw"][0]),
        "pitch": float(place["pitch"][0]),
        "biome": int(place["biome_id"]),
        "blocks": seen["voxels"]["block_name"].tolist(),
        "rays": {name: rays[name].tolist() for name in names},
    }


class Pipe:
    """The pipes to the parent, moved to descriptors that MineDojo and its children do not use."""

    def __init__(self) -> None:
        self._requests = os.dup(0)
        self._answers = os.dup(1)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        os.dup2(2, 1)  # MineDojo prints
        self._parent = os.getppid()
        self._lines: queue.Queue[bytes] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def requests(self) -> Iterable[dict[str, Any]]:
        """Yield every request; the process ends after the last."""
        while True:
            yield json.loads(self._lines.get())

    def answer(self, value: dict[str, Any]) -> None:
        """Send an answer."""
        data = json.dumps(value, separators=(",", ":")).encode() + b"\n"
        while data:
            data = data[os.write(self._answers, data) :]

    def _listen(self) -> None:
        rest = b""
        while True:
            if os.getppid() != self._parent:
                end()
            if not select.select([self._requests], [], [], PARENT_CHECK_SECONDS)[0]:
                continue
            data = os.read(self._requests, 65_536)
            if not data:
                end()
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self._lines.put(line)


def end() -> None:
    """Kill the worker's processes, remove the working directory, and exit at once."""
    end_family(os.environ[FAMILY])
    shutil.rmtree(Path.cwd(), ignore_errors=True)
    os._exit(0)


def main() -> None:
    """Answer requests until there are no more."""
    pipe, minedojo = Pipe(), Minedojo()
    for request in pipe.requests():
        name = request.pop("call")
        try:
            answer = {"ok": getattr(minedojo, name)(**request)}
        except Exception as error:  # the parent handles it
            traceback.print_exc()
            lines = str(error).strip().splitlines() or [""]
            answer = {"error": f"{type(error).__name__}: {lines[-1].strip()}"}
        sys.stderr.flush()
        pipe.answer(answer)


if __name__ == "__main__":
    main()
