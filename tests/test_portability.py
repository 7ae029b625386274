"""Systems without Unix's modules: everything can be imported, a run is played, and the rest is refused.

The tests take Unix away from a Python that has it. What is left of the libraries below (an event loop, processes) is
loaded before, since on another system they would find what that system has.
"""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

import pytest

from smartplay_tools.types.sums import added
from tests.processes import printed_by

IMPORT_EVERYTHING = """
import importlib, pkgutil, sys

def import_everything():
    count = 0
    others = ("smartplay_anthropic", "smartplay_gateway", "smartplay_langchain", "smartplay_openai")
    for root in ("smartplay_tools", *others):
        package = importlib.import_module(root)
        for module in pkgutil.walk_packages(package.__path__, f"{root}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
                count += 1
    return count
"""

WITHOUT_UNIX = """
import os, signal, select
GONE = ("fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty")
known = import_everything()

for name in [name for name in sys.modules if name.split(".")[0].startswith(("smartplay_", "filelock"))]:
    del sys.modules[name]
for name in GONE:
    sys.modules[name] = None  # an import of it is now an ImportError
for name in ("fork", "forkpty", "getpgid", "getuid", "geteuid", "killpg", "setsid"):
    delattr(os, name)
for name in ("SIGALRM", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGUSR1", "SIGUSR2", "alarm", "pause", "setitimer"):
    delattr(signal, name)
del select.poll
assert import_everything() == known > 100
"""

PLAY = """
import warnings
import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of filelock, which has neither Unix nor Windows here
    run = sp.evaluate(["Hanoi3Disk-v0"], out=sys.argv[1], trials=2, executor="inline")
assert run.complete and len(RunFolder(sys.argv[1]).rows()) == 2
try:
    sp.Episode("MinedojoCreative0-v0", seed=0, engine="minedojo")
except sp.InvalidArgumentError as error:
    print(error)
"""


def run_python(script: str, *arguments: object) -> str:
    command = [sys.executable, "-c", script, *map(str, arguments)]
    return printed_by(*command)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="nothing is to be taken away here")
def test_without_unix_s_modules_everything_imports_and_a_run_is_played(tmp_path):
    printed = run_python(IMPORT_EVERYTHING + WITHOUT_UNIX + PLAY, tmp_path / "run")
    assert printed.splitlines() == [
        "The engine 'minedojo' needs the processes and pipes of Unix; use the engine 'voxel' here, or WSL."
    ]


def sources() -> list[Path]:
    """Every Python file of the package and of the adapters, wherever they are installed."""
    names = ("smartplay_tools", "smartplay_anthropic", "smartplay_gateway", "smartplay_langchain", "smartplay_openai")
    folders = [Path(file).parent for name in names if (file := importlib.import_module(name).__file__)]
    assert len(folders) == len(names)
    return [path for folder in folders for path in folder.rglob("*.py")]


def test_what_is_written_has_the_same_bytes_on_every_system():
    """Text files are opened for writing with an explicit encoding and newline."""
    missing = []
    for path in sources():
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            writes = any(f'.open("{mode}"' in line for mode in "wax") or ".write_text(" in line
            if writes and not ("encoding=" in line and "newline=" in line):
                missing.append(f"{path.name}:{number}")
    assert missing == []


def test_costs_and_weights_are_added_up_alike_on_every_python():
    assert added([0.1] * 10) == 0.9999999999999999  # since Python 3.12 `sum` says 1.0
