"""The players: the registry of their names, and that they use only what they are shown."""

from __future__ import annotations

import ast
import dataclasses
from functools import cache
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import UnknownNameError
from smartplay_tools.players import player_names, rules
from smartplay_tools.players.rules import hanoi

SMALL_GAMES = [name for name, spec in sp.GAMES.items() if spec.family in ("bandit", "rock_paper_scissors", "hanoi")]

OF_EACH = {sp.GAMES[name].family: name for name in reversed([*sp.GAMES]) if name in sp.GAMES.benchmark}.values()
"""The first setting of each game of the benchmark."""


@cache
def mean_score(game: str, player: str, episodes: int = 8, **budget: object) -> float:
    scores = []
    for seed in range(episodes):
        with sp.Episode(game, seed=seed, budget=sp.Budget(**budget)) as episode:
            scores.append(sp.play(episode, sp.get_player(player, seed=seed)).score)
    return sum(scores) / episodes


def test_players_are_found_by_name():
    assert {"random", "rule"} <= set(player_names())
    assert sp.get_player("rule").name == "rule"
    with pytest.raises(UnknownNameError, match="did you mean rule"):
        sp.get_player("rules")


@pytest.mark.parametrize(
    ("game", "least"),
    [
        pytest.param("BanditTwoArmedDeterministicFixed-v0", 48, marks=pytest.mark.slow),
        ("BanditTwoArmedHighLowFixed-v0", 44),
        ("RockPaperScissorBasic-v0", 36),
        ("Hanoi3Disk-v0", 3),
        ("Hanoi4Disk-v0", 4),
    ],
)
def test_the_rule_player_plays_well(game, least):
    assert mean_score(game, "rule") >= least


def test_what_it_knows_is_what_it_sees():
    """A window of one step is not enough to learn the odds, so the score falls towards chance."""
    game = "BanditTwoArmedHighLowFixed-v0"
    assert mean_score(game, "rule", history=0) < 35 < 42 < mean_score(game, "rule")


def test_the_random_player_is_seeded_and_uniform():
    assert mean_score("BanditTwoArmedHighLowFixed-v0", "random") == pytest.approx(25, abs=3)
    assert mean_score("RockPaperScissorBasic-v0", "random") == pytest.approx(50 / 3, abs=3)


class Blanking:
    """Gives a player every prompt twice, once without the text of its own replies, and requires the same reply."""

    name = "blanking"

    def __init__(self, player: sp.Player) -> None:
        self._player = player

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        blank = [{**m, "content": None} if m["role"] == "assistant" else m for m in prompt.messages]
        reply = self._player.reply(prompt)
        assert reply == self._player.reply(sp.Prompt(blank, prompt.tools, prompt.max_tokens))
        return reply


@pytest.mark.parametrize("game", OF_EACH)
def test_the_rule_player_keeps_no_state_in_its_replies(game):
    spec = sp.GAMES[game]
    spec = dataclasses.replace(spec, rollout=min(spec.rollout, 60))
    with sp.Episode(spec, seed=4, budget=sp.Budget(prompt_tokens=4_000)) as episode:
        result = sp.play(episode, Blanking(sp.get_player("rule")))
    assert result.end_reason in ("terminated", "rollout"), result.error


@pytest.mark.parametrize("path", sorted(Path(rules.__file__).parent.rglob("*.py")), ids=lambda path: path.stem)
def test_a_rule_player_imports_no_table_of_the_games(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    ours = {module for module in modules if module and module.startswith("smartplay_tools")}
    plain_data = ("players", "types")
    assert all(module.split(".")[1] in plain_data for module in ours), ours
    plain = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    assert not any(name.startswith("smartplay_tools") for name in plain)


def test_hanoi_is_solved_from_everywhere_the_shortest_way():
    """A whole tower takes 2^n - 1 moves, and any configuration at most that many."""
    for disks in (3, 4):
        for code in range(3**disks):
            rods = {disk: "ABC"[code // 3**disk % 3] for disk in range(disks)}
            moves = 0
            while set(rods.values()) != {"C"}:
                source, target = hanoi.next_move(rods)
                top = min(disk for disk, rod in rods.items() if rod == source)
                assert all(rod != target for disk, rod in rods.items() if disk < top)
                rods[top] = target
                moves += 1
            assert moves <= 2**disks - 1
