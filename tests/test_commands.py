"""Every command on a page is run as it stands, with the client that it names, or listed with the reason why not.

A block `console` begins in an empty folder, a block `sh` where the block before it was run. Models are a rule player
behind OpenAI's interface on this machine, or a script behind Anthropic's. Runs are played in this process, as long as a
command names no other way: workers have tests of their own.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from tests.processes import printed_by

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path
    for pattern in ("README.md", "CONTRIBUTING.md", "docs/**/*.md", "examples/**/*.md", "hub/**/*.md")
    for path in ROOT.glob(pattern)
)
BLOCK = re.compile(r"^( *)```([^\n]*)\n(.*?)^\1```$", flags=re.MULTILINE | re.DOTALL)
CODE = re.compile(r"^```(?:python|py|toml)(?: continued)?\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
SHELLS = ("sh", "bash", "console", "")
PROGRAM = re.compile(r"(smartplay-tools|npx|make|pip|python|export|\.ci/)")
"""How the lines of a block without a language begin if they are commands."""

OTHERS = {
    "clients.md": "`.ci/frameworks.py` installs every framework of the page and runs its program",
    "add-a-strategy.md": "its sweep plays for minutes; tests/test_custom_strategies.py plays such files",
}
"""Pages that are run elsewhere; `tests/adapters/test_frameworks.py` tests the program that runs most of them."""

NOT_RUN = {
    r"pip install|\w+/bin/pip|python3\.1[12] -m venv|uv sync|sudo ": "`.ci/wheel`, `.ci/framework`, people install",
    r"make |\.ci/|(nice )?\.venv/bin/python (-m (pip|pytest|tests)|\.ci/)": "`.ci/run` does it, or it takes hours",
    r"(uv run )?inspect eval|vf-(eval|validate)": "`.ci/framework` has the environment, and runs the adapter there",
    r"prime ": "it needs an account",
    r"(python|openhands/bin/python) (experiments|benchmarks)/": "it takes hours; tests/test_experiments.py plays less",
    r"python examples/20": "it trains for minutes; tests/test_tiny_agent.py trains for less",
    r"smartplay-tools (model get|serve .*--player local)|export '?SMARTPLAY_MINEDOJO": "it fetches much",
    r"smartplay-tools (play .*(--player local|--engine minedojo)|eval .*local:|results runs/taught)": "it needs what "
    "the line before it has fetched or played",
    r"smartplay-tools (.*HigherOrLower|replay game|results runs/players|.*--plugins)": "tests/plugins has its package",
    r"smartplay-tools (eval|sweep) .*(--suite|--trials (60|100)|:MODEL|Mined|MessengerL3)": "it plays for minutes",
    r"smartplay-tools check ": "its servers are examples",
    r"smartplay-tools (eval .*--track|agent |.*my_players)": "it needs a package or a program of the reader",
    r"smartplay-tools doctor$": "tests/test_doctor.py runs it",
    r"smartplay-tools (play|eval) .*(popgym|minigrid)-": "`.ci/framework` has the packs, and plays them there",
}
"""How commands begin that are not run, and why."""

RECORD = """
import smartplay_tools as sp
sp.ContextManager(8_000, record="runs/agent").fit([{"role": "user", "content": "Hi."}])
"""

BEFORE = {
    "any-agent.md": f"python -c {shlex.quote(RECORD)}",
    "evaluation.md": "smartplay-tools eval --games Hanoi3Disk-v0 --players rule --out runs/kept",
    "view.md": "smartplay-tools eval --games Hanoi3Disk-v0 --players rule --out runs/paper",
}
"""What a page takes for granted."""

SERVES = re.compile(r"smartplay-tools (serve|view)|npx @modelcontextprotocol/inspector smartplay-tools")
"""Commands that run until they are stopped; they have printed an address, or answer on standard input."""


class Command(NamedTuple):
    """A command of a page, on one line."""

    page: Path
    block: int
    kind: str
    line: str

    @property
    def is_run(self) -> bool:
        """Whether it is run here."""
        return not any(re.match(begin, self.line) for begin in NOT_RUN)


def commands() -> Iterator[Command]:
    """Yield every command of every page that is run here."""
    for page in PAGES:
        if page.name in OTHERS:
            continue
        blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
        for number, (_, kind, text) in enumerate(block for block in blocks if block[1] in SHELLS):
            for line in map(str.strip, text.replace("\\\n", " ").splitlines()):
                if kind or PROGRAM.match(line):
                    words = shlex.split(line.removesuffix("&"), comments=True)
                    if words:
                        yield Command(page, number, kind or "sh", shlex.join(words))


ALL = list(commands())
BY_PAGE = {
    page: [command for command in group if command.is_run] for page, group in itertools.groupby(ALL, lambda c: c.page)
}


def test_every_reason_is_one_of_a_command():
    for begin in NOT_RUN:
        assert any(re.match(begin, command.line) for command in ALL), f"no command begins with {begin}"
    assert {page.name for page in PAGES} >= OTHERS.keys()
    assert sum(map(len, BY_PAGE.values())) > 60


@pytest.fixture
def models(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Servers on this machine behind the addresses and the keys of the environment."""
    gateway, scripted = pytest.importorskip("smartplay_gateway"), pytest.importorskip("smartplay_anthropic")
    assert scripted
    from tests.adapters.anthropic_stub import AnthropicStub
    from tests.adapters.conformance import WAY, act, calling

    players = [sp.get_player("rule") for _ in range(3)]
    for player, name in zip(players, ("MODEL", "gpt-4o-mini", "llama3"), strict=True):
        player.name = name
    with (
        gateway.LocalEndpoint(*players) as endpoint,
        AnthropicStub(calling(act(move)) for move in WAY) as anthropic,
    ):
        monkeypatch.setenv("OPENAI_BASE_URL", endpoint.base_url)
        monkeypatch.setenv("ANTHROPIC_BASE_URL", anthropic.url)
        yield


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page, own in BY_PAGE.items() if own], ids=lambda page: page.name)
def test_the_commands_of_a_page_work(page, tmp_path, monkeypatch, models):
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    block = None
    for command in BY_PAGE[page]:
        if block is None or (command.block != block and command.kind == "console"):
            folder = tmp_path / str(command.block)
            folder.mkdir()
            monkeypatch.chdir(folder)
            write_files(page)
            if page.name in BEFORE:
                run(BEFORE[page.name], monkeypatch)
        block = command.block
        run(command.line, monkeypatch)


def write_files(page: Path) -> None:
    """Write the files of the page that its commands name: the code with a class, under the name before it."""
    text = page.read_text(encoding="utf-8")
    for file, name in set(re.findall(r"([a-z_]+\.py):(\w+)", text)):
        for code in CODE.findall(text):
            if re.search(rf"^(class )?{name}\b", code, flags=re.MULTILINE):
                Path(file).write_text(code, encoding="utf-8")


def run(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a command to its end, or until it serves."""
    words = shlex.split(line)
    if words[0] == "export":
        monkeypatch.setenv(*words[1].split("=", 1))
    elif SERVES.match(line):
        serve(words)
    elif words[0] == "python":
        printed_by(sys.executable, *words[1:])
    elif words[0] == "smartplay-tools":
        here = words[1] in ("eval", "sweep") and "--executor" not in words
        with local_port(line):
            result = CliRunner().invoke(app, words[1:] + ["--executor", "inline"] * here)
        assert result.exit_code == 0, f"{line}: {result.output}"
    else:
        if words[0] == "npx" and shutil.which("npx") is None:
            pytest.skip("npm is not installed")
        with address(words) as filled:
            done = subprocess.run(
                ["npx", "--yes", *filled[1:]], capture_output=True, text=True, timeout=300, check=False
            )
        assert done.returncode == 0, f"{line}: {done.stdout}{done.stderr}"
        assert '"isError": true' not in done.stdout, f"{line}: {done.stdout}"


def serve(words: list[str]) -> None:
    """Start a server, see that it says where it is or waits for messages, and stop it."""
    words = ["npx", "--yes", *words[1:]] if words[0] == "npx" else [sys.executable, "-m", "smartplay_tools", *words[1:]]
    words = [word for word in words if word != "--open"]
    quiet = {**os.environ, "BROWSER": "true", "MCP_AUTO_OPEN_ENABLED": "false"}
    process = subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=quiet,
        start_new_session=True,
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    alarm = threading.Timer(300, lambda: os.killpg(process.pid, signal.SIGKILL))
    alarm.start()
    try:
        if "mcp" in words and "--http" not in words and words[0] != "npx":
            process.stdin.write('{"jsonrpc": "2.0", "id": 1, "method": "ping"}\n')
            process.stdin.flush()
            said = [process.stdout.readline()]
        else:
            said = [*itertools.takewhile(lambda line: not re.search(r"https?://(127|localhost)", line), process.stdout)]
        assert process.poll() is None, f"{shlex.join(words)}: {''.join(said)}"
    finally:
        alarm.cancel()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@contextlib.contextmanager
def address(words: list[str]) -> Iterator[list[str]]:
    """The words of a command; URL stands for the address of an episode."""
    if "URL" not in words:
        yield words
        return
    from smartplay_mcp import HttpServer

    from smartplay_tools.web import EpisodeStore

    store = EpisodeStore()
    with HttpServer(store, port=0) as server:
        url = f"{server.url}/mcp?episode={store.open('Hanoi3Disk-v0', seed=7)}"
        yield [url if word == "URL" else word for word in words]


def local_port(line: str) -> Any:
    """A server at the port of this machine that a command names."""
    named = re.search(r"http://127\.0\.0\.1:(\d+)/v1", line)
    if named is None:
        return contextlib.nullcontext()
    import smartplay_gateway

    player = sp.get_player("rule")
    player.name = "llama3"
    return smartplay_gateway.LocalEndpoint(player, port=int(named[1]))
