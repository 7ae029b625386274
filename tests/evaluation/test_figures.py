"""Figures draw the given numbers, always have the same bytes, and can be read without colours."""

from __future__ import annotations

import itertools

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.capability_dots import capability_dots
from smartplay_tools.evaluation.analysis.figures.curves import (
    score_against_history,
    score_against_prompt_tokens,
)
from smartplay_tools.evaluation.analysis.figures.frontier import frontier
from smartplay_tools.evaluation.analysis.figures.prompt_figures import prompt_rows
from smartplay_tools.evaluation.analysis.figures.run import run_figures
from smartplay_tools.evaluation.analysis.figures.style import Series, save_figure
from smartplay_tools.evaluation.analysis.windows import compare_windows
from smartplay_tools.records.accounts import shown_turns
from smartplay_tools.records.record import Record
from tests.evaluation.window_rows import row

BANDIT, RPS = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0"


def episodes(scores, **facts):
    return [row(seed=seed, score=score, **facts) for seed, score in enumerate(scores)]


@pytest.fixture(scope="module")
def comparisons():
    return compare_windows(
        [
            *episodes([20, 24], history=1, tokens=100),
            *episodes([30, 34], history=5, tokens=200),
            *episodes([40, 44], history=None, tokens=400),
            *episodes([25, 25], history=1, tokens=100, player="random"),
            *episodes([25, 25], history=None, tokens=400, player="random"),
            *episodes([10, 12], history=1, tokens=100, game=RPS),
            *episodes([35, 37], history=None, tokens=500, game=RPS),
        ]
    )


def lines(axes):
    """The labelled lines of a panel: label -> (x, y)."""
    return {line.get_label(): line.get_xydata().tolist() for line in axes.get_lines() if line.get_label()[0] != "_"}


def ticks(axes):
    return [label.get_text() for label in axes.get_xticklabels()]


def test_score_against_history_has_a_panel_for_each_game_and_a_line_for_each_player(comparisons):
    bandit, rps = score_against_history(comparisons).axes
    assert bandit.get_title() == f"{BANDIT}\nhistory 1 against history all: undecided"
    assert rps.get_title().startswith(RPS)
    assert ticks(bandit) == ["1", "5", "all"]
    assert [y for _, y in lines(bandit)["rule"]] == [22, 32, 42]
    assert [y for _, y in lines(bandit)["random"]] == [25, 25]
    assert [round(x) for x, _ in lines(bandit)["random"]] == [0, 2]  # at "1" and at "all"
    assert lines(bandit)["human (paper)"][0][1] == 45
    assert -5 < bandit.get_ylim()[0] <= 0


def test_only_the_widest_of_the_other_limits_is_drawn():
    rows = [r for p in (500, None) for h in (1, 5) for r in episodes([h + (p is None)], history=h, prompt_tokens=p)]
    (panel,) = score_against_history(compare_windows(rows)).axes
    assert [y for _, y in lines(panel)["rule"]] == [2, 6]
    (panel,) = score_against_prompt_tokens(compare_windows(rows)).axes
    assert ticks(panel) == ["500", "no cap"]
    assert [y for _, y in lines(panel)["rule"]] == [5, 6]


def test_what_tells_lines_apart_stands_in_their_names():
    rows = [r for m in ("tool", "pinned") for h in (1, 5) for r in episodes([h], history=h, manual=m)]
    (panel,) = score_against_history(compare_windows(rows)).axes
    assert set(lines(panel)) == {"rule, manual tool", "rule, manual pinned", "human (paper)"}

    here, there = {"base_url": "here"}, {"base_url": "there"}
    rows = [r for o in (here, there) for h in (1, 5) for r in episodes([h], history=h, player_options=o)]
    (panel,) = score_against_history(compare_windows(rows)).axes
    assert len(lines(panel)) == 3


def test_there_is_no_human_where_scores_are_not_comparable():
    rows = [r | {"normalized_score": None} for h in (1, 5) for r in episodes([h], history=h)]
    (panel,) = score_against_history(compare_windows(rows)).axes
    assert set(lines(panel)) == {"rule"}


def test_the_frontier_is_labelled_with_its_windows(comparisons):
    bandit, _ = frontier(comparisons).axes
    assert lines(bandit)["Pareto front (filled)"] == [[100, 25], [200, 32], [400, 42]]
    assert {text.get_text() for text in bandit.texts} == {"history 1", "history 5", "history all"}
    with pytest.raises(sp.InvalidArgumentError, match="no episode of the run has cost"):
        frontier(comparisons, price="cost")


def test_capabilities_set_everybody_against_the_same_settings():
    players = {"rule": {BANDIT: [1.0, 0.8], RPS: [0.9]}, "random": {BANDIT: [0.5], RPS: [None]}}
    (axes,) = capability_dots(players).axes
    assert set(lines(axes)) == {"human (paper)", "rule", "random", "the paper's 8 models"}
    # The bandit alone is common: every capability is its normalised score.
    assert {round(x, 9) for x, _ in lines(axes)["rule"]} == {0.9}
    assert len(lines(axes)["rule"]) == len(axes.get_yticks()) == 9
    assert "1 of the paper's 7 settings" in axes.get_title()


def test_capabilities_need_a_setting_in_common():
    with pytest.raises(sp.InvalidArgumentError, match="all its players"):
        capability_dots({"one": {BANDIT: [1.0]}, "other": {RPS: [1.0]}})
    with pytest.raises(sp.InvalidArgumentError, match="at least one player"):
        capability_dots({})


def test_cells_of_one_window_are_labelled_with_their_players():
    rows = [*episodes([9], history=5, tokens=100, player="a"), *episodes([30], history=5, tokens=200, player="b")]
    (axes,) = frontier(compare_windows(rows)).axes
    assert {text.get_text() for text in axes.texts} <= {"a", "b"}
    assert axes.texts


@pytest.mark.slow
def test_a_figure_has_the_same_bytes_every_time(comparisons, tmp_path):
    first, second = (
        [path.read_bytes() for path in save_figure(frontier(comparisons), tmp_path / name / "frontier")]
        for name in ("one", "other")
    )
    assert first == second
    png, svg, pdf = first
    assert png.startswith(b"\x89PNG")
    assert pdf.startswith(b"%PDF")
    assert b"CreationDate" not in pdf
    assert b"<dc:date>" not in svg
    assert str(tmp_path).encode() not in svg


def test_colour_is_never_the_only_difference():
    looks = [Series.number(index) for index in range(24)]
    assert len({(look.marker, str(look.line)) for look in looks}) == len(looks)


def test_legends_say_what_is_drawn_cover_no_data_and_stay_inside_of_their_figure(comparisons):
    """In pixels of the drawn figure, also with long names."""
    caps = [{"reply_tokens": 30}, {"reply_tokens": 300}, {"reply_tokens": 300, "tool_calls": 20}]
    rows = [r for own in caps for history in (1, 5) for r in episodes([1, 2], history=history, **own)]
    long = score_against_history(compare_windows(rows))
    assert long.legends[0].get_texts()[2].get_text() == "rule, replies ≤ 300, calls ≤ 20"
    for drawn in (long, score_against_history(comparisons), frontier(comparisons)):
        drawn.draw_without_rendering()
        (legend,) = drawn.legends
        assert legend.get_title().get_text() == "means of n = 2 episodes; bars: 95 % intervals"
        box = legend.get_window_extent()
        assert 0 <= box.x0 < box.x1 <= drawn.bbox.width
        assert all(axes.get_tightbbox().y0 >= box.y1 for axes in drawn.axes)


def test_cells_whose_results_were_cut_are_marked():
    rows = [row(seed, 10 + seed, history=h, cut_results=5 * (h == 1)) for h in (1, 5) for seed in range(3)]
    for drawn in (score_against_history(compare_windows(rows)), frontier(compare_windows(rows))):
        (panel,) = drawn.axes
        assert [text.get_text() for text in panel.texts].count("\N{DAGGER}") == 1
        assert "tool results were cut" in " ".join(drawn.legends[0].get_title().get_text().split())


def test_labels_stay_inside_of_the_axes_and_ticks_apart():
    """Also where the cheapest cell is on the front, and where all scores are equal."""
    for scores in ((3, 3), (20, 3000)):
        rows = [
            row(seed, score, history=h, prompt_tokens=123_456, tokens=tokens + seed)
            for h, score, tokens in ((1, scores[0], 200_000), (5, scores[1], 1_400_000))
            for seed in range(3)
        ]
        drawn = frontier(compare_windows(rows))
        drawn.draw_without_rendering()
        (panel,) = drawn.axes
        inside = panel.get_window_extent()
        for label in panel.texts:
            box = label.get_window_extent()
            assert inside.x0 <= box.x0 < box.x1 <= inside.x1
        ticks = [label.get_window_extent() for label in panel.get_xticklabels() if label.get_text()]
        assert all(left.x1 < right.x0 for left, right in itertools.pairwise(ticks))


def test_costs_are_drawn_if_anything_was_paid_and_capabilities_of_two_settings():
    paid = [row(seed, 3, history=h, tokens=100 * h, cost=h / 100) for h in (1, 5) for seed in range(2)]
    free = [each | {"cost": 0.0, "game": game} for each in paid for game in (BANDIT, RPS)]
    extra = {"frontier-of-cost", "capabilities"}
    assert [extra & run_figures(rows).keys() for rows in (paid, free)] == [{"frontier-of-cost"}, {"capabilities"}]


def test_a_row_of_cells_says_what_a_prompt_shows():
    """A cell for each turn: whole, masked, or gone, as the record of its prompt says."""
    budget = sp.Budget(history=2, beyond_history="mask", prompt_tokens=700)
    with sp.Episode("RockPaperScissorBasic-v0", seed=3, budget=budget, transcript=(events := [])) as episode:
        sp.play(episode, sp.get_player("rule"))
    record = Record(events)
    view = next(view for view in record.views if view["turn"] == 12)
    kinds = shown_turns(record, view)
    assert kinds.count("gone") == view["dropped_turns"]
    assert kinds.count("whole") == 3
    assert kinds.count("masked") == 12 - view["dropped_turns"] - 3 > 0
    axes = prompt_rows([("one", record, 12), ("two", record, 12)]).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["one", "two"]
    words = [text.get_text() for text in axes.texts]
    assert words == ["head", *map(str, range(12)), f"{view['tokens']} of 700 tokens"] * 2
    with pytest.raises(sp.InvalidArgumentError, match="no prompt of turn 99"):
        prompt_rows([("one", record, 99)])
