"""Context strategies of other frameworks, as their packages have them, on the same worlds: a table of `docs/hosts.md`.

    pip install 'smartplay-tools[openai,serve]' 'pydantic-ai-slim[openai]'
    pip install langchain langchain-openai deepagents inspect-ai
    python experiments/hosts.py                          # a scripted player as the model: no key, minutes
    python experiments/hosts.py --player openai:MODEL    # the same question to a model
    python experiments/hosts.py --host langchain-summary # one of them alone; repeatable
    python experiments/hosts.py --host openhands-summary --out runs/openhands  # with openhands-sdk and Python 3.12

Each host is the agent of a framework, which manages its context itself. Its model is an endpoint on this machine, so
the framework is what its users have: its own client, its own loop, its own strategy. The endpoint counts every prompt,
puts it on record, and has a player answer. The cap is what a strategy is told to aim at; nothing enforces it, so the
table says how many prompts are over it. `window` is this library's own, on the same seeds, which is never over.

To add a host, write a function of `HostedGame` and add it to `HOSTS`.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from page_tables import arguments, complete, interval, show
from smartplay_openai import LocalEndpoint

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.intervals import mean_estimates
from smartplay_tools.evaluation.analysis.pairs import MEASURES, difference_sample, pairs, sample
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.players import NotedPlayer
from smartplay_tools.records.rows import Row
from smartplay_tools.types.messages import text_of

PAGE = Path(__file__).parents[1] / "docs" / "hosts.md"
GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0")
CAP = 1500
"""What the strategies aim at, in tokens."""
KEPT = 6
"""The newest messages, or results, that those strategies keep which count in them."""


@dataclass(frozen=True)
class HostedGame:
    """What an agent of a framework needs to play an episode."""

    tools: Sequence[Callable[..., str]]
    """observe, act and read_manual as plain functions."""
    instructions: str
    task: str
    model: str
    base_url: str
    give_up: Callable[[str], None]
    """Ends the episode where the strategy itself gives up, and says why; the score so far counts."""


def _chat(game: HostedGame) -> Any:
    from langchain_openai import ChatOpenAI

    return ChatOpenAI(model=game.model, base_url=game.base_url, api_key="none", max_retries=0)


async def _langchain(game: HostedGame, middleware: Sequence[Any]) -> None:
    from langchain.agents import create_agent

    agent = create_agent(_chat(game), [*game.tools], system_prompt=game.instructions, middleware=middleware)
    await _invoke(agent, game)


async def _invoke(agent: Any, game: HostedGame) -> None:
    messages = [{"role": "user", "content": game.task}]
    await agent.ainvoke({"messages": messages}, {"recursion_limit": 100_000})


async def langchain_all(game: HostedGame) -> None:
    """LangChain's agent without any strategy: everything stays."""
    await _langchain(game, [])


async def langchain_summary(game: HostedGame) -> None:
    """LangChain's `SummarizationMiddleware`."""
    from langchain.agents.middleware import SummarizationMiddleware

    trigger, keep = ("tokens", CAP), ("messages", KEPT)
    await _langchain(game, [SummarizationMiddleware(_chat(game), trigger=trigger, keep=keep)])


async def langchain_clear(game: HostedGame) -> None:
    """LangChain's `ContextEditingMiddleware`, which clears the oldest results."""
    from langchain.agents.middleware import ClearToolUsesEdit, ContextEditingMiddleware

    await _langchain(game, [ContextEditingMiddleware(edits=[ClearToolUsesEdit(trigger=CAP, keep=KEPT)])])


async def deepagents_offload(game: HostedGame) -> None:
    """The `SummarizationMiddleware` of deepagents, which writes what leaves to a file."""
    from deepagents.backends import StateBackend
    from deepagents.middleware.filesystem import FilesystemMiddleware
    from deepagents.middleware.summarization import SummarizationMiddleware

    backend = StateBackend()
    summary = SummarizationMiddleware(_chat(game), backend=backend, trigger=("tokens", CAP), keep=("messages", KEPT))
    await _langchain(game, [FilesystemMiddleware(backend=backend), summary])


async def _inspect(game: HostedGame, compaction: Any) -> None:
    from inspect_ai import Task, eval_async
    from inspect_ai.agent import react
    from inspect_ai.dataset import Sample
    from inspect_ai.model import get_model
    from inspect_ai.tool import ToolDef

    model = get_model(f"openai-api/local/{game.model}", base_url=game.base_url, api_key="none", memoize=False)
    tools = [
        ToolDef(_awaitable(tool), name=tool.__name__, description=str(tool.__doc__), parameters=_parameters(tool))
        for tool in game.tools
    ]
    agent = react(prompt=game.instructions, tools=tools, model=model, submit=False, compaction=compaction)
    task = Task(dataset=[Sample(input=game.task)], solver=agent)
    with tempfile.TemporaryDirectory() as logs:
        (log,) = await eval_async(task, model=model, log_dir=logs)
    if log.error is not None and "Compaction insufficient" in log.error.message:
        game.give_up("Compaction insufficient")
    elif log.error is not None:
        raise RuntimeError(log.error.message)


def _awaitable(tool: Callable[..., str]) -> Callable[..., Awaitable[str]]:
    if tool.__name__ != "act":

        async def ask() -> str:
            return tool()

        return ask

    async def act(action: str) -> str:
        return tool(action)

    return act


def _parameters(tool: Callable[..., str]) -> dict[str, str]:
    return {"action": "The action."} if tool.__name__ == "act" else {}


async def inspect_edit(game: HostedGame) -> None:
    """Inspect's `CompactionEdit`, which clears the oldest results."""
    from inspect_ai.model import CompactionEdit

    await _inspect(game, CompactionEdit(threshold=CAP, keep_tool_uses=KEPT))


async def inspect_trim(game: HostedGame) -> None:
    """Inspect's `CompactionTrim`, which drops the oldest fifth of the messages."""
    from inspect_ai.model import CompactionTrim

    await _inspect(game, CompactionTrim(threshold=CAP))


async def inspect_summary(game: HostedGame) -> None:
    """Inspect's `CompactionSummary`."""
    from inspect_ai.model import CompactionSummary

    await _inspect(game, CompactionSummary(threshold=CAP))


async def pydantic_ai_newest(game: HostedGame) -> None:
    """Pydantic AI's `ProcessHistory` with a processor as its documentation has it: the newest messages alone."""
    from pydantic_ai import Agent
    from pydantic_ai.capabilities import ProcessHistory
    from pydantic_ai.models.openai import OpenAIChatModel
    from pydantic_ai.providers.openai import OpenAIProvider
    from pydantic_ai.usage import UsageLimits

    def newest(messages: list[Any]) -> list[Any]:
        # A result stays with the call that it answers, so a cut begins with a response of the model.
        if len(messages) <= 2 * KEPT:
            return messages
        return [messages[0], *messages[-2 * KEPT :]]

    model = OpenAIChatModel(game.model, provider=OpenAIProvider(base_url=game.base_url, api_key="none"))
    agent = Agent(model, instructions=game.instructions, tools=[*game.tools], capabilities=[ProcessHistory(newest)])
    await agent.run(game.task, usage_limits=UsageLimits(request_limit=None))


async def openhands_summary(game: HostedGame) -> None:
    """The `LLMSummarizingCondenser` of OpenHands, whose SDK needs Python 3.12."""
    from openhands_host import play as play_openhands

    play_openhands(game.tools, game.instructions, game.task, game.model, game.base_url, CAP)


HOSTS: dict[str, Callable[[HostedGame], Awaitable[None]]] = {
    "langchain-all": langchain_all,
    "langchain-summary": langchain_summary,
    "langchain-clear": langchain_clear,
    "deepagents-offload": deepagents_offload,
    "inspect-edit": inspect_edit,
    "inspect-trim": inspect_trim,
    "inspect-summary": inspect_summary,
    "pydantic-ai-newest": pydantic_ai_newest,
}
"""The agents by the names that the table gives them."""
APART = {"openhands-summary": openhands_summary}
"""Those that are played, and have a table, only if they are named: their framework needs a newer Python."""


def play(host: Callable[[HostedGame], Awaitable[None]], player: str, episode: sp.Episode) -> None:
    """Have a framework's agent play an episode, with every prompt noted."""
    subject = NotedPlayer(sp.get_player(player), episode)
    system, task = map(text_of, episode.head)
    with LocalEndpoint(subject) as endpoint:
        give_up = partial(_give_up, episode)
        game = HostedGame(episode.functions(), system, task, subject.name, endpoint.base_url, give_up)
        asyncio.run(host(game))


def _give_up(episode: sp.Episode, why: str) -> None:
    episode.end("host", detail=why)


def agent_of(name: str, player: str) -> Callable[[sp.Episode], None]:
    """Return the agent of a host as `evaluate` takes it."""

    def agent(episode: sp.Episode) -> None:
        play({**HOSTS, **APART}[name], player, episode)

    return agent


def main() -> None:
    """Play both runs, print the table, and write it."""
    asked = _arguments()
    os.environ |= {"NO_PROXY": "127.0.0.1", "INSPECT_LOG_LEVEL": "error", "LANGSMITH_TRACING": "false"}
    os.environ["OPENHANDS_SUPPRESS_BANNER"] = "1"
    # What a result may have is the same for all: its cap follows from that on prompts.
    budget = sp.Budget(prompt_tokens=CAP, history=None)
    run = partial(complete, GAMES, trials=asked.trials, budgets=budget)
    window = run([PlayerConfig(name=asked.player)], out=asked.out / "window")
    agents = {name: agent_of(name, asked.player) for name in asked.host or HOSTS}
    hosted = run(agents, out=asked.out / "hosts", context="host", workers=1)
    written = "\n".join(table(window.rows, hosted.rows, hosted.folder))
    show(PAGE, "-".join(["hosts", *(asked.host or ())]), written, publishes=asked.publish)


def table(window: Sequence[Row], hosted: Sequence[Row], folder: RunFolder) -> Iterator[str]:
    """Every host beside this library's window on the same seeds, in Markdown; intervals hold together."""
    own = {cell.game: members for cell, members in by_cell(window)}
    cells = by_cell(hosted)
    score, tokens = MEASURES["score"], MEASURES["tokens"]
    paired = [pairs(members, own[cell.game]) for cell, members in cells]
    differences = mean_estimates([difference_sample(each, score) for each in paired], bonferroni(len(paired)))
    headings = ("game", "strategy", "episodes", "score", "less the window's [95 %, all together]")
    headings += ("tokens an episode", "largest prompt", "prompts over the cap", "gave up")
    yield f"| {' | '.join(headings)} |"
    yield f"|{' --- |' * len(headings)}"
    for game in GAMES:
        for name, members, difference in [
            ("`window`, dropping", own[game], None),
            *((cell.player, rows, d) for (cell, rows), d in zip(cells, differences, strict=True) if cell.game == game),
        ]:
            mean, spent = mean_estimates([sample(members, score), sample(members, tokens)])
            peak = max(row["peak_prompt_tokens"] for row in members)
            shown = "reference" if difference is None else interval(difference, "+")
            over = "0" if difference is None else _share_over(members, folder)
            ended = sum(row["end_reason"] == "host" for row in members)
            facts = (len(members), f"{mean.mean:.2f}", shown, f"{spent.mean:,.0f}", f"{peak:,}", over, ended)
            yield f"| `{game}` | {name} | {' | '.join(map(str, facts))} |"


def _share_over(rows: Sequence[Row], folder: RunFolder) -> str:
    records = [sp.records.Record.read(folder.transcript(row["key"])) for row in rows]
    sent = [event for record in records for event in record.sent]
    return f"{100 * sum(event['over'] for event in sent) / len(sent):.0f} %"


def _arguments() -> argparse.Namespace:
    parser = arguments("Context strategies of other frameworks, on the same worlds.", "runs/hosts")
    parser.add_argument("--player", default="rule-notes", help="what answers in the place of the frameworks' model")
    parser.add_argument("--host", action="append", choices=[*HOSTS, *APART], help="one of the hosts alone; repeatable")
    parser.add_argument("--trials", type=int, default=10, help="episodes of every cell")
    return parser.parse_args()


if __name__ == "__main__":
    main()
