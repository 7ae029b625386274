"""The check of a run's models: three turns of a real game with each, which show whether the model can play.

The model gets the tools of the game, and is asked to look and to read the manual in its first reply. The replies show
whether the server can be reached, supports tools, gives ids to calls, allows several calls in a reply and reports
usage, and whether its calls can be played. What keeps a model from playing has its own sentence.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.runs.faults import fault_of
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.players import ModelPlayer, get_player, is_model
from smartplay_tools.providers.prices import Price, find_price
from smartplay_tools.types import Budget, Reply, Usage
from smartplay_tools.types.messages import Message, calls_of, reasoning_of, text_of

GAME = "BanditTwoArmedHighLowFixed-v0"

ASKED: Sequence[Message] = (
    {
        "role": "user",
        "content": "Begin with both `observe` and `read_manual`, in one reply. In each later reply, call `act` once.",
    },
)

TURNS = 3

MOST_TOKENS = 1000
"""Cap on a reply of a probe, large enough for a model that reasons and small enough to cost little."""


@dataclass(frozen=True)
class Probe:
    """What some turns with a model have shown; None if a fact is unknown."""

    player: str
    reachable: bool
    error: str | None = None
    tools: bool | None = None
    """Whether a reply calls a tool."""
    ids: bool | None = None
    """Whether the calls have ids, and different ones."""
    parallel: bool | None = None
    """Whether there are several calls in a reply."""
    usage: bool | None = None
    """Whether the provider reports its count of tokens."""
    reasoning: int | None = None
    """Tokens of reasoning, as the provider or, if it does not count them, as we count them."""
    price: str | None = None
    """The source of the price; None if it is not known."""
    cost: float | None = None
    """US dollars of this probe."""
    played: bool | None = None
    """Whether any call could be played."""
    acted: bool | None = None
    """Whether the game made a step."""
    faults: tuple[str, ...] = ()
    """What was wrong with the replies, a sentence with its remedy for each kind."""

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
        advice += [f"{self.player} {fault}" for fault in self.faults]
        if self.played and not self.acted:
            advice.append(f"{self.player} has played no action in {TURNS} turns; it only looks.")
        if not self.usage:
            advice.append(f"{self.player} does not report usage, so its cost is that of our count of tokens.")
        if self.price is None:
            advice.append(
                f"{self.player} has no known price: --price {self.player}=INPUT,OUTPUT (USD a million tokens)."
            )
        return advice

    @property
    def playable(self) -> bool:
        """Whether the model can be reached, and a call of it could be played."""
        return self.reachable and bool(self.played)


def probe(config: PlayerConfig, prices: Mapping[str, Price]) -> Probe | None:
    """Play some turns with a model, without retries; None for a player that is not a model."""
    try:
        once = {"retries": 0} if is_model(config.name) else {}
        player = get_player(config.name, **{**config.options, **config.secret_values(), **once})
        if not isinstance(player, ModelPlayer):
            return None
        player.check_ready()
    except (SmartPlayError, ImportError) as error:
        return Probe(config.name, reachable=False, error=str(error))
    price = prices.get(config.name) or find_price(config.name, config.options)
    with player:
        return _played(config, player, price)


def _played(config: PlayerConfig, player: ModelPlayer, price: Price | None) -> Probe:
    replies: list[Reply] = []
    faults: dict[str, None] = {}
    was_played = False
    with Episode(GAME, seed=0, budget=Budget(reply_tokens=MOST_TOKENS)) as episode:
        conversation = Conversation(episode, head=ASKED)
        for _ in range(TURNS):
            prompt = conversation.prompt()
            if prompt is None:
                break
            try:
                replies.append(player.reply(prompt))
            except SmartPlayError as error:
                paid = [*(reply.usage for reply in replies), getattr(error, "usage", None)]
                return Probe(config.name, reachable=False, error=str(error), cost=_cost(paid, price))
            conversation.receive(replies[-1])
            fault = fault_of(replies[-1], conversation, MOST_TOKENS)
            was_played = was_played or fault is None
            if fault is not None:
                faults[fault] = None
        acted = episode.stats.steps > 0
        reasoned = sum(episode.counter.tokenizer.count(reasoning_of(reply.message)) for reply in replies)
    judged = _judged(config.name, replies, reasoned, price)
    return replace(judged, played=was_played, acted=acted, faults=tuple(faults))


def _judged(name: str, replies: Sequence[Reply], reasoned: int, price: Price | None) -> Probe:
    calls = [calls_of(reply.message) for reply in replies]
    ids = [call.get("id") for own in calls for call in own]
    usages = [reply.usage for reply in replies if reply.usage is not None and reply.usage.prompt > 0]
    total = sum(usages, Usage(requests=0))
    first = next((text_of(reply.message)[:200] for reply in replies), None)
    return Probe(
        name,
        reachable=True,
        error=None if ids else first,
        tools=bool(ids),
        ids=all(ids) and all(len({c.get("id") for c in own}) == len(own) for own in calls) if ids else None,
        parallel=any(len(own) > 1 for own in calls) if ids else None,
        usage=bool(usages),
        reasoning=total.reasoning or reasoned if usages or reasoned else None,
        price=None if price is None else price.source,
        cost=_cost([reply.usage for reply in replies], price),
    )


def _cost(usages: Iterable[Usage | None], price: Price | None) -> float | None:
    """The cost of all attempts, failed ones included; None if it is not known."""
    counted = [usage for usage in usages if usage is not None and usage.has_tokens]
    return price.cost(sum(counted, Usage(requests=0))) if price is not None and counted else None
