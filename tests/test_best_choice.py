"""The best choice of whole turns: against every choice in small worlds, and against real windows."""

from __future__ import annotations

import itertools
import random

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.comparison import compare
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.remembering import BEST, remembering_tables
from smartplay_tools.evaluation.analysis.window_tables import windows_table
from smartplay_tools.evaluation.analysis.windows import compare_windows
from smartplay_tools.records import Record
from smartplay_tools.records.best_choices import Asked, BestChoice, World, best_choice
from smartplay_tools.records.contents import OBSERVATION
from smartplay_tools.records.remembered import answers, remembered
from smartplay_tools.testing import check_strategy

SETTING = "Lockers6Distractors12-v0"


def small(draw: random.Random, *, equal: bool = False) -> World:
    """A world of a few turns; with `equal` sizes, each answer needs one turn, and no two need the same."""
    sizes = [2 if equal else draw.randint(1, 4) for _ in range(draw.randint(2, 7))]
    free, asked = set(range(len(sizes))), []
    for newest in range(len(sizes)):
        before = [turn for turn in range(newest) if turn in free or not equal]
        if before and draw.random() < 0.7:
            needs = draw.sample(before, 1 if equal else draw.randint(0, min(2, len(before))))
            free -= {*needs}
            asked.append(Asked(newest, frozenset(needs), 1.0, 0.25))
    return World(sizes, draw.randint(max(sizes), 10), asked)


def best_of_all(world: World, newest: int = 0, kept: frozenset[int] = frozenset()) -> float:
    """The score of the best of all choices that bring no turn back, one by one."""
    if newest == len(world.sizes):
        return world.rest
    scores = []
    for many in range(len(kept) + 1):
        for shown in map(frozenset, itertools.combinations(kept, many)):
            if world.has_room(shown, newest):
                won = sum(
                    each.right if each.needs <= shown else each.guessed for each in world.asked if each.newest == newest
                )
                scores.append(won + best_of_all(world, newest + 1, shown | {newest}))
    return max(scores, default=sum(each.guessed for each in world.asked if each.newest >= newest))


def test_no_choice_is_better_than_the_bound_and_the_one_that_is_found_can_be_made():
    exact = 0
    for seed in range(300):
        world = small(random.Random(seed))
        best, found = best_of_all(world), BestChoice.of(world)
        assert found.dropping <= found.without_return + 1e-9
        assert found.without_return - 1e-9 <= best <= found.at_most + 1e-9
        assert best <= found.with_return + 1e-9
        exact += found.without_return == found.at_most
    assert exact > 200


def test_dropping_the_oldest_is_a_choice_that_brings_nothing_back():
    asked = [Asked(2, frozenset([0]), 1, 0), Asked(3, frozenset([1]), 1, 0), Asked(4, frozenset([1]), 1, 0)]
    found = BestChoice.of(World([3, 1, 1, 1, 1], 4, asked))
    assert found.dropping == found.without_return == found.at_most == 2


def test_where_turns_are_equal_and_needed_once_the_best_is_exact():
    for seed in range(200):
        world = small(random.Random(seed), equal=True)
        found = BestChoice.of(world)
        assert found.without_return == found.at_most == pytest.approx(best_of_all(world))


class Asker:
    """Shows the turns that the next answer needs, and is told by the game which these are."""

    reads_everything = True
    game: sp.TextGame

    def choose(self, past, room):
        return sp.Choice([turn.number for turn in past.turns if {*self.game.needs}.intersection(turn.shows)])


def played(cap: int, seed: int, strategy: str | None = None, **rules: str) -> tuple[Record, BestChoice]:
    events = []
    budget = sp.Budget(history=None, prompt_tokens=cap, strategy=strategy)
    with sp.Episode(SETTING, seed=seed, budget=budget, transcript=events, **rules) as episode:
        Asker.game = episode.privileged_game()
        sp.play(episode, sp.get_player("reader"))
        found = best_choice(episode.config)
    assert found is not None
    return Record(events), found


FIRST = {"first_observation": "prompt", "offered_tools": "useful"}
"""What the first observation tells is in the head, and no turn."""


@pytest.mark.parametrize(("cap", "rules"), [(430, {}), (500, {}), (600, {}), (600, FIRST), (900, FIRST)], ids=str)
def test_a_real_window_keeps_what_dropping_is_said_to_keep(cap, rules):
    for seed in range(6 if rules else 3):
        record, found = played(cap, seed, **rules)
        seen = remembered(record).get("in view", [0, 0])[1]
        assert found.dropping == pytest.approx(seen + (6 - seen) / 9)
        assert found.dropping <= found.without_return == found.at_most <= found.with_return


def test_a_strategy_that_brings_turns_back_reaches_the_best():
    sp.register_strategy("asker", Asker)
    for seed in range(3):
        record, found = played(430, seed, "asker")
        assert record.result.score == found.with_return == 6


@pytest.mark.parametrize("strategy", ["keep-random", "keep-spread", "keep-spread:newest=0.5"])
def test_a_blind_choice_is_played_and_is_no_better_than_the_best(strategy):
    check_strategy(strategy, episodes=20)
    record, found = played(500, 1, strategy)
    seen = [answer for answer in answers(record) if answer.places]
    assert sum(answer.place == OBSERVATION for answer in seen) <= round(found.at_most)


def test_a_limited_history_and_a_game_that_tells_nothing():
    episode = sp.Episode(SETTING, seed=1, budget=sp.Budget(history=0, prompt_tokens=600))
    found = best_choice(episode.config)
    assert found is not None
    assert found.with_return == pytest.approx(6 / 9)
    for game, cap, rules in ((SETTING, None, {}), ("Hanoi3Disk-v0", 900, {}), (SETTING, 600, FIRST)):
        assert best_choice(sp.Episode(game, seed=1, budget=sp.Budget(prompt_tokens=cap), **rules).config) is None


def test_rows_and_tables_say_how_far_a_way_is_from_the_best(tmp_path):
    budgets = [sp.Budget(history=None, prompt_tokens=cap) for cap in (500, 2_000)]
    run = sp.evaluate([SETTING], ["reader"], budgets=budgets, trials=3, executor="inline", out=tmp_path / "run")
    gained = {
        (row["best"]["with_return"] > row["best"]["dropping"], row["budget"]["prompt_tokens"]) for row in run.rows
    }
    assert gained == {(True, 500), (False, 2_000)}
    table = next(each for each in remembering_tables(run.rows) if each.title.startswith("how far"))
    assert [column.heading for column in table.columns][1:] == [*BEST]
    small, large = table.rows[1:]
    assert float(small[-1].split()[0]) < 0.2
    assert large[-1] == "-"
    compared = comparison_tables(compare({"run": run.rows}))[0]
    assert "to best" in [column.heading for column in compared.columns]
    assert "to best" in [column.heading for column in windows_table(compare_windows(run.rows)).columns]
