"""The command `serve window`: a game's own context window behind the interfaces of models, for any agent."""

from __future__ import annotations

import importlib
import json
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.episode_options import OF_RUNS, EpisodeOptions, with_episode_options
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.terminal import say

if TYPE_CHECKING:
    from smartplay_tools.episode.episode import Episode
    from smartplay_tools.evaluation.runs.agents import Held
    from smartplay_tools.evaluation.runs.plan import Plan
    from smartplay_tools.evaluation.runs.players import PlayerConfig
    from smartplay_tools.evaluation.runs.run_options import RunProgress

GATEWAY = "smartplay_gateway"
"""The adapter that serves windows and budgets; imported at first use."""


OnlyGameTools = Annotated[bool, typer.Option("--only-game-tools", help="Hide the agent's other tools from the model.")]
ShowSystem = Annotated[
    bool, typer.Option("--show-system", help="Show the model the agent's instructions, and count them.")
]


Upstream = Annotated[
    str | None,
    typer.Option(help="Without a game: the base URL of a model's server, whose prompts are held to the budget."),
]
TokensOfParts = Annotated[int | None, typer.Option(help="With --upstream: the tokens of each picture.")]
ExtraTokens = Annotated[
    int | None, typer.Option(help="With --upstream: the tokens of each part or tool that only the provider can count.")
]
Records = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", help="With --upstream: record every prompt, word for word, a file for each thread."),
]


@with_episode_options(without=("protocol", *OF_RUNS))
def window(
    game: Annotated[
        str | None, typer.Argument(help="The id of a game; none with --upstream.", show_default=False)
    ] = None,
    player: Annotated[str, typer.Option(help="Who plays: openai:MODEL, anthropic:MODEL, rule, ...")] = "rule",
    base_url: options.BaseUrl = None,
    seed: Annotated[int, typer.Option(help="Seed of the first episode or, with --out, of the run.", min=0)] = 0,
    episodes: Annotated[int, typer.Option(help="Open N episodes, with consecutive seeds.", min=0)] = 1,
    host: options.Host = "127.0.0.1",
    port: options.Port = 8000,
    allow_host: options.AllowHost = None,
    allow_origin: options.AllowOrigin = None,
    token: Annotated[
        str | None, typer.Option(help="The API key that agents send.", envvar="SMARTPLAY_WINDOW_TOKEN")
    ] = None,
    closing: Annotated[
        str, typer.Option(help="The tool with which an agent's framework closes a run.")
    ] = "final_answer",
    only_game_tools: OnlyGameTools = False,
    show_system: ShowSystem = False,
    most: Annotated[int, typer.Option(help="How many episodes may be open.", min=1)] = 1000,
    idle: Annotated[
        float, typer.Option(help="Without --out: close a begun episode after N seconds without a request.")
    ] = 1800.0,
    upstream: Upstream = None,
    picture_tokens: TokensOfParts = None,
    extra_tokens: ExtraTokens = None,
    record: Records = None,
    out: Annotated[
        Path | None,
        typer.Option(help="The folder of a run: its seeds are those of `eval`, and the same command continues it."),
    ] = None,
    *,
    episode: EpisodeOptions,
) -> None:
    """Serve a game's window as a model: an agent that uses it plays under the exact budget.

    The model of --player sees the window and nothing else. An agent's base_url is the address that is printed, its
    model smartplay/HANDLE, its tools those of the MCP address; Anthropic's clients take the address without /v1. Each
    episode that ends is printed with its score.

    With --upstream there is no game: any client of chat completions, Responses or Messages whose base URL is the
    printed address is held to the budget, and everything else passes to the upstream as it is.

    Example: smartplay-tools serve window Hanoi3Disk-v0 --player openai:gpt-4o-mini --prompt-tokens 2000

    Example: smartplay-tools serve window --upstream https://api.openai.com/v1 --prompt-tokens 8000
    """
    if upstream is not None:
        if game is not None:
            raise InvalidArgumentError(f"--upstream serves an agent of yours, without a game; leave out {game}.")
        more = {"picture_tokens": picture_tokens, "extra_tokens": extra_tokens, "record": record}
        _serve_upstream(upstream, episode, host=host, port=port, hosts=allow_host or (), more=more)
        return
    if game is None:
        raise InvalidArgumentError(
            "Name a game, or with --upstream the server of a model; `smartplay-tools games` lists games."
        )
    shown: dict[str, Any] = {"only_game_tools": only_game_tools, "show_system": show_system}
    endpoint = open_endpoint(
        *(player, base_url, seed),
        host=host,
        port=port,
        token=token,
        closing=closing,
        **shown,
        most=most,
        idle=idle if out is None else math.inf,  # the episodes of a run wait for their agents
        hosts=allow_host or (),
        origins=allow_origin or (),
    )
    say(f"base_url {endpoint.base_url}  ANTHROPIC_BASE_URL {endpoint.url}  ({player} plays; stop with Ctrl-C)")
    if out is not None:
        from smartplay_tools.evaluation.runs.players import PlayerConfig

        offered = _Offered(endpoint, out)
        config = PlayerConfig(name=player, agent=offered, options={**server(base_url), **chosen(shown)})
        _serve_run(endpoint, plan_of(game, config, episodes, seed, episode), config, offered, out)
        return
    _serve_episodes(endpoint, game, range(seed, seed + episodes), episode)


def _serve_upstream(
    upstream: str, episode: EpisodeOptions, *, host: str, port: int, hosts: Sequence[str], more: Mapping[str, Any]
) -> None:
    """Hold every client to the budget until Ctrl-C; print every prompt that did not fit as a whole."""
    from urllib.parse import urlsplit

    from smartplay_tools.manager import ContextManager, FittedPrompt

    def tell(path: str, prompt: FittedPrompt) -> None:
        left = {"dropped": prompt.dropped, "masked": prompt.masked, "cut": prompt.cut, "repaired": prompt.repaired}
        words = ", ".join(f"{len(numbers)} {what}" for what, numbers in left.items() if numbers)
        if words:
            say(f"{path}  {prompt.tokens:,} tokens; messages: {words}")

    tokenizer = episode.conditions.get("tokenizer")
    manager = ContextManager.of(episode.budget, tokenizer=tokenizer, **more)
    served = importlib.import_module(GATEWAY).ContextEndpoint
    endpoint = served(upstream, manager, host=host, port=port, hosts=hosts, told=tell)
    shown = urlsplit(upstream)._replace(query="", netloc=urlsplit(upstream).netloc.rpartition("@")[2]).geturl()
    say(f"base_url {endpoint.base_url}  ANTHROPIC_BASE_URL {endpoint.url}  (to {shown}; stop with Ctrl-C)")
    with suppress(KeyboardInterrupt):
        endpoint.run()


def open_endpoint(player: str, base_url: str | None, seed: int, **where: Any) -> Any:
    """Return the endpoint of a player; `where` are its other arguments."""
    from smartplay_tools.players import get_player

    options = server(base_url)
    first = get_player(player, seed=seed, **options)
    one_for_all = getattr(first, "serves_many", False)
    players: Any = first if one_for_all else lambda of_seed: get_player(player, seed=of_seed, **options)
    return importlib.import_module(GATEWAY).WindowEndpoint(players, **where)


def server(base_url: str | None) -> dict[str, Any]:
    """Return the player option that names its server."""
    return {} if base_url is None else {"base_url": base_url}


def chosen(options: Mapping[str, bool]) -> dict[str, Any]:
    """Return the options that are on; as options of the run's player, they make it another run."""
    return {name: True for name, is_on in options.items() if is_on}


def plan_of(game: str, player: PlayerConfig, episodes: int, seed: int, episode: EpisodeOptions) -> Plan:
    """Return the plan of a run of one cell."""
    from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes

    cells = make_cells([game], [player], [episode.budget], **episode.of_cells)
    return plan_episodes(cells, trials=episodes, seed=seed)


def ended(name: str, result: Mapping[str, Any]) -> str:
    """Return the line of an episode that is over, from its result."""
    tokens = result["tokens"]
    return (
        f"{name}  score {result['score']:g}  {result['end_reason']}  {result['steps']} steps  "
        f"{tokens['prompt']:,} prompt and {tokens['reply']:,} reply tokens"
    )


def _where(endpoint: Any, handle: str, seed: int) -> str:
    return f"model {endpoint.model(handle)}  MCP {endpoint.mcp_url(handle)}  seed {seed}"


def _serve_episodes(endpoint: Any, game: str, seeds: range, episode: EpisodeOptions) -> None:
    """Offer an episode for each seed, until Ctrl-C; print every one that ends."""
    from smartplay_tools.episode.episode import add_listener

    handles: dict[int, str] = {}
    scores: list[float] = []

    def tell(opened: Episode, event: Mapping[str, Any]) -> None:
        if "result" in event:
            scores.append(event["result"]["score"])
            say(ended(handles[opened.config.seed], event["result"]))

    with ExitStack() as opening:
        opening.callback(add_listener(lambda opened: partial(tell, opened)))
        for seed in seeds:
            handles[seed] = endpoint.open(game, seed=seed, **episode.conditions, **episode.options)
            say(_where(endpoint, handles[seed], seed))
    with suppress(KeyboardInterrupt):
        endpoint.run()
    mean = f", mean score {sum(scores) / len(scores):.4g}" if scores else ""
    say(f"{len(scores)} of {len(seeds)} episodes are over{mean}.")


def _serve_run(endpoint: Any, plan: Plan, player: PlayerConfig, offered: _Offered, out: Path) -> None:
    from smartplay_tools.cli.evaluate import print_run
    from smartplay_tools.evaluation.runs.run_options import RunOptions
    from smartplay_tools.evaluation.runs.runner import run_plan

    with endpoint:
        how = RunOptions(workers=len(plan.episodes), on_progress=offered.tell)
        run = run_plan(plan, out, [player], how)
        print_run(run, as_json=False)
        if run.stopped is not None:
            return
        say("All episodes are over; agents that still ask are told so until you press Ctrl-C.")
        with suppress(KeyboardInterrupt):
            while True:
                time.sleep(1)


class _Offered:
    """Offers each episode of a run under a handle, which it keeps in `handles.json`, and waits for its end."""

    goes_on = True

    def __init__(self, endpoint: Any, out: Path) -> None:
        self._endpoint, self._file = endpoint, out / "handles.json"
        self._handles: dict[str, str] = json.loads(self._file.read_text()) if self._file.exists() else {}
        """By the key of the episode."""

    async def play(self, held: Held) -> None:
        """Wait until somebody else has played."""
        handle = self._endpoint.serve(held.episode, handle=self._handles.get(held.key), session=held.session)
        self._handles[held.key] = handle
        self._file.touch(mode=0o600)  # the handles let anybody who reads them play
        self._file.write_text(json.dumps(self._handles, indent=1) + "\n", encoding="ascii", newline="\n")
        say(_where(self._endpoint, handle, held.episode.config.seed))
        await held.wait()

    def tell(self, progress: RunProgress) -> None:
        """Print the end of an episode."""
        if progress.episode is not None:
            handle = self._handles.get(progress.episode.key, progress.episode.key)
            say(f"{handle}  {progress.error}" if progress.row is None else ended(handle, progress.row))
