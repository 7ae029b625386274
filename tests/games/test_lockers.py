"""Lockers: what the dials do, and that what an action needs is what a reader needs."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.suites import SUITES
from smartplay_tools.games import get_spec, lockers_setting
from smartplay_tools.games.lockers import ASKED, NOTED, TOLD
from smartplay_tools.records import Record
from smartplay_tools.records.remembered import answers

SETTINGS = [game for game in sp.GAMES if game.startswith("Lockers")]
ALL_DIALS = lockers_setting("AllDials-v0", facts=5, distractors=4, distance=3, updates=7, order="reversed")


def sentences(spec: sp.GameSpec, seed: int) -> list[str]:
    """Return everything that a world says."""
    game = spec.make()
    said, over = [game.reset(seed=seed)[0]], False
    while not over:
        text, _, over, _ = game.advance(game.actions.index(NOTED))
        said.append(text)
    return said


def play(spec: sp.GameSpec | str, player: str = "reader", seed: int = 3, transcript=None, **budget) -> sp.EpisodeResult:
    with sp.Episode(spec, seed=seed, budget=sp.Budget(**budget), transcript=transcript) as episode:
        return sp.play(episode, sp.get_player(player, seed=seed))


@pytest.mark.parametrize("game", [*SETTINGS, ALL_DIALS], ids=lambda game: getattr(game, "id", game))
def test_who_sees_everything_makes_no_mistake_and_who_sees_nothing_guesses(game):
    whole = play(game, history=None)
    assert (whole.score, whole.completed, whole.end_reason) == (get_spec(game).kwargs["facts"], True, "terminated")
    assert whole.steps == get_spec(game).rollout
    assert sum(play(game, seed=seed, history=0).score for seed in range(8)) / 8 < whole.score / 2


def test_asked_as_told_the_score_jumps_where_the_window_holds_as_many_past_steps_as_facts():
    assert play("Lockers12Told-v0", history=12).score == 12
    assert play("Lockers12Told-v0", history=11).score < 6


@pytest.mark.parametrize("seed", range(5))
def test_a_world_says_as_much_of_each_kind_as_its_dials(seed):
    said = sentences(ALL_DIALS, seed)
    told, asked = TOLD.findall("\n".join(said)), ASKED.findall("\n".join(said))
    assert [sum(kind in text for text in said) for kind in ("now holds", " holds", "painted", "clock")] == [7, 12, 4, 3]
    assert asked == list(dict.fromkeys(locker for locker, _ in told))[::-1]
    assert said.index("A clock ticks.") == 16
    for at, (locker, item) in enumerate(told):
        earlier = [before for other, before in told[:at] if other == locker]
        assert earlier[-1:] != [item], "an update tells another item"


def test_the_orders_of_questions():
    def order(name: str, seed: int) -> tuple[list[str], list[str]]:
        text = "\n".join(sentences(lockers_setting("Ordered-v0", facts=9, order=name), seed))
        return [locker for locker, _ in TOLD.findall(text)], ASKED.findall(text)

    for seed in range(4):
        told, asked = order("told", seed)
        assert asked == told
        told, asked = order("reversed", seed)
        assert asked == told[::-1]
        told, asked = order("free", seed)
        assert sorted(asked) == sorted(told)
        assert asked != told


def test_the_newest_telling_is_what_is_needed_and_is_found_by_its_words(tmp_path):
    path = tmp_path / "episode.jsonl"
    play(ALL_DIALS, transcript=path, history=None, notes_tokens=400)
    asked = [answer for answer in answers(Record(sp.read_transcript(path))) if answer.places]
    assert [answer.place for answer in asked] == ["observation"] * 5
    said = sentences(ALL_DIALS, 3)
    for (step,), question in zip((answer.places for answer in asked), said[-6:-1], strict=True):
        told = f"Locker {ASKED.findall(question)[0]} "
        assert step == max(at for at, text in enumerate(said) if text.startswith(told) and TOLD.search(text))
    play(ALL_DIALS, transcript=tmp_path / "notes.jsonl", history=1, notes_tokens=400)
    noted = [answer for answer in answers(Record(sp.read_transcript(tmp_path / "notes.jsonl"))) if answer.places]
    assert {answer.place for answer in noted} <= {"memory", "observation"}
    assert "memory" in {answer.place for answer in noted}


def test_it_is_no_part_of_the_benchmark():
    assert not {*SETTINGS} & sp.GAMES.benchmark
    assert not any(sp.GAMES[game].challenges for game in SETTINGS)
    assert not any(game in suite.games for suite in SUITES.values() for game in SETTINGS)


@pytest.mark.parametrize(
    ("dials", "told"),
    [
        ({"facts": 0}, "facts is a whole number from 1 to 1,000, not 0"),
        ({"updates": -1}, "updates is a whole number from 0 to 1,000, not -1"),
        ({"distance": 1.5}, "distance is a whole number from 0 to 1,000, not 1.5"),
        ({"order": "backwards"}, "order is free, told or reversed, not 'backwards'"),
    ],
)
def test_a_wrong_dial_is_one_sentence(dials, told):
    with pytest.raises(sp.InvalidArgumentError, match=told):
        lockers_setting("Wrong-v0", **dials).make()
