"""The check of a run's models: three turns of a real game with each, which show whether the model can play.

The model gets the tools of the game, and is asked to look and to read the manual in its first reply. The replies show
whether the server can be reached, supports tools, gives ids to calls, allows several calls in a reply and reports
usage, and whether its calls can be played. What keeps a model from playing has its own sentence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.runs.faults import fault_of
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.players import ModelPlayer, get_player, is_model
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
        return advice

    @property
    def playable(self) -> bool:
        """Whether the model can be reached, and a call of it could be played."""
        return self.reachable and bool(self.played)


def probe(config: PlayerConfig) -> Probe | None:
    """Play some turns with a model, without retries; None for a player that is not a model."""
    try:
        once = {"retries": 0} if is_model(config.name) else {}
        player = get_player(config.name, **{**config.options, **config.secret_values(), **once})
        if not isinstance(player, ModelPlayer):
            return None
        player.check_ready()
    except (SmartPlayError, ImportError) as error:
        return Probe(config.name, reachable=False, error=str(error))
    with player:
        return _played(config.name, player)


def _played(name: str, player: ModelPlayer) -> Probe:
    replies: list[Reply] = []
    faults: dict[str | None, None] = {}
    with Episode(GAME, seed=0, budget=Budget(reply_tokens=MOST_TOKENS)) as episode:
        conversation = Conversation(episode, head=ASKED)
        while len(replies) < TURNS and (prompt := conversation.prompt()) is not None:
            try:
                replies.append(player.reply(prompt))
            except SmartPlayError as error:
                return Probe(name, reachable=False, error=str(error))
            conversation.receive(replies[-1])
            faults[fault_of(replies[-1], conversation, MOST_TOKENS)] = None
        reasoned = sum(episode.counter.tokenizer.count(reasoning_of(reply.message)) for reply in replies)
    calls = [calls_of(reply.message) for reply in replies]
    ids = [call.get("id") for own in calls for call in own]
    usages = [reply.usage for reply in replies if reply.usage is not None and reply.usage.prompt > 0]
    counted = sum(usages, Usage(requests=0)).reasoning or reasoned
    return Probe(
        name,
        reachable=True,
        error=None if ids else next((text_of(reply.message)[:200] for reply in replies), None),
        tools=bool(ids),
        ids=all(ids) and all(len({c.get("id") for c in own}) == len(own) for own in calls) if ids else None,
        parallel=any(len(own) > 1 for own in calls) if ids else None,
        usage=bool(usages),
        reasoning=counted if usages or reasoned else None,
        played=None in faults,
        acted=episode.stats.steps > 0,
        faults=tuple(fault for fault in faults if fault is not None),
    )
