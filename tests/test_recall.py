"""Recall: what is found, what an answer may take, how long it stays, and what is on record of it."""

from __future__ import annotations

import re

import pytest

import smartplay_tools as sp

RPS, BANDIT = "RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0"


def begin(events=None, game=RPS, **budget):
    asked = {"recall_tokens": 400, "history": 1, "stalled_turns": None, **budget}
    return sp.Conversation(sp.Episode(game, seed=1, transcript=events, budget=sp.Budget(**asked)))


def test_without_a_prompt_there_is_nothing_to_compare_with():
    with sp.Episode(RPS, seed=1, budget=sp.Budget(recall_tokens=50)) as episode:
        result = episode.call("recall", {"query": "1"})
    assert result.is_error
    assert "no prompt was sent" in result.text
    assert (episode.result.recalls, episode.result.refused_calls) == (0, 1)


def test_it_is_refused_where_nothing_leaves_or_an_answer_cannot_fit():
    with pytest.raises(sp.InvalidArgumentError, match="recall_tokens has nothing to find where no observation ever"):
        begin(history=None)
    with pytest.raises(
        sp.InvalidArgumentError, match=r"recall_tokens=400 needs prompt_tokens of at least \d+"
    ) as refused:
        begin(prompt_tokens=600, result_tokens=30)
    needed = int(re.search(r"at least (\d+)", str(refused.value))[1])
    assert begin(prompt_tokens=needed, result_tokens=30).prompt() is not None
    with pytest.raises(sp.InvalidArgumentError, match=f"at least {needed}"):
        begin(prompt_tokens=needed - 1, result_tokens=30)


@pytest.mark.slow
def test_the_rule_player_with_recall_loses_less_of_the_bandit():
    def score(**budget):
        scores = []
        for seed in range(8):
            with sp.Episode(BANDIT, seed=seed, budget=sp.Budget(history=None, **budget)) as episode:
                scores.append(sp.play(episode, sp.get_player("rule-notes", words=False)).score)
        return sum(scores)

    plain, searching, full = score(prompt_tokens=700), score(prompt_tokens=700, recall_tokens=100), score()
    assert plain < searching <= full
