"""The states of the game at every step, which the page draws.

Most come from playing the recorded actions again on a new game, which has information that the text does not contain:
the true odds, the roles, the map. If record and game disagree there is no drawing, because a wrong picture would be
worse than none. Minecraft's path is read from the text, because its engines may need a server.

A drawing lists changes: a value that does not change is not repeated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from smartplay_tools.arguments import read
from smartplay_tools.episode.config import EpisodeConfig, Setting
from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.report.walks import draw_walk
from smartplay_tools.games.registry import packages_are_imported
from smartplay_tools.games.specs import GAMES
from smartplay_tools.replays.driver import Driver
from smartplay_tools.transcript.events import Event

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
    states: list[dict[str, Any]] = []
    driver = Driver([events[0], *acts], on_step=lambda game: states.append(game.drawing()))
    with driver.episode as episode:
        states.append(episode.game.drawing())
        if not states[0]:
            return {"kind": None, "source": "This game has no drawing of its own."}
        driver.run(with_end=False)
        tools = Tools(episode.game)
        names = episode.game.actions
    _compare(acts, [event for event in driver.record.events if event["event"] == "call"])
    kind = "text" if states[0].keys() == {"text"} else config.spec.family
    actions = [tools.parse(event["name"], read(event["arguments"])).action for event in acts]
    rewards = [event["data"]["reward"] for event in acts]
    return {
        "kind": kind,
        "source": REPLAYED,
        "changes": list(changes(states)),
        "names": names,
        "actions": actions,
        "rewards": rewards,
    }


def _compare(acts: Sequence[Event], again: Sequence[Event]) -> None:
    if len(acts) != len(again):
        raise _DisagreementError(f"It ended after {len(again)} of {len(acts)} steps.")
    for was, now in zip(acts, again, strict=True):
        step, recorded = was["data"]["step"], was["data"].get("state_hash")
        if recorded != now["data"].get("state_hash"):
            raise _DisagreementError(f"Step {step} has a different state hash.")
        if was["text"] != now["text"]:
            raise _DisagreementError(f"Step {step} has a different text.")


def changes(states: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the part of each state that differs from the previous one."""
    before: dict[str, Any] = {}
    for state in states:
        yield {name: value for name, value in state.items() if name not in before or before[name] != value}
        before = state
