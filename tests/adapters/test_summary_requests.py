"""A player behind an interface is asked for a summary, although nothing but the question says so there."""

from __future__ import annotations

import pytest

import smartplay_tools as sp

BANDIT = "BanditTwoArmedHighLowFixed-v0"


BUDGET = sp.Budget(history=None, prompt_tokens=900, slack=0.5, summary_tokens=120)


def by_endpoint(episode: sp.Episode, player: str) -> None:
    pytest.importorskip("openai")
    gateway = pytest.importorskip("smartplay_gateway")
    with gateway.LocalEndpoint(sp.get_player("rule-notes")) as endpoint:
        asking = sp.get_player(f"{player}:rule-notes", base_url=endpoint.base_url)
        sp.play(episode, asking)
        asking.close()


@pytest.mark.slow
@pytest.mark.parametrize("player", ["openai", "openai-responses"])
def test_a_player_behind_an_interface_is_asked_for_summaries(player):
    """Nothing but the question says so there; the player answers it with its memory, as in a loop of its own."""
    budget = BUDGET.model_copy(update={"tool_calls": 25})
    with sp.Episode(BANDIT, seed=1, budget=budget) as episode:
        by_endpoint(episode, player)
    with sp.Episode(BANDIT, seed=1, budget=budget) as direct:
        sp.play(direct, sp.get_player("rule-notes"))
    assert direct.result.summaries > 1
    assert direct.result.empty_summaries == 0
    counts = ("summaries", "score", "state_hash", "turns", "refused_calls", "end_reason", "empty_summaries")
    assert [getattr(episode.result, name) for name in counts] == [getattr(direct.result, name) for name in counts]
    assert episode.result.tokens.summary_reply == direct.result.tokens.summary_reply
