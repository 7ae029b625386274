"""The Messenger rule player: what it reads, what it infers, and how well it plays at the paper's budgets."""

from __future__ import annotations

import ast
import itertools
import re
from pathlib import Path

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.games.messenger.manuals import OUR_TEXTS, load
from smartplay_tools.games.messenger.rules import LAST, MOVEMENTS, SPLITS, Split, State, choices
from smartplay_tools.games.messenger.statistics import Entry, entries
from smartplay_tools.games.messenger.text import compose, describe
from smartplay_tools.players import rules
from smartplay_tools.players.rules import messenger, messenger_manual
from smartplay_tools.players.rules.messenger_belief import ENEMY, GOAL, MESSAGE, THINGS, Cases, believe
from smartplay_tools.players.rules.messenger_board import (
    CELLS,
    CHASER,
    DRAWS,
    EAST,
    FLEEING,
    IMMOVABLE,
    NOWHERE,
    OFFSETS,
    PLACES,
    SHIFT,
    WIDTH,
    Floats,
    board,
    offsets,
    sight_code,
)
from smartplay_tools.players.rules.messenger_casts import Cast, Part, casts
from smartplay_tools.players.rules.messenger_foresight import persistence, worths
from smartplay_tools.players.rules.messenger_manual import Claim, claims
from smartplay_tools.players.rules.messenger_sight import View


def completed(level: int, episodes: int) -> float:
    won = 0
    for seed in range(episodes):
        with sp.Episode(f"MessengerL{level}-v0", seed=seed) as episode:
            won += sp.play(episode, sp.get_player("rule")).completed
    return won / episodes


# Reading.


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


def test_every_word_that_it_knows_occurs_in_train_sentences() -> None:
    """The lists were made from the training split, so they hold nothing that only other sentences could teach."""
    train = "\n".join(entry.text for entry in entries(load(OUR_TEXTS, "train")))
    words = set(re.findall(r"[a-z][a-z-]*", train))
    for lists in (messenger_manual.ENTITIES, messenger_manual.ROLES):
        assert not set(" ".join(lists.values()).split()) - words
    for pattern in messenger_manual.MOVEMENTS.values():
        assert [part for part in re.split(r"\|(?![^(]*\))", pattern) if not re.search(part, train)] == []


@pytest.mark.parametrize("split", ["train", "test"])
def test_it_reads_each_sentence(split: Split) -> None:
    """Entity, role and movement of single sentences, of those that it was made from and of those it is scored on."""
    read = [(claims(compose([entry.text]))[0], entry) for entry in entries(load(OUR_TEXTS, split))]
    assert sum(claim.entity == entry.entity for claim, entry in read) / len(read) >= 0.995
    assert sum(claim.role == entry.role for claim, entry in read) / len(read) >= 0.998
    assert sum((claim.movement or "unknown") == entry.kind for claim, entry in read) / len(read) >= 0.98


@pytest.mark.parametrize("split", ["train", "test"])
@pytest.mark.parametrize("level", [1, 2, 3])
def test_it_reads_the_manuals_of_games(split: Split, level: int) -> None:
    """Whole manuals as games print them: every sentence's entity and role at once."""
    truth = {entry.text: entry for entry in entries(load(OUR_TEXTS, split))}
    game = sp.GAMES[f"MessengerL{level}-v0"].make(split=split)
    right = 0
    for seed in range(150):
        game.reset(seed=seed)
        told = [truth[line] for line in game.manual.split("\n") if line in truth]
        right += [(c.entity, c.role) for c in claims(game.manual)] == [(entry.entity, entry.role) for entry in told]
    assert right / 150 >= 0.97


# What sentences mean together.


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


def test_a_sentence_that_names_nobody_is_about_who_is_missing() -> None:
    said = (Claim("dog", "message", "chaser"), Claim(None, "enemy", "fleeing"), Claim("fish", "goal", "immovable"))
    (probability, cast), *_ = casts(said, ("dog", "fish", "mage"))
    assert cast["mage"] == (Part("enemy", FLEEING),)
    assert probability > 0.7


def test_where_the_manual_is_silent_every_movement_is_possible() -> None:
    said = (Claim("dog", "message", None), Claim("mage", "enemy", "fleeing"), Claim("fish", "goal", "immovable"))
    movements = {cast["dog"] for _, cast in casts(said, ("dog", "fish", "mage"))[:3]}
    assert movements == {(Part("message", movement),) for movement in range(len(MOVEMENTS))}


@pytest.mark.parametrize("split", ["train", "test"])
def test_the_likeliest_cast_is_mostly_the_true_one(split: Split) -> None:
    """The manuals of level 3, read and weighed before anything is seen. Now and then two casts are equally likely."""
    game = sp.GAMES["MessengerL3-v0"].make(split=split)
    truth = {entry.text: entry for entry in entries(load(OUR_TEXTS, split))}
    right = 0
    for seed in range(100):
        observation, _ = game.reset(seed=seed)
        told = [truth[line] for line in game.manual.split("\n") if line in truth]
        _, likeliest = casts(claims(game.manual), tuple(sorted(View.of(observation).things)))[0]
        right += likeliest == true_cast(told, game.unwrapped._rules_state.movements, game.unwrapped._names)
    assert right >= 80


def true_cast(told: list[Entry], movements: tuple[str, ...], names: tuple[str, ...]) -> Cast:
    enemy, message, goal, decoy_message, decoy_goal = (MOVEMENTS.index(movement) for movement in movements)
    cast = {
        names[0]: (Part("enemy", enemy),),
        names[1]: (Part("message", message), Part("enemy", decoy_message)),
        names[2]: (Part("goal", goal), Part("enemy", decoy_goal)),
    }
    said = {(entry.entity, entry.role, entry.kind) for entry in told}
    assert all((name, part.role, MOVEMENTS[part.movement]) in said for name, parts in cast.items() for part in parts)
    return cast


@pytest.mark.parametrize("split", ["train"])
def test_what_it_takes_for_granted_is_seen_in_training_games(split: Split) -> None:
    """Nobody tells that enemy, message and goal move differently, and the two decoys too; games of train show it."""
    game = sp.GAMES["MessengerL3-v0"].make(split=split)
    for seed in range(200):
        game.reset(seed=seed)
        *real, decoy_message, decoy_goal = game.unwrapped._rules_state.movements
        assert len(set(real)) == 3
        assert decoy_message not in (real[1], decoy_goal)
        assert decoy_goal != real[2]


# Where things are.


LINES = "You took action {}.\n\nYou (agent) don't have the message.\n\nYou see:\n- {}"


@pytest.mark.parametrize(
    ("observations", "movement"),
    [
        (["dog 6 steps to your north", "dog 5 steps to your north", "dog 5 steps to your north"], CHASER),
        (["dog 6 steps to your north", "dog 6 steps to your north", "dog 6 steps to your north"], IMMOVABLE),
        (["dog 5 steps to your north", "dog 5 steps to your north", "dog 6 steps to your north"], FLEEING),
    ],
)
def test_it_tells_movements_apart_by_what_it_sees(observations: list[str], movement: int) -> None:
    views = [View.of(LINES.format("Do Nothing", line)) for line in observations]
    possible = tuple((1 / 3, {"dog": (Part("enemy", movement),)}) for movement in range(len(MOVEMENTS)))
    cases = believe(possible, views)
    assert cases is not None
    assert np.bincount(cases.movements[ENEMY]).argmax() == movement


def test_a_move_that_changed_nothing_shows_the_border() -> None:
    lines = ("dog 4 steps to your east", "dog 4 steps to your east")
    views = [View.of(LINES.format("Move West", line)) for line in lines]
    cases = believe(((1.0, {"dog": (Part("enemy", IMMOVABLE),)}),), views)
    assert cases is not None
    assert set(cases.cell // 10) == {0}


def test_of_two_things_with_one_name_the_hidden_one_is_not_nearer() -> None:
    views = [View.of(LINES.format("Do Nothing", "dog 5 steps to your east"))] * 3
    twins = (Part("message", FLEEING), Part("enemy", IMMOVABLE))
    cases = believe(((1.0, {"dog": twins}),), views)
    assert cases is not None
    places = {spot: place for place, spot in enumerate(board().spot_of_place)}
    for spot, cell, hidden in zip(cases.spots[MESSAGE], cases.cell, cases.hidden[MESSAGE], strict=True):
        assert board().distance[cell, places[spot]] >= 5 if hidden else board().distance[cell, places[spot]] == 5
    assert cases.hidden[MESSAGE].mean() > 0.5, "what stands still is hardly the one that flees"


def test_what_cannot_be_is_not_believed() -> None:
    lines = ("dog 4 steps to your east", "dog 9 steps to your west")
    views = [View.of(LINES.format("Do Nothing", line)) for line in lines]
    assert believe(((1.0, {"dog": (Part("enemy", IMMOVABLE),)}),), views) is None
    assert messenger.choose((Claim("dog", "enemy", "immovable"),), views), "and then the older view is forgotten"


MOVERS_AND_PLACES = [
    (movement, cell, place)
    for movement in (CHASER, FLEEING)
    for cell in ((0, 0), (4, 7), (9, 5))
    for place in ((0, 0), (3, 14), (18, 10), (8, 18), (18, 18), (9, 14), (11, 10))
]


def by_the_rules(movement: int, cell: tuple[int, int], place: tuple[int, int]) -> dict[tuple[int, int], float]:
    """Where the game's own rules let a thing go in a tick, with probabilities."""
    ways = choices(MOVEMENTS[movement], place, (2 * cell[0], 2 * cell[1]))
    after: dict[tuple[int, int], float] = {}
    for dx, dy in ways:
        to = (place[0] + dx, place[1] + dy)
        to = to if min(to) >= 0 and max(to) <= LAST else place
        after[to] = after.get(to, 0) + 1 / len(ways)
    return after


@pytest.mark.parametrize(("movement", "cell", "place"), MOVERS_AND_PLACES)
def test_things_are_believed_to_move_as_they_do(movement: int, cell: tuple[int, int], place: tuple[int, int]) -> None:
    belief: Floats = np.zeros((1, PLACES), dtype=np.float32)
    belief[0, WIDTH * place[0] + place[1]] = 1
    moved = board().advance(belief, movement, np.array([CELLS * cell[0] + cell[1]]))[0]
    believed = {divmod(int(to), WIDTH): float(moved[to]) for to in np.flatnonzero(moved)}
    assert believed == pytest.approx(by_the_rules(movement, cell, place))


@pytest.mark.parametrize(("movement", "cell", "place"), MOVERS_AND_PLACES)
def test_things_move_in_thought_as_they_do(movement: int, cell: tuple[int, int], place: tuple[int, int]) -> None:
    tables, spot = offsets(), EAST * place[0] + place[1]
    apart = EAST * 2 * cell[0] + 2 * cell[1] - spot + SHIFT
    after: dict[tuple[int, int], float] = {}
    for draw in range(DRAWS):
        to = spot + tables.step[(movement * DRAWS + draw) * OFFSETS + apart]
        to = int(to if tables.on_board[to + SHIFT] else spot)
        after[divmod(to, EAST)] = after.get(divmod(to, EAST), 0) + 1 / DRAWS
    assert after == pytest.approx(by_the_rules(movement, cell, place))


def test_things_are_looked_for_where_they_are_shown() -> None:
    """The words of the game, for every place on the board and some of ours, are those that the player expects."""
    for cell_x, cell_y in ((0, 0), (4, 7), (9, 9)):
        for x, y in itertools.product(range(WIDTH), repeat=2):
            state = State(((x, y),), ("immovable",), (2 * cell_x, 2 * cell_y))
            shown = View.of(describe(state, ("dog",))).things["dog"]
            assert board().shown[CELLS * cell_x + cell_y, WIDTH * x + y] == sight_code(*shown)


# What to do.


def cases_of(cell: tuple[int, int], **things: tuple[tuple[int, int], int]) -> Cases:
    """One situation, twenty times: where we are, and the place of each thing in half cells and how it moves."""
    spots, movements = np.full((len(THINGS), 20), NOWHERE), np.full((len(THINGS), 20), IMMOVABLE)
    for name, ((x, y), movement) in things.items():
        index = {"enemy": ENEMY, "message": MESSAGE, "goal": GOAL}[name]
        spots[index], movements[index] = 64 * x + y, movement
    nothing = np.zeros((len(THINGS), 20), dtype=bool)
    return Cases(np.full(20, 10 * cell[0] + cell[1]), spots, movements, np.zeros(20, dtype=int), nothing)


def best(cases: Cases, *, has_message: bool) -> str:
    return messenger.ACTIONS[int(worths(cases, has_message=has_message).argmax())]


def test_it_goes_for_the_message_and_then_for_the_goal() -> None:
    cases = cases_of((5, 5), message=((10, 4), IMMOVABLE), goal=((10, 16), IMMOVABLE))
    assert best(cases, has_message=False) == "Move North"
    assert best(cases, has_message=True) == "Move South"


def test_it_does_not_touch_the_goal_without_the_message() -> None:
    worth = worths(cases_of((5, 5), goal=((12, 10), IMMOVABLE), message=((16, 10), IMMOVABLE)), has_message=False)
    assert worth[messenger.ACTIONS.index("Move East")] == worth.min() < 0


def test_it_evades_a_chaser() -> None:
    cases = cases_of((5, 5), enemy=((13, 10), CHASER), message=((16, 10), IMMOVABLE), goal=((2, 2), IMMOVABLE))
    worth = worths(cases, has_message=False)
    assert worth[messenger.ACTIONS.index("Move East")] == worth.min() < 0 < worth.max()


def test_it_walks_straight_on_while_it_sees_nothing_that_it_wants() -> None:
    cases = cases_of((5, 5), goal=((2, 2), IMMOVABLE))
    assert not persistence(cases, "Move East", has_message=True).any()
    cases.hidden[GOAL] = True
    worth = dict(zip(messenger.ACTIONS, persistence(cases, "Move East", has_message=True), strict=True))
    assert worth["Move East"] > worth["Move North"] == 0 > worth["Move West"] == worth["Do Nothing"]


def test_it_does_not_walk_on_where_the_border_is() -> None:
    cases = cases_of((9, 5), goal=((2, 2), IMMOVABLE))
    cases.hidden[GOAL] = True
    worth = dict(zip(messenger.ACTIONS, persistence(cases, "Move East", has_message=True), strict=True))
    assert worth["Move North"] > worth["Move East"] == worth["Do Nothing"]


# Playing.


def test_its_modules_import_no_table_of_the_games() -> None:
    modules = sorted(Path(rules.__file__ or "").parent.glob("messenger*.py"))
    assert len(modules) >= 5
    for module in modules:
        tree = ast.parse(module.read_text(encoding="utf-8"))
        imported = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        imported += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
        assert not [name for name in imported if name.startswith("smartplay_tools.games")]


def test_level_1_is_won() -> None:
    assert completed(1, 60) >= 0.95


def test_level_2_is_mostly_won() -> None:
    assert completed(2, 12) >= 0.8


@pytest.mark.parametrize("split", SPLITS)
def test_it_plays_the_games_of_every_split(split: Split) -> None:
    with sp.Episode("MessengerL2-v0", seed=0, split=split) as episode:
        assert sp.play(episode, sp.get_player("rule")).completed


@pytest.mark.parametrize("history", [0, 1, 20])
def test_it_plays_with_every_window(history: int) -> None:
    with sp.Episode("MessengerL2-v0", seed=1, budget=sp.Budget(history=history)) as episode:
        assert sp.play(episode, sp.get_player("rule")).completed


@pytest.mark.slow
@pytest.mark.parametrize(("level", "episodes", "at_least"), [(1, 200, 0.95), (2, 200, 0.8), (3, 100, 0.4)])
def test_it_plays_as_well_as_promised(level: int, episodes: int, at_least: float) -> None:
    """The bounds hold for 200 episodes of each level; level 3 takes half a second an episode, so it plays half here."""
    assert completed(level, episodes) >= at_least
