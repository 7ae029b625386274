"""Offload: pages of observations that were too long, their names, their age, and what is on record of them."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.players.prompt_reading import Reading
from tests import scripts
from tests.test_conversation import calling

RPS, CRAFTER = "RockPaperScissorBasic-v0", "Crafter-v0"
WORDS = scripts.Words()


def begin(events=None, game=RPS, **budget):
    asked = {"beyond_result": "offload", "result_tokens": 20, **budget}
    return sp.Conversation(
        sp.Episode(game, seed=1, transcript=events, tokenizer=WORDS, budget=sp.Budget(**asked)), player="script"
    )


@pytest.mark.parametrize("budget", [{"result_tokens": None}, {"result_tokens": "auto"}])
def test_where_nothing_is_cut_it_is_refused(budget):
    with pytest.raises(sp.InvalidArgumentError, match='beyond_result="offload" has nothing to offload'):
        begin(**budget)


def test_the_words_beside_a_picture_have_pages_without_it():
    events = []
    budget = sp.Budget(beyond_result="offload", result_tokens=101, prompt_tokens=4_000)
    episode = sp.Episode(CRAFTER, seed=1, observation="both", tokenizer=WORDS, transcript=events, budget=budget)
    conversation = sp.AgentSession(episode, pictures=True)
    for message in (calling(("observe", "{}")), calling(("read_result", '{"page": "r1.2"}'))):
        conversation.prompt()
        (call,) = conversation.receive(message)
        result = conversation.answer(call.id)
    assert result.picture is None
    assert not result.is_error
    episode.close()
    assert sp.replay(events, tokenizer=WORDS).identical


def test_the_rule_player_reads_an_observation_to_its_end_before_it_acts():
    conversation, player = begin(result_tokens=18, history=3), sp.get_player("rule-notes", words=False)
    seen = []
    while len(seen) < 12 and (prompt := conversation.prompt()) is not None:
        reading = Reading(prompt)
        seen.append((reading.next_page, reading.observations[-1:]))
        conversation.receive(player.reply(prompt).message)
    acted = [observations for page, observations in seen if page is None and observations]
    assert len(acted) > 2
    assert all(texts[0].endswith("New round begins.") for texts in acted)
