"""The Messenger rule player: what it reads, what it infers, and how well it plays at the paper's budgets."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.games.messenger.manuals import OUR_TEXTS, load
from smartplay_tools.games.messenger.statistics import entries
from smartplay_tools.games.messenger.text import compose
from smartplay_tools.players.rules import messenger, messenger_manual
from smartplay_tools.players.rules.messenger_manual import Claim, claims


def completed(level: int, episodes: int) -> float:
    won = 0
    for seed in range(episodes):
        with sp.Episode(f"MessengerL{level}-v0", seed=seed) as episode:
            won += sp.play(episode, sp.get_player("rule")).completed
    return won / episodes


def test_it_reads_the_manual_of_the_paper() -> None:
    """The example that the paper prints, with people's sentences."""
    manual = compose(
        [
            "the dangerous enemy can be found next to the plane, which can not be moved.",
            "you are being approached by a restricted document that is a robot.",
            "the whale is the main objective.",
        ]
    )
    assert claims(manual) == (
        Claim("airplane", "enemy", "immovable"),
        Claim("robot", "message", "chaser"),
        Claim("fish", "goal", None),
    )


def test_it_reads_sentences_that_it_has_never_seen() -> None:
    """Its word lists were made from train sentences; these are the test split's."""
    read = [(claims(compose([entry.text]))[0], entry) for entry in entries(load(OUR_TEXTS, "test"))]
    assert sum(claim.entity == entry.entity for claim, entry in read) / len(read) >= 0.98
    assert sum(claim.role == entry.role for claim, entry in read) / len(read) >= 0.99
    assert sum((claim.movement or "unknown") == entry.kind for claim, entry in read) / len(read) >= 0.97


def test_three_sentences_are_about_three_roles() -> None:
    manual = compose(["the jet is the enemy.", "the orb is the target.", "the dog is what you see."])
    assert [claim.role for claim in claims(manual)] == ["enemy", "goal", "message"]


@pytest.mark.parametrize(
    ("observations", "movement"),
    [
        (["dog 6 steps to your north", "dog 5 steps to your north", "dog 5 steps to your north"], "chaser"),
        (["dog 6 steps to your north", "dog 6 steps to your north", "dog 6 steps to your north"], "immovable"),
        (["dog 5 steps to your north", "dog 5 steps to your north", "dog 6 steps to your north"], "fleeing"),
    ],
)
def test_it_tells_movements_apart_by_what_it_sees(observations: list[str], movement: str) -> None:
    lines = "You took action Do Nothing.\n\nYou (agent) don't have the message.\n\nYou see:\n- {}"
    views = tuple(messenger.View.of(lines.format(line)) for line in observations)
    said = (Claim("dog", "enemy", "chaser"), Claim("dog", "message", "immovable"), Claim("dog", "goal", "fleeing"))
    believed = dict.fromkeys(messenger.MOVEMENTS, 0.0)
    for weight, _, things in messenger._situations(said, views):
        for (moves, *_), probability in things[0].belief.items():
            believed[moves] += weight * probability
    assert max(believed, key=believed.__getitem__) == movement


def test_its_modules_import_no_table_of_the_games() -> None:
    for module in (messenger, messenger_manual):
        assert module.__file__
        tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
        imported = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        assert not [name for name in imported if name.startswith("smartplay_tools.games")]


def test_level_1_is_won() -> None:
    assert completed(1, 60) >= 0.95


def test_level_2_is_mostly_won() -> None:
    assert completed(2, 12) >= 0.8


@pytest.mark.slow
@pytest.mark.parametrize(("level", "episodes", "at_least"), [(1, 200, 0.95), (2, 60, 0.8), (3, 60, 0.25)])
def test_it_plays_as_well_as_promised(level: int, episodes: int, at_least: float) -> None:
    assert completed(level, episodes) >= at_least
