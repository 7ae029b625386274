"""TextEnv: the same play as `play`, in the shape of `reset` and `step`; many at the same time in one process."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.records.replays import comparable

GAME = "RockPaperScissorBasic-v0"
BUDGET = sp.Budget(prompt_tokens=800, slack=0.5)


def policy(env: sp.TextEnv, player: sp.Player, messages: list, facts: dict) -> sp.Message:
    tools = env.episode.tools
    return player.reply(sp.Prompt(messages, tools, facts["max_tokens"], purpose=facts["purpose"])).message


START = {"purpose": "play", "max_tokens": None}


@pytest.mark.parametrize(
    ("budget", "player"),
    [(BUDGET, "rule"), (sp.Budget(prompt_tokens=800, summary_tokens=100, slack=0.5), "rule-notes")],
    ids=["window", "summaries"],
)
def test_the_record_is_that_of_play(tmp_path, budget, player):
    env = sp.TextEnv(GAME, budget=budget, records=tmp_path / "env", player=player)
    teacher, messages, done, rewards = sp.get_player(player), env.reset(seed=7), False, []
    facts = START
    while not done:
        messages, reward, done, facts = env.step(policy(env, teacher, messages, facts))
        rewards.append(reward)
    env.close()
    assert messages == []
    assert facts["result"].end_reason == "rollout"
    assert sum(rewards) == pytest.approx(facts["result"].normalized_score)
    with sp.Episode(GAME, seed=7, budget=budget, transcript=tmp_path / "play.jsonl") as episode:
        sp.play(episode, sp.get_player(player))
    (record,) = (tmp_path / "env").glob("7.*.jsonl")
    assert comparable(sp.read_transcript(record)) == comparable(sp.read_transcript(tmp_path / "play.jsonl"))
    assert sp.replay(record).identical


def test_a_text_is_a_reply_without_a_call():
    env = sp.TextEnv("Hanoi3Disk-v0")
    env.reset(seed=1)
    messages, reward, done, _ = env.step("Let me think.")
    assert (reward, done) == (0, False)
    assert messages[-2]["content"] == "Let me think."


def test_what_is_out_of_order_is_said():
    env = sp.TextEnv("Hanoi3Disk-v0", budget=sp.Budget(tool_calls=1))
    with pytest.raises(sp.InvalidArgumentError, match="not been reset"):
        env.step("Hello.")
    env.reset(seed=1)
    assert env.step(sp.call("observe"))[2]
    with pytest.raises(sp.InvalidArgumentError, match="is over; reset"):
        env.step("Hello.")
    assert env.reset(seed=2), "it can be used again"
    env.close()


def test_the_tools_are_functions_of_chat_completions():
    names = [tool["function"]["name"] for tool in sp.TextEnv("Hanoi3Disk-v0").tools]
    assert names == ["observe", "act", "read_manual"]
