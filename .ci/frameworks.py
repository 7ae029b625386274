"""Run the clients of `examples/clients`, each in a separate environment, with a scripted model.

    python .ci/frameworks.py                                  # all of them
    python .ci/frameworks.py play_ag2.py play_openai.mjs      # these alone
    python .ci/frameworks.py --envs /tmp/frameworks play_strands.py

A program says at its beginning what to install, with versions. `smartplay-tools agent`, in the Python that runs this
script, starts it with the rule player behind the window endpoint, and with `--only-game-tools` where the first lines
have that. Where the framework manages the context and reads calls from text, an endpoint writes the rule player's
calls as the framework asks for them. An agent has to win the game, and no prompt of the window endpoint may exceed its
cap. Environments are kept, and reused while the program installs the same; one that installs smartplay-tools gets that
of this checkout.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from smartplay_gateway import LocalEndpoint

import smartplay_tools as sp
from smartplay_tools.types.messages import text_of

ROOT = Path(__file__).parents[1]
CLIENTS = ROOT / "examples" / "clients"
"""The programs, each of which `smartplay-tools agent` starts."""
TEXT_AGENTS = ("play_dspy.py",)
"""Agents that manage the context, and read their calls from the model's text."""
NEEDS_PYTHON = {"play_openhands.py": (3, 12)}
"""Agents whose packages need a later Python than ours."""

OURS, ONLY_GAME_TOOLS = "smartplay-tools", "--only-game-tools"
GAME, SEED, CAP, SECONDS = "Hanoi3Disk-v0", 7, 700, 600
INSTALLS = re.compile(r"^\W*((?:pip|npm) install .+)$", flags=re.MULTILINE)
STARTS = {".mjs": "node", ".sh": "bash"}
"""What starts a program that is not Python, by the ending of its name."""
QUIET = {
    "AGNO_TELEMETRY": "false",
    "ANONYMIZED_TELEMETRY": "false",
    "CREWAI_DISABLE_TELEMETRY": "true",
    "CREWAI_TRACING_ENABLED": "false",
    "NO_PROXY": "127.0.0.1",
    "OPENAI_API_KEY": "none",
    "OTEL_SDK_DISABLED": "true",
}
"""Nothing is reported to anybody, and nobody's key is used."""


def agents() -> list[str]:
    """Return the names of all programs."""
    return sorted(path.name for path in CLIENTS.iterdir() if path.name.startswith("play_"))


def beginning_of(agent: str) -> str:
    """Return the first lines of a program, up to the first that is empty below what it installs."""
    text = (CLIENTS / agent).read_text(encoding="utf-8")
    found = INSTALLS.search(text)
    if found is None:
        raise ValueError(f"{agent} does not say what to install")
    return text[: text.index("\n\n", found.start())]


def install_of(agent: str) -> str:
    """Return the command that installs what a program needs."""
    return INSTALLS.findall(beginning_of(agent))[0]


def environment(install: str, folder: Path) -> None:
    """Make what the command installs, unless it is there."""
    packages = shlex.split(install)[2:]
    note = folder / "installed.txt"
    if not note.exists() or note.read_text(encoding="utf-8") != install:
        folder.mkdir(parents=True, exist_ok=True)
        if install.startswith("npm"):
            run(["npm", "install", "--no-audit", "--no-fund", "--silent", *packages], folder)
        else:
            shutil.rmtree(folder / "venv", ignore_errors=True)
            run([*install_into(folder), *(str(ROOT) if name == OURS else name for name in packages)], folder)
        note.write_text(install, encoding="utf-8")
    elif OURS in packages:
        run([*install_into(folder), "--no-deps", "--force-reinstall", str(ROOT)], folder)


def install_into(folder: Path) -> list[str]:
    """Return the command that installs into an environment, and makes it if it is not there."""
    return ["env", f"PYTHON={sys.executable}", str(ROOT / ".ci" / "install"), str(folder / "venv")]


def python_of(folder: Path) -> str:
    """Return the Python of an environment."""
    return str(folder / "venv" / "bin" / "python")


def run(command: list[str], folder: Path, **options: Any) -> str:
    """Run a command and return what it printed; stop with that if it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, **options)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    printed: str = done.stdout
    return printed


def play(agent: str, envs: Path) -> str:
    """Have an agent play, and say how it did."""
    if sys.version_info < NEEDS_PYTHON.get(agent, ()):
        return f"left out: it needs Python {'.'.join(map(str, NEEDS_PYTHON[agent]))}"
    install, folder = install_of(agent), envs / agent.replace(".", "-")
    environment(install, folder)
    shutil.copy(CLIENTS / agent, folder)
    command = [STARTS.get(Path(agent).suffix) or python_of(folder), agent]
    begun = time.monotonic()
    played = with_texts(command, folder) if agent in TEXT_AGENTS else as_a_program(agent, command, folder)
    return f"{played}, {time.monotonic() - begun:.0f} s; {install}"


def as_a_program(agent: str, command: list[str], folder: Path) -> str:
    """Have `smartplay-tools agent` start an agent, and say how it did."""
    out = folder / "run"
    shutil.rmtree(out, ignore_errors=True)
    options = ["--prompt-tokens", str(CAP), "--timeout", str(SECONDS), "--out", str(out)]
    options += [ONLY_GAME_TOOLS] if ONLY_GAME_TOOLS in beginning_of(agent) else []
    started = [sys.executable, "-m", "smartplay_tools", "agent", GAME, *options, "--", *command]
    # The agent has this environment, too, and is not to find the packages of this script's Python in it.
    shown = run(started, folder, env={**os.environ, **QUIET}, timeout=2 * SECONDS)
    records = [sp.read_transcript(path) for path in sorted((out / "episodes").glob("*.jsonl"))]
    if len(records) != 1:
        raise SystemExit(f"{agent}: {shown[-2000:]}")
    (events,) = records
    return verdict(agent, sp.EpisodeResult(**events[-1]["result"]), events)


def verdict(agent: str, result: sp.EpisodeResult, events: list[Any]) -> str:
    """Say how an agent did; stop if it has not won, or has seen more than its cap."""
    largest = max((event["tokens"] for event in events if event["event"] == "view"), default=0)
    if result.score != 3 or result.end_reason != "terminated" or largest > CAP:
        raise SystemExit(f"{agent}: score {result.score:g}, {result.end_reason}, largest prompt {largest} of {CAP}")
    return f"score {result.score:g}, {result.turns} turns, largest prompt {largest} of {CAP}"


def with_texts(command: list[str], folder: Path) -> str:
    """Run an agent whose model writes its calls as text, and say how it did by what it prints."""
    model = TextModel()
    with LocalEndpoint(model) as endpoint, tempfile.TemporaryDirectory() as cache:
        variables = {"OPENAI_API_BASE": endpoint.base_url, "DSPY_CACHEDIR": cache}
        shown = run(command, folder, env={**os.environ, **QUIET, **variables}, timeout=SECONDS)
    if "score=3.0 " not in shown or "end_reason='terminated'" not in shown:
        raise SystemExit(f"the agent did not win:\n{shown[-2000:]}")
    return f"score 3, {len(model.calls)} calls"


class TextModel:
    """A model that writes the calls of the rule player, one a reply, in the fields that `dspy.ReAct` asks for."""

    name = "gpt-4o-mini"

    def __init__(self) -> None:
        events: list[Any] = []
        with sp.Episode(GAME, seed=SEED, transcript=events) as episode:
            sp.play(episode, sp.get_player("rule"))
        self.calls = [(event["name"], event["arguments"]) for event in events if event["event"] == "call"]

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        """Write the next call, or the answer at the end."""
        asked = text_of(prompt.messages[-1])
        made = asked.count("[[ ## tool_name_")
        if "`[[ ## next_tool_name ## ]]`" not in asked:
            fields = {"reasoning": "The game is over.", "answer": "done"}
        elif made < len(self.calls):
            name, arguments = self.calls[made]
            fields = {"next_thought": "Go on.", "next_tool_name": name, "next_tool_args": arguments}
        else:
            fields = {"next_thought": "It is over.", "next_tool_name": "finish", "next_tool_args": "{}"}
        text = "\n\n".join(f"[[ ## {name} ## ]]\n{value}" for name, value in {**fields, "completed": ""}.items())
        return sp.Reply({"role": "assistant", "content": text})


def main() -> None:
    """Run the agents that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="files of examples/clients; all of them if none is given")
    parser.add_argument("--envs", type=Path, default=Path(tempfile.gettempdir()) / "smartplay-frameworks")
    given = parser.parse_args()
    for agent in given.names or agents():
        print(f"{agent:<40} {play(agent, given.envs)}", flush=True)


if __name__ == "__main__":
    main()
