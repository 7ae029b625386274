"""The commands `games` and `manual`, which show the games."""

from __future__ import annotations

from typing import Any

from smartplay_tools.cli import options
from smartplay_tools.cli.show import compact_table, print_json
from smartplay_tools.games.specs import GAMES, get_spec
from smartplay_tools.streams import keep_streams, own_output
from smartplay_tools.terminal import Console


def games(as_json: options.Json = False) -> None:
    """List every setting that can be played.

    Example: smartplay-tools games
    """
    rows = [_facts(name) for name in GAMES]
    if as_json:
        rated = [{**row, "challenges": dict(GAMES[row["id"]].challenges)} for row in rows]
        print_json(rated)
        return
    table = compact_table(*rows[0])
    for row in rows:
        table.add_row(*("" if value is None else f"{value}" for value in row.values()))
    Console().print(table)


def manual(game: options.Game, seed: options.Seed = 0) -> None:
    """Print a game's manual, as the original prints it.

    Example: smartplay-tools manual Hanoi3Disk-v0
    """
    with keep_streams():
        environment = get_spec(game).make()
        environment.reset(seed=seed)
        print(environment.manual, file=own_output())


def _facts(name: str) -> dict[str, Any]:
    spec = GAMES[name]
    return {
        "id": spec.id,
        "actions": spec.count_actions(),
        "history": spec.history,
        "rollout": spec.rollout,
        "trials": spec.trials,
        "human": spec.human_score,
    }
