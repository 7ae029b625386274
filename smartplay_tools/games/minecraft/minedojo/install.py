"""The installation of MineDojo 0.1 in a virtual environment.

MineDojo pins gym 0.21.0, whose metadata is refused by current versions of pip and setuptools, so the environment gets
older ones first. Every other version is pinned in `requirements.txt`, for one version of Python.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path

from smartplay_tools.errors import EngineError, InvalidArgumentError
from smartplay_tools.games.minecraft.minedojo.engine import check_package
from smartplay_tools.games.minecraft.minedojo.process import foreign_environment

PYTHON = (3, 11)
"""The version that the pins are for."""

TOOLS = ("pip==24.0", "setuptools==65.5.1", "wheel==0.38.4")
"""The last versions that can install gym 0.21.0."""

_VERSION = "import sys; print(*sys.version_info[:2])"


def install(folder: Path, python: str | None = None, say: Callable[[str], None] = lambda step: None) -> Path:
    """Make the environment in a new folder, try it, and return its interpreter; if it fails, there is no folder.

    `python` is a Python 3.11 to make it with, this one or the one on the path by default; `say` gets each step.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidArgumentError(f"{folder} is there already; name a new folder, or remove it first.")
    maker = _maker(python)
    interpreter = folder.absolute() / "bin" / "python"
    options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--no-compile"]
    pip = [str(interpreter), "-m", "pip", "install", *options]
    pins = resources.files(__package__) / "requirements.txt"
    try:
        say("making the environment")
        _run([maker, "-m", "venv", str(folder)], "could not make an environment; on Debian it needs python3-venv")
        say("installing the tools that gym 0.21.0 needs")
        _run([*pip, *TOOLS], "could not install pip, setuptools and wheel; is the package index in reach?")
        say("installing MineDojo")
        with resources.as_file(pins) as file:
            _run([*pip, "--no-build-isolation", "-r", str(file)], "could not install MineDojo's packages")
        say("trying it")
        check_package(str(interpreter))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return interpreter


def _maker(python: str | None) -> str:
    wanted = ".".join(map(str, PYTHON))
    if python is None:
        python = sys.executable if sys.version_info[:2] == PYTHON else shutil.which(f"python{wanted}")
        if python is None:
            raise InvalidArgumentError(f"MineDojo needs Python {wanted}, which is not on the path; name one.")
    try:
        shown = subprocess.run([python, "-c", _VERSION], capture_output=True, text=True, check=False)
    except OSError as error:
        raise InvalidArgumentError(f"{python} cannot be run: {error.strerror}; name a Python {wanted}.") from None
    version = ".".join(shown.stdout.split())
    if version != wanted:
        raise InvalidArgumentError(f"MineDojo needs Python {wanted}; {python} is {version or 'not a Python'}.")
    return python


def _run(command: Sequence[str], failure: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=foreign_environment(os.environ))
    if done.returncode:
        lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        reason = next((line for line in reversed(lines) if "ERROR" in line), lines[-1] if lines else "")
        error = EngineError(f"{Path(command[0]).name} {failure} ({reason.strip()}).")
        error.add_note("\n".join(lines))
        raise error
