"""The states of the game at every step, which the page draws.

Most come from playing the recorded actions again on a new game, which has information that the text does not contain:
the true odds, the roles, the map. If record and game disagree there is no drawing, because a wrong picture would be
worse than none. Minecraft's path is read from the text, because its engines may need a server.

A drawing lists changes: a value that does not change is not repeated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

from smartplay_tools.arguments import read
from smartplay_tools.episode.config import EpisodeConfig, Setting
from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.report.walks import draw_walk
from smartplay_tools.games.registry import packages_are_imported
from smartplay_tools.games.specs import GAMES
from smartplay_tools.prompts import GAME_IS_OVER
from smartplay_tools.transcript.events import Event

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame

REPLAYED = (
    "Drawn from the game itself: the recorded actions were played again when this page was made, and every state "
    "hash in the record was met. The player saw the text only."
)


class _DisagreementError(Exception):
    """The game played again differs from the record."""


def draw(events: Sequence[Event]) -> dict[str, Any]:
    """Return the drawing of an episode: its `kind`, its `source`, and the state at every step.

    Without a drawing `kind` is None and `source` says why.
    """
    try:
        config = EpisodeConfig.from_event(events[0])
        if config.spec.family == "minecraft":
            return draw_walk(config.spec, events)
        if not packages_are_imported() and config.setting.kwargs != Setting.of(GAMES[config.game]).kwargs:
            # Numbers of a stranger could ask for a world of any size.
            return {"kind": None, "source": f"No drawing: {config.game} has other numbers here; --plugins draws it."}
        return _replay(config, events)
    except _DisagreementError as error:
        return {"kind": None, "source": f"No drawing: the game played differently when it was played again. {error}"}
    except (SmartPlayError, KeyError, TypeError, ValueError) as error:
        return {"kind": None, "source": f"No drawing: the game cannot be played again here. {error}"}


def _replay(config: EpisodeConfig, events: Sequence[Event]) -> dict[str, Any]:
    acts = [event for event in events if event["event"] == "call" and event["data"].get("legal") is True]
    with closing(config.make_game(config.spec)) as game:
        game.reset(seed=config.seed)
        states = [game.drawing()]
        if not states[0]:
            return {"kind": None, "source": "This game has no drawing of its own."}
        tools, actions = Tools(game), []
        for act in acts:
            actions.append(_play_again(game, tools, act))
            states.append(game.drawing())
        kind = "text" if states[0].keys() == {"text"} else config.spec.family
        return {
            "kind": kind,
            "source": REPLAYED,
            "changes": list(changes(states)),
            "names": game.actions,
            "actions": actions,
            "rewards": [act["data"]["reward"] for act in acts],
        }


def _play_again(game: TextGame, tools: Tools, act: Event) -> int:
    """Play a recorded action and return its index; `_DisagreementError` if anything else comes of it."""
    data = act["data"]
    step = data["step"]
    try:
        action = tools.parse(act["name"], read(act["arguments"])).action
        assert action is not None
        text, reward, _, _ = game.advance(action)
    except Exception as error:  # a record may say anything, and an engine may break: no drawing, with the reason
        raise _DisagreementError(f"Step {step} cannot be played ({type(error).__name__}).") from error
    if "state_hash" in data and data["state_hash"] != game.state_hash():
        raise _DisagreementError(f"Step {step} has a different state hash.")
    if data["reward"] != reward:
        raise _DisagreementError(f"Step {step} has a different reward.")
    # What was cut for the player says less than the hash.
    if not act["cut"] and act["text"] not in (text, f"{text}\n{GAME_IS_OVER}"):
        raise _DisagreementError(f"Step {step} has a different text.")
    return action


def changes(states: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the part of each state that differs from the previous one."""
    before: dict[str, Any] = {}
    for state in states:
        yield {name: value for name, value in state.items() if name not in before or before[name] != value}
        before = state
