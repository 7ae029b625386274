"""What trainers take from episodes: the tokens that a model drew, and forks of an episode at any turn."""

from __future__ import annotations

import itertools
import json

import pytest

import smartplay_tools as sp
from smartplay_tools.context.strategies import custom
from smartplay_tools.evaluation.exports.sft import reply_rows
from smartplay_tools.players.wire.chat import ChatCompletions
from smartplay_tools.records import Record

GAME = "RockPaperScissorBasic-v0"
BUDGET = sp.Budget(prompt_tokens=700, slack=0.5)
HANDS = ("Rock", "Paper", "Scissor")


class Sampler:
    """A player that says of which tokens its replies are made."""

    name = "sampler"

    def __init__(self, **tokens):
        self._tokens, self._numbers = tokens, itertools.count()

    def reply(self, prompt):
        sampled = sp.SampledTokens(reply=[next(self._numbers), 7], **self._tokens)
        return sp.Reply(sp.call("act", action="Rock"), sampled=sampled)


def play(player, **budget):
    record: list[dict] = []
    episode = sp.Episode(GAME, seed=3, budget=BUDGET.model_copy(update=budget), transcript=record)
    return sp.play(episode, player), record


def size(record):
    return len("".join(json.dumps(event) + "\n" for event in record))


def test_the_tokens_of_replies_are_in_the_record_and_in_exported_rows():
    result, record = play(Sampler(logprobs=[-0.5, 0.0], prompt=[1, 2, 3]))
    assert result.turns == 50
    rows = list(reply_rows(Record(record)))
    assert [list(row["completion_ids"]) for row in rows] == [[number, 7] for number in range(50)]
    assert {(tuple(row["completion_logprobs"]), tuple(row["prompt_ids"])) for row in rows} == {((-0.5, 0.0), (1, 2, 3))}
    assert sp.replay(record).identical


class AsksTwice:
    """A compactor that asks two questions for every prompt, and changes nothing."""

    def compact(self, history, room):
        for _ in range(2):
            yield history[:1]
        return history


@pytest.mark.parametrize("budget", [{"summary_tokens": 40}, {"strategy": "asks-twice", "slack": 0}])
def test_the_reply_to_a_prompt_for_a_summary_or_to_a_question_has_its_tokens_too(budget, monkeypatch):
    monkeypatch.setitem(custom._NAMED, "asks-twice", custom.Loaded(AsksTwice))
    result, record = play(Sampler(), **budget)
    rows = list(reply_rows(Record(record), summaries=True))
    assert result.summaries or result.questions == 100
    assert [row["completion_ids"][0] for row in rows] == list(
        range(result.turns + result.summaries + (result.questions or 0))
    )
    assert sp.replay(record).identical


def test_tokens_and_their_probabilities_belong_together():
    with pytest.raises(ValueError, match="1 logprobs for 2 tokens"):
        sp.SampledTokens(reply=[1, 2], logprobs=[-1.0])
    with sp.Episode(GAME, seed=3) as episode, pytest.raises(sp.InvalidArgumentError, match="SampledTokens"):
        sp.Conversation(episode).receive(sp.Reply(sp.call("act", action="Rock"), sampled=[1, 2]))


def test_a_server_that_sends_token_ids_is_read():
    answer = {
        "choices": [
            {
                "message": {"role": "assistant", "content": "Hello"},
                "finish_reason": "stop",
                "token_ids": [9707, 2],
                "logprobs": {"content": [{"token": "Hello", "logprob": -0.25}, {"token": "", "logprob": 0.0}]},
            }
        ],
        "prompt_token_ids": [1, 2, 3],
    }
    sampled = ChatCompletions().reply(answer).sampled
    assert sampled == sp.SampledTokens(reply=[9707, 2], logprobs=[-0.25, 0.0], prompt=[1, 2, 3])
    answer["choices"][0]["token_ids"] = ["not", "ids"]
    assert ChatCompletions().reply(answer).sampled is None


def test_forks_share_the_past_and_differ_in_what_they_do():
    _, record = play(sp.get_player("rule"))
    scores = {}
    for hand in HANDS:
        own: list[dict] = []
        with sp.fork(record, 20, transcript=own) as forked:
            assert forked.episode.stats.turns == 20
            scores[hand] = sp.play(forked.conversation, sp.ScriptedPlayer([sp.call("act", action=hand)] * 30)).score
        assert sp.replay(own).identical
        assert own[: len(own) // 3] == record[: len(own) // 3]
    assert len(set(scores.values())) > 1


@pytest.mark.parametrize("turn", [0, 50])
def test_a_fork_that_replies_alike_plays_alike(turn):
    result, record = play(sp.get_player("rule"))
    with sp.fork(record, turn) as forked:
        again = sp.play(forked.conversation, sp.get_player("rule"))
    assert (again.score, again.state_hash, again.tokens) == (result.score, result.state_hash, result.tokens)


def test_an_episode_that_is_still_played_can_be_forked():
    record: list[dict] = []
    with sp.Episode(GAME, seed=3, budget=BUDGET, transcript=record) as episode:
        conversation = sp.Conversation(episode)
        for hand in HANDS:
            conversation.prompt()
            conversation.receive(sp.call("act", action=hand))
        prompt = conversation.prompt()
        with sp.fork(record, 3) as forked:
            assert forked.conversation.prompt().messages == prompt.messages
        assert not episode.done


def test_a_turn_that_the_record_does_not_have_is_refused():
    _, record = play(Sampler())
    with pytest.raises(sp.InvalidArgumentError, match="has 50 turns"):
        sp.fork(record, 51)
