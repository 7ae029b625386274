"""Comparing runs: which episodes are pairs, which sides are compared, and how the result is printed."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.comparison import as_rows, compare
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.decisions import Margin
from smartplay_tools.evaluation.analysis.formats import rows_to_csv
from tests.evaluation.command import refused
from tests.evaluation.window_rows import row

RPS = "RockPaperScissorBasic-v0"


def episodes(scores, player="rule", **facts):
    facts = {"prompts": "1", "versions": {"smartplay-tools": "1.0"}} | facts
    return [row(seed, score, player=player, **facts) for seed, score in enumerate(scores)]


def test_pairs_share_game_seed_and_trial():
    before, after = episodes([10, 20, 30, 40]), episodes([15, 20, 20])[::-1]
    after[0] = after[0] | {"trial": 7}  # of the same seed, but another trial
    (pairing,) = compare({"before": before, "after": after}).pairings
    assert (pairing.pairs, pairing.unpaired) == (2, 3)
    assert (pairing.wins, pairing.ties, pairing.losses) == (1, 1, 0)
    assert pairing.differences["score"].mean == 2.5
    assert pairing.means["score"].mean == pytest.approx(55 / 3)


def opponents(runs, **how):
    return {
        (p.side.run, p.side.player, p.side.label): (p.reference.player, p.reference.label)
        for p in compare(runs, **how).pairings
    }


def test_another_version_is_compared_with_the_same_player():
    run = episodes([1, 2]) + episodes([0, 0], "random")
    assert opponents({"a": run, "b": run}) == {
        ("b", "rule", "history all"): ("rule", "history all"),
        ("b", "random", "history all"): ("random", "history all"),
    }


def test_another_player_is_compared_under_the_same_budget():
    wide, narrow = episodes([1, 2]), episodes([1, 1], prompt_tokens=900)
    other = episodes([0, 0], "random", prompt_tokens=900)
    ((given, opponent),) = opponents({"a": wide + narrow, "b": other}).items()
    assert given[:2] == ("b", "random")
    assert "prompts <= 900" in given[2]
    assert opponent == ("rule", given[2])


def test_another_budget_is_compared_with_the_same_player():
    runs = {"a": episodes([0, 0], "random") + episodes([1, 2]), "b": episodes([1, 1], prompt_tokens=900)}
    assert set(opponents(runs).values()) == {("rule", "history all")}


def test_one_run_is_compared_with_its_first_player_or_the_one_that_is_named():
    run = {"a": episodes([1, 2]) + episodes([0, 0], "random") + episodes([5, 5], "oracle")}
    assert [reference[0] for reference in opponents(run).values()] == ["rule", "rule"]
    assert [reference[0] for reference in opponents(run, reference="random").values()] == ["random", "random"]
    with pytest.raises(sp.InvalidArgumentError, match="a has no player 'none'; it has rule, random, oracle"):
        compare(run, reference="none")


def test_other_versions_are_named():
    comparison = compare({"a": episodes([1, 2]), "b": episodes([1, 2], versions={"smartplay-tools": "2.0"})})
    assert comparison.versions == {"smartplay-tools": {"a": "1.0", "b": "2.0"}}
    assert "smartplay-tools differs: 1.0 in a, 2.0 in b" in comparison_tables(comparison)[0].notes


def test_names_say_what_differs_and_a_note_what_does_not():
    run = {"a": [r for h in (1, 5) for r in episodes([1, 2], history=h, reply_tokens=100)]}
    (table, *_) = comparison_tables(compare(run))
    assert [cells[0].strip() for cells in table.rows] == [
        "BanditTwoArmedHighLowFixed-v0",
        "rule, history 5",
        "rule, history 1",
    ]
    assert any(note.startswith("everywhere: ") and "replies <= 100" in note for note in table.notes)


def test_episodes_that_are_compared_with_nothing_are_counted():
    both = episodes([1, 2, 3])
    comparison = compare({"a": both + episodes([1, 2], game=RPS), "b": both})
    assert comparison.uncompared == 2
    assert (
        "2 episodes are of a game or a side that has nothing to be compared with here"
        in comparison_tables(comparison)[0].notes
    )
    assert compare({"a": both, "b": both}).uncompared == 0


def test_a_pairing_without_pairs_has_no_verdict_beside_those_that_have_one():
    unpaired = [r | {"trial": 99} for r in episodes([1, 2])]
    runs = {"a": episodes([1, 2]) + episodes([1, 2], game=RPS), "b": unpaired + episodes([1, 2], game=RPS)}
    comparison = compare(runs, margin=Margin(1))
    assert [row[-1] for row in comparison_tables(comparison)[0].rows if len(row) > 1] == ["", "-", "", "undecided"]
    (none, judged) = csv.DictReader(rows_to_csv(as_rows(comparison)).splitlines())
    assert (none["verdict"], judged["verdict"]) == ("", "undecided")


def test_runs_without_a_game_in_common_are_refused():
    with pytest.raises(sp.InvalidArgumentError, match="no two players or runs have a game in common"):
        compare({"a": episodes([1, 2]), "b": [r | {"game": RPS} for r in episodes([1, 2])]})


# The command; `tests/test_first_layout.py` has its tables.


def test_what_cannot_be_compared_is_one_sentence(tmp_path):
    published = Path(__file__).parents[2] / "experiments" / "tools-v1" / "rule"
    for words, sentence in (
        ([published, published / ".." / published.name], "The same folder is named twice"),
        ([tmp_path], "is not the folder of a run"),
    ):
        assert sentence in refused("compare", *words)
