"""The command `check`: three turns with each model of a run, before the run."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.show import compact_table, print_json
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.probe import Probe, probe
from smartplay_tools.terminal import Console, Text, say


def check(
    players: Annotated[str | None, typer.Option(help="Comma-separated names of players.")] = None,
    base_url: options.BaseUrls = None,
    player_option: options.PlayerOptions = None,
    as_json: options.Json = False,
) -> None:
    """Play three turns with every model of a run, and print whether it can be reached, plays and reports usage.

    The exit code is 1 if a model cannot play.

    Example: smartplay-tools check --players openai:gpt-5-mini
    """
    names = list(dict.fromkeys(options.names(players)))
    configs = runs.player_configs(names, base_url, player_option)
    answers = [(config, probe(config)) for config in configs]
    probes = [answer for _, answer in answers if answer is not None]
    if as_json:
        print_json([{**asdict(answer), "advice": answer.advice} for answer in probes])
    else:
        _print(answers)
    if not all(answer.playable for answer in probes):
        raise typer.Exit(1)


def _print(answers: list[tuple[PlayerConfig, Probe | None]]) -> None:
    console = Console()
    table = compact_table("player", "reached", "tools", "plays", "ids", "parallel", "usage", "reasoning", folded=1)
    for config, answer in answers:
        if answer is None:
            table.add_row(config.name, "no model", *[""] * 6)
            continue
        words = map(_word, (answer.reachable, answer.tools, answer.played, answer.ids, answer.parallel, answer.usage))
        table.add_row(answer.player, *words, "" if answer.reasoning is None else str(answer.reasoning))
    console.print(table)
    for _, answer in answers:
        for line in answer.advice if answer is not None else []:
            say(line)


def _word(answer: bool | None) -> str | Text:
    return "" if answer is None else "yes" if answer else Text("no", style="red")
