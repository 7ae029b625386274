"""A model plays many games at once, all through one client; each has its own budget, seed and result.

    python examples/05_openai_many_games_at_once.py

Without MODEL it talks to a local endpoint in which the rule player answers. For a model, set MODEL, OPENAI_API_KEY and,
if it is not OpenAI's, OPENAI_BASE_URL.
"""

import asyncio
import os
from contextlib import ExitStack

import smartplay_gateway

import smartplay_tools as sp

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0")


async def play(game: str, seed: int, player: sp.AsyncPlayer) -> sp.EpisodeResult:
    with sp.Episode(game, seed=seed, budget=sp.Budget(prompt_tokens=1000, reply_tokens=500)) as episode:
        return await sp.aplay(episode, player)


async def play_all(model: str, base_url: str | None) -> list[sp.EpisodeResult]:
    async with sp.get_player(f"openai:{model}", base_url=base_url) as player:
        return await asyncio.gather(*(play(game, seed, player) for game in GAMES for seed in range(3)))


with ExitStack() as stack:
    model, base_url = os.environ.get("MODEL", ""), None
    if not os.environ.get("MODEL"):
        model = "rule"
        base_url = stack.enter_context(smartplay_gateway.LocalEndpoint(sp.get_player("rule"))).base_url
    results = asyncio.run(play_all(model, base_url))

for result in results:
    requests = result.tokens.provider.requests if result.tokens.provider else 0
    print(f"{result.game:30} seed {result.seed}: {result.score:4g} in {requests} requests ({result.end_reason})")
