"""How the MESSENGER rule player reads the sentences of the train split and of the test split."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.games.messenger.manuals import OUR_TEXTS, load
from smartplay_tools.games.messenger.rules import MOVEMENTS, Split
from smartplay_tools.games.messenger.text import compose
from smartplay_tools.players.rules.messenger.board import CHASER, FLEEING, IMMOVABLE, SeenEntities
from smartplay_tools.players.rules.messenger.casts import Cast, Part, casts
from smartplay_tools.players.rules.messenger.manual import Claim, claims
from tests.messenger_sentences import Entry, entries


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


def test_three_sentences_are_about_three_roles() -> None:
    manual = compose(["the jet is the enemy.", "the orb is the target.", "the dog is what you see."])
    assert [claim.role for claim in claims(manual)] == ["enemy", "goal", "message"]


@pytest.mark.parametrize("split", [pytest.param("train", marks=pytest.mark.slow), "test"])
def test_it_reads_each_sentence(split: Split) -> None:
    """Entity, role and movement of single sentences of both splits."""
    read = [(claims(compose([entry.text]))[0], entry) for entry in entries(load(OUR_TEXTS, split))]
    assert sum(claim.entity == entry.entity for claim, entry in read) / len(read) >= 0.995
    assert sum(claim.role == entry.role for claim, entry in read) / len(read) >= 0.998
    assert sum((claim.movement or "unknown") == entry.kind for claim, entry in read) / len(read) >= 0.98


# The meaning of all sentences together.


DECOYS = (
    Claim("mage", "enemy", "immovable"),
    Claim("mage", "goal", "chaser"),
    Claim("dog", "enemy", "immovable"),
    Claim("dog", "message", "chaser"),
    Claim("fish", "enemy", "chaser"),
    Claim("fish", "goal", "fleeing"),
)
"""The mage is said to be the goal as well, but would then move as the message does."""


def test_decoys_and_a_false_lead_are_seen_through() -> None:
    (probability, cast), *_ = casts(DECOYS, ("dog", "fish", "mage"))
    assert probability > 0.9
    assert cast == {
        "mage": (Part("enemy", IMMOVABLE),),
        "dog": (Part("message", CHASER), Part("enemy", IMMOVABLE)),
        "fish": (Part("goal", FLEEING), Part("enemy", CHASER)),
    }


@pytest.mark.parametrize("split", [pytest.param("train", marks=pytest.mark.slow), "test"])
def test_the_likeliest_cast_is_mostly_the_true_one(split: Split) -> None:
    """The manuals of level 3, read and weighed before anything is seen. Now and then two casts are equally likely."""
    game = sp.GAMES["MessengerL3-v0"].make(split=split)
    truth = {entry.text: entry for entry in entries(load(OUR_TEXTS, split))}
    right = 0
    for seed in range(40):
        observation, _ = game.reset(seed=seed)
        stated = [truth[line] for line in game.manual.split("\n") if line in truth]
        _, likeliest = casts(claims(game.manual), tuple(sorted(SeenEntities.of(observation).things)))[0]
        right += likeliest == true_cast(stated, game.unwrapped._rules_state.movements, game.unwrapped._names)
    assert right >= 32


def true_cast(entries: list[Entry], movements: tuple[str, ...], names: tuple[str, ...]) -> Cast:
    enemy, message, goal, decoy_message, decoy_goal = (MOVEMENTS.index(movement) for movement in movements)
    cast = {
        names[0]: (Part("enemy", enemy),),
        names[1]: (Part("message", message), Part("enemy", decoy_message)),
        names[2]: (Part("goal", goal), Part("enemy", decoy_goal)),
    }
    triples = {(entry.entity, entry.role, entry.kind) for entry in entries}
    assert all((name, part.role, MOVEMENTS[part.movement]) in triples for name, parts in cast.items() for part in parts)
    return cast
