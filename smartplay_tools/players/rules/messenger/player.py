"""Rules for MESSENGER: read the roles, infer the places of everything from the visible steps, and simulate each action.

Each step of a decision is a module: `sight` parses observations, `manual` parses sentences, `casts` computes their
possible meanings, `belief` the possible places, and `foresight` the value of each action; `board` has the tables of the
geometry for the last two.

All knowledge about the episode comes from the visible messages, which are the manual and at most four observations, so
the player infers its own place again at every step. What a narrow window does not show of these four observations,
`remember` keeps in a memory. The player also has knowledge that can be gained from playing the training
split: how things move and touch, that borders stop them, and the regularities of the games (in `casts` and `belief`).
It does not use the starting places of games.
"""

from __future__ import annotations

from collections.abc import Sequence

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules.memory import fits, line, recall
from smartplay_tools.players.rules.messenger.belief import believe
from smartplay_tools.players.rules.messenger.board import ACTIONS
from smartplay_tools.players.rules.messenger.casts import FEW_SENTENCES, Cast, Part, casts
from smartplay_tools.players.rules.messenger.foresight import persistence, worths
from smartplay_tools.players.rules.messenger.manual import Claim, claims
from smartplay_tools.players.rules.messenger.sight import SeenEntities
from smartplay_tools.types.messages import Message

VIEWS = 4
"""The most observations that are used: each further one doubles the cost of a decision."""


def plays(reading: Reading) -> bool:
    """Whether the actions are steps to the four sides, or none."""
    return set(reading.actions) == set(ACTIONS)


def decide(reading: Reading) -> Message:
    """Read the manual, observe, then take the action with the highest value."""
    return _decide(reading, tuple(map(SeenEntities.of, reading.observations))[-VIEWS:])


def remember(reading: Reading, cap: int | None) -> tuple[Message, str]:
    """Decide by the newest observations that are remembered or visible, and return the memory that holds them."""
    memory = recall(reading)
    facts = memory.facts or {"clock": 0}
    kept = (
        SeenEntities(
            action, has_message, {name: (distance, direction) for name, (distance, direction) in things.items()}
        )
        for action, has_message, things in facts.get("views", ())
    )
    since = tuple(map(SeenEntities.of, memory.since.observations))
    views = (*kept, *since)[-VIEWS:]
    return _decide(reading, views), _memory(facts["clock"] + len(since), views, cap)


def _decide(reading: Reading, views: Sequence[SeenEntities]) -> Message:
    if "MESSENGER" not in reading.system and reading.is_start:
        return call("read_manual")
    if not views or not views[-1].things:
        return call("observe")
    return call("act", action=choose(claims(reading.system), views))


def _memory(clock: int, views: Sequence[SeenEntities], cap: int | None) -> str:
    """The line that holds these observations; under a cap in tokens, as many of the newest as fit."""
    kept = [[view.action, view.has_message, view.things] for view in views]
    lines = [line({"clock": clock, "views": kept[oldest:]}) for oldest in range(len(kept) + 1)]
    return lines[0] if cap is None else next((each for each in lines if fits(each, cap)), lines[-1])


def choose(manual_claims: tuple[Claim, ...], views: Sequence[SeenEntities]) -> str:
    """Return the best action. If the views fit no case, the oldest are dropped until they do."""
    now = views[-1]
    possible = _casts(manual_claims, views)
    for oldest in range(len(views)):
        cases = believe(possible, views[oldest:])
        if cases is not None:
            worth = worths(cases, has_message=now.has_message)
            worth += persistence(cases, now.action, has_message=now.has_message)
            return ACTIONS[int(worth.argmax())]
    return "Do Nothing"


def _casts(manual_claims: tuple[Claim, ...], views: Sequence[SeenEntities]) -> tuple[tuple[float, Cast], ...]:
    possible = casts(manual_claims, _names(manual_claims, views))
    if views[-1].has_message and len(manual_claims) <= FEW_SENTENCES and len(views[-1].things) == len(manual_claims):
        # Level 1 may start with the message in hand; the message on the board must then not be touched.
        return tuple((weight, {name: _unwanted(parts) for name, parts in cast.items()}) for weight, cast in possible)
    return possible


def _unwanted(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    return tuple(part._replace(role="enemy") if part.role == "message" else part for part in parts)


def _names(manual_claims: Sequence[Claim], views: Sequence[SeenEntities]) -> tuple[str, str, str]:
    """Return the three names of the game: those in view, then those with the most sentences, then placeholders."""
    in_view = [name for view in reversed(views) for name in view.things]
    spoken_of = [claim.entity for claim in manual_claims if claim.entity]
    named = dict.fromkeys([*in_view, *sorted(spoken_of, key=spoken_of.count, reverse=True), "?", "another?", "third?"])
    first, second, third, *_ = named
    return first, second, third
