"""The check of a run's models: one cheap call to each, which shows whether the model can play.

The model is given the tools of a real game and asked to call two of them in one reply. The reply shows whether the
server can be reached, supports tools, gives ids to calls, allows several calls in a reply, and reports usage.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.games.specs import get_spec
from smartplay_tools.messages import Message, calls_of, text_of
from smartplay_tools.players import ModelPlayer, get_player, is_model
from smartplay_tools.records.prices import Price, find_price
from smartplay_tools.types import Prompt, Reply

GAME = "BanditTwoArmedHighLowFixed-v0"

ASKED: list[Message] = [
    {"role": "system", "content": "You play a game through tools."},
    {"role": "user", "content": "Call both `observe` and `read_manual` now, in one reply."},
]

MOST_TOKENS = 1000
"""Cap on the reply to a probe, large enough for a model that reasons and small enough to cost little."""


@dataclass(frozen=True)
class Probe:
    """The findings of a call to a model; None if a fact is unknown."""

    player: str
    reachable: bool
    error: str | None = None
    tools: bool | None = None
    """Whether the reply calls a tool."""
    ids: bool | None = None
    """Whether the calls have ids, and different ones."""
    parallel: bool | None = None
    """Whether there are several calls in the reply."""
    usage: bool | None = None
    """Whether the provider reports its count of tokens."""
    reasoning: int | None = None
    """Tokens of reasoning that it has counted."""
    price: str | None = None
    """The source of the price; None if it is not known."""
    cost: float | None = None
    """US dollars of this probe."""

    @property
    def advice(self) -> list[str]:
        """A sentence with a remedy for each problem."""
        advice = []
        if not self.reachable:
            advice.append(f"{self.player}: {self.error}")
            if "stream" in (self.error or "").lower():
                advice.append(
                    f"{self.player} seems to support only streams: --player-option {self.player}.stream=true."
                )
            return advice
        if not self.tools:
            advice.append(
                f"{self.player} has called no tool: start a vLLM server with --enable-auto-tool-choice and "
                "--tool-call-parser; a model without tools can play with --protocol paper."
            )
        if not self.usage:
            advice.append(f"{self.player} does not report usage, so its cost is not known; only budget tokens are.")
        if self.price is None:
            advice.append(
                f"{self.player} has no known price: --price {self.player}=INPUT,OUTPUT (USD a million tokens)."
            )
        return advice

    @property
    def playable(self) -> bool:
        """Whether it can be reached and calls tools."""
        return self.reachable and bool(self.tools)


def probe(config: PlayerConfig, prices: Mapping[str, Price]) -> Probe | None:
    """Ask a model once, without retries; None for a player that is not a model."""
    try:
        player = get_player(config.name, **_once(config.name, {**config.options, **config.secret_values()}))
        if not isinstance(player, ModelPlayer):
            return None
        player.check_ready()
        with player:
            reply = player.reply(_prompt())
    except (SmartPlayError, ImportError) as error:
        return Probe(config.name, reachable=False, error=str(error))
    price = prices.get(config.name) or find_price(config.name, config.options)
    return _judged(config.name, reply, price)


def _once(name: str, options: dict[str, Any]) -> dict[str, Any]:
    return {**options, "retries": 0} if is_model(name) else options


def _prompt() -> Prompt:
    with closing(get_spec(GAME).make()) as game:
        return Prompt([message.copy() for message in ASKED], Tools(game).specs, MOST_TOKENS)


def _judged(name: str, reply: Reply, price: Price | None) -> Probe:
    calls, usage = calls_of(reply.message), reply.usage
    ids = [call.get("id") for call in calls]
    reported = usage is not None and usage.prompt > 0
    return Probe(
        name,
        reachable=True,
        error=None if calls else text_of(reply.message)[:200],
        tools=bool(calls),
        ids=all(ids) and len(set(ids)) == len(ids) if calls else None,
        parallel=len(calls) > 1 if calls else None,
        usage=reported,
        reasoning=usage.reasoning if usage is not None and reported else None,
        price=None if price is None else price.source,
        cost=price.cost(usage) if price is not None and usage is not None and reported else None,
    )
