"""The command `agent`: a program plays the episodes of a run, each under the exact budget."""

from __future__ import annotations

import asyncio
import math
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from subprocess import DEVNULL, STDOUT
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.episode_options import OF_RUNS, EpisodeOptions, with_episode_options
from smartplay_tools.cli.serve_window import (
    OnlyGameTools,
    ShowSystem,
    chosen,
    ended,
    open_endpoint,
    plan_of,
    server,
)
from smartplay_tools.terminal import say

if TYPE_CHECKING:
    from smartplay_tools.evaluation.runs.agents import Held
    from smartplay_tools.evaluation.runs.run_options import RunProgress

LAST_WORDS = 300
"""Characters of a failed program's output that its error shows."""


@with_episode_options(without=("protocol", *OF_RUNS))
def agent(
    game: options.Game,
    command: Annotated[
        list[str], typer.Argument(metavar="-- CMD...", help="The program, started once for every episode.")
    ],
    player: Annotated[
        str, typer.Option(help="The model that the program uses: openai:MODEL, anthropic:MODEL, rule, ...")
    ] = "rule",
    base_url: options.BaseUrl = None,
    name: Annotated[str | None, typer.Option(help="The agent's name in tables; the program's if not given.")] = None,
    seed: options.Seed = 0,
    episodes: Annotated[int, typer.Option(help="Play N episodes, with the seeds of `eval`.", min=1)] = 1,
    at_once: Annotated[int, typer.Option(help="Programs at a time.", min=1)] = 1,
    timeout: Annotated[float, typer.Option(help="End a program after N seconds.", min=0)] = 3600.0,
    only_game_tools: OnlyGameTools = False,
    show_system: ShowSystem = False,
    out: runs.Out = Path("agent"),
    run_tokens: runs.RunTokens = None,
    run_cost: runs.RunCost = None,
    price: runs.Prices = None,
    *,
    episode: EpisodeOptions,
) -> None:
    """Play a run with a program of yours, which asks its model at an address that shows it the exact window.

    The program's environment has OPENAI_BASE_URL, OPENAI_MODEL and OPENAI_API_KEY, the same for ANTHROPIC_, the address
    of the game's tools as SMARTPLAY_MCP_URL, and SMARTPLAY_HANDLE; {base_url}, {anthropic_url}, {model}, {mcp_url} and
    {handle} in CMD are replaced by these values. The episode ends when the program ends. A program that fails is
    started again, and the same command continues a run that was interrupted.

    Example: smartplay-tools agent Hanoi3Disk-v0 --episodes 20 --prompt-tokens 2000 -- python my_agent.py
    """
    from smartplay_tools.cli.evaluate import print_run
    from smartplay_tools.evaluation.runs.players import PlayerConfig
    from smartplay_tools.evaluation.runs.run_options import RunOptions
    from smartplay_tools.evaluation.runs.runner import run_plan

    shown: dict[str, Any] = {"only_game_tools": only_game_tools, "show_system": show_system}
    endpoint = open_endpoint(player, base_url, seed, idle=math.inf, **shown)
    programs = _Programs(endpoint, command, timeout, out / "output")
    labels = {"agent": name or Path(command[0]).name, **chosen(shown)}
    config = PlayerConfig(name=player, agent=programs, options={**server(base_url), **labels})
    plan = plan_of(game, config, episodes, seed, episode)
    with endpoint:
        how = RunOptions(
            workers=at_once,
            run_tokens=run_tokens,
            run_cost=run_cost,
            prices=runs.prices(price),
            on_progress=programs.tell,
        )
        run = run_plan(plan, out, [config], how)
    print_run(run, as_json=False)


class _Programs:
    """Starts a program for each episode and waits for its end. What it prints is in the folder `output` of the run."""

    goes_on = False

    def __init__(self, endpoint: Any, command: list[str], timeout: float, output: Path) -> None:
        self._endpoint, self._command, self._timeout, self._output = endpoint, command, timeout, output

    async def play(self, held: Held) -> None:
        """Play an episode with a new process of the program."""
        handle = self._endpoint.serve(held.episode)
        self._output.mkdir(exist_ok=True)
        printed = self._output / f"{held.key}.txt"
        try:
            status = await self._run(handle, held, printed)
            if status and not held.is_over:
                from smartplay_tools.evaluation.runs.agents import AgentFailedError

                words = " ".join(printed.read_text(encoding="utf-8", errors="replace").split())[-LAST_WORDS:]
                raise AgentFailedError(f"The program has ended with status {status}: {words or 'it printed nothing'}")
            held.leave("The program has ended." if status == 0 else f"The program had {self._timeout:g} seconds.")
        finally:
            self._endpoint.close(handle)

    async def _run(self, handle: str, held: Held, printed: Path) -> int | None:
        """Return the program's exit status; None if it had to be ended."""
        places = {
            "base_url": self._endpoint.base_url,
            "anthropic_url": self._endpoint.url,
            "model": self._endpoint.model(handle),
            "mcp_url": self._endpoint.mcp_url(handle),
            "handle": handle,
        }
        with printed.open("wb") as output:
            process = await asyncio.create_subprocess_exec(
                *(_filled(part, places) for part in self._command),
                env={**os.environ, **_environment(places)},
                stdin=DEVNULL,
                stdout=output,
                stderr=STDOUT,
                start_new_session=True,  # Ctrl-C goes to this process, which then ends the program
            )
        ending = asyncio.ensure_future(process.wait())
        with suppress(TimeoutError):
            async with asyncio.timeout(self._timeout):
                await held.wait_for(ending)
        if not ending.done():
            _kill(process)
            await ending
            return None
        return ending.result()

    def tell(self, progress: RunProgress) -> None:
        """Print the end of an episode."""
        if progress.episode is not None:
            name = f"{progress.finished} of {progress.planned}  seed {progress.episode.seed}"
            say(f"{name}  {progress.error}" if progress.row is None else ended(name, progress.row))


def _filled(part: str, places: dict[str, str]) -> str:
    for name, value in places.items():
        part = part.replace(f"{{{name}}}", value)
    return part


def _environment(places: dict[str, str]) -> dict[str, str]:
    here = ",".join(filter(None, (os.environ.get("NO_PROXY", ""), "127.0.0.1")))
    return {
        "OPENAI_BASE_URL": places["base_url"],
        "OPENAI_API_BASE": places["base_url"],
        "OPENAI_API_KEY": "none",
        "OPENAI_MODEL": places["model"],
        "ANTHROPIC_BASE_URL": places["anthropic_url"],
        "ANTHROPIC_API_KEY": "none",
        "ANTHROPIC_MODEL": places["model"],
        "SMARTPLAY_MCP_URL": places["mcp_url"],
        "SMARTPLAY_HANDLE": places["handle"],
        "NO_PROXY": here,
        "no_proxy": here,
    }


def _kill(process: asyncio.subprocess.Process) -> None:
    with suppress(ProcessLookupError):
        if sys.platform == "win32":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
