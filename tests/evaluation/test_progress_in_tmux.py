"""The progress of a run where people look at it: a terminal multiplexer of 80x24, with a model that takes its time."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.evaluation.servers import calling, completion, serving
from tests.processes import printed_by

TMUX = shutil.which("tmux")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(TMUX is None, reason="there is no tmux on this machine")]
pytest.importorskip("openai")

RPS, HANOI = "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"
PROGRAM = f"{shlex.quote(sys.executable)} -m smartplay_tools"


class Pane:
    """A shell in tmux, on a server of its own."""

    def __init__(self, folder: Path, rows: int = 24, columns: int = 80) -> None:
        self.rows, self.columns = rows, columns
        self._tmux = [str(TMUX), "-S", str(folder / "tmux"), "-f", "/dev/null"]
        self._run("new-session", "-d", "-x", str(columns), "-y", str(rows), "env", "PS1=$ ", "OPENAI_API_KEY=x", "sh")

    def type(self, command: str) -> None:
        self._run("send-keys", command, "Enter")

    def interrupt(self) -> None:
        self._run("send-keys", "C-c")

    def lines(self) -> list[str]:
        return self._run("capture-pane", "-p").splitlines()

    def history(self) -> str:
        """Everything that has been printed, what has scrolled away included; wrapped lines are joined."""
        return self._run("capture-pane", "-p", "-J", "-S", "-")

    def until(self, is_there: Callable[[str], object], seconds: float = 120) -> list[str]:
        end = time.monotonic() + seconds
        while not is_there("\n".join(lines := self.lines())):
            assert time.monotonic() < end, "\n".join(lines)
            time.sleep(0.2)
        return lines

    def close(self) -> None:
        self._run("kill-server")

    def _run(self, *words: str) -> str:
        return subprocess.run([*self._tmux, *words], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def pane(tmp_path) -> Iterator[Pane]:
    pane = Pane(tmp_path)
    yield pane
    pane.close()


@pytest.fixture
def slow_model() -> Iterator[str]:
    """A model whose replies take a moment."""

    def answer(body, number):
        time.sleep(0.1)
        return completion(calling("act", action="1"), prompt_tokens=300, completion_tokens=20)

    with serving(answer) as (url, _):
        yield url


def test_bars_in_80x24_then_the_table_and_the_results_of_a_run_that_goes_on(pane, slow_model, tmp_path):
    out = tmp_path / "run"
    words = f"--games {RPS},{HANOI} --players openai:m --base-url {slow_model} --trials 3 --workers 3 --out {out}"
    pane.type(f"{PROGRAM} eval {words} --tool-calls 25 --price openai:m=1,2 --run-cost 5 --run-tokens 9000000")
    lines = pane.until(lambda screen: re.search(r"[3-9] running, .*\d+ calls", screen))
    text = "\n".join(lines)
    assert len(lines) <= pane.rows
    assert all(len(line) <= pane.columns for line in lines)
    assert text.count(RPS) >= 1
    facts = " ".join(text.split())
    for words in (r"0/6 episodes", r"\d+ steps", r"/9\.0M tokens", r"\$\d+\.\d\d/5\.00", r"left"):
        assert re.search(words, facts), (words, facts)
    later = pane.until(lambda screen: re.search(r"[1-9]/3", screen) or "Spent in all" in screen)
    assert "\n".join(later).count("episodes,") <= 1, "the bars are drawn over themselves, not below"

    shown = printed_by(sys.executable, "-m", "smartplay_tools", "results", str(out))
    if "6 of 6" not in shown:
        assert "being played" in shown
        assert "silent" in shown
        tables = [line for line in shown.splitlines() if not line.endswith(".") and str(out) not in line]
        assert all(len(line) <= 80 for line in tables), tables

    pane.until(lambda screen: "Spent in all" in screen, seconds=240)
    history = pane.history()
    assert "6/6 episodes" in history
    assert len(re.findall(r"\d/6 episodes", history)) == 1, "one picture is left of the progress"


def test_ctrl_c_leaves_the_terminal_in_order_and_says_how_to_go_on(pane, slow_model, tmp_path):
    words = f"--games {RPS} --players openai:m --base-url {slow_model} --trials 2 --out {tmp_path / 'run'}"
    pane.type(f"{PROGRAM} eval {words}")
    pane.until(lambda screen: re.search(r"[1-9]\d* calls", screen))
    pane.interrupt()
    lines = pane.until(lambda screen: "The same command continues the run" in " ".join(screen.split()))
    assert "Stopped by SIGINT" in " ".join("\n".join(lines).split())
    pane.type("echo still-a-$((1+1))-shell")
    pane.until(lambda screen: "still-a-2-shell" in screen)
