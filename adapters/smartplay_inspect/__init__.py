"""Inspect AI: the games as Inspect tasks, played by any of Inspect's models in the exact context window.

    inspect eval smartplay_inspect/smartplay --model openai/gpt-4o-mini -T game=Hanoi3Disk-v0 -T prompt_tokens=700

`smartplay` and `paper` are the tasks, `smartplay_agent` and `smartplay_scorer` their solver and scorer, and
`smartplay/NAME` is a player of this package as a model (`--model smartplay/rule`). `save_records` takes the records of
the episodes out of a log, so that they can be replayed. `window/PROVIDER/MODEL` is a model that is sent what a context
manager shows of the messages, for agents that play nothing.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_inspect", "inspect"):
    import inspect_ai as _inspect_ai  # noqa: F401

from smartplay_inspect.fitting import WindowModel, fitted_model
from smartplay_inspect.messages import from_output, read_usage
from smartplay_inspect.models import PlayerModel
from smartplay_inspect.scorer import by_game, interval, save_records, smartplay_scorer
from smartplay_inspect.solver import Played, smartplay_agent
from smartplay_inspect.tasks import paper, smartplay

__all__ = [
    "Played",
    "PlayerModel",
    "WindowModel",
    "by_game",
    "fitted_model",
    "from_output",
    "interval",
    "paper",
    "read_usage",
    "save_records",
    "smartplay",
    "smartplay_agent",
    "smartplay_scorer",
]
