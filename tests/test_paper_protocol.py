"""The paper's protocol: its prompts, its matching of answers, and our budgets and records for it."""

from __future__ import annotations

import asyncio
import json
import lzma
from hashlib import sha256
from itertools import takewhile
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.conversation.paper import PaperConversation, chosen_action
from smartplay_tools.games import get_spec
from smartplay_tools.games.base import history_text
from smartplay_tools.records.prompts import sent_prompts
from tests.games.recorded import MANUALS, begin, episodes

DATA = Path(__file__).parent / "data"
HANOI = "Hanoi3Disk-v0"


class Thinker:
    """Answers the first question with thoughts, and the second with the given choice."""

    name = "thinker"

    def __init__(self, *choices, thoughts="Let me see."):
        self.choices, self.thoughts, self.prompts = list(choices), thoughts, []

    def reply(self, prompt):
        self.prompts.append(prompt)
        asks_to_choose = prompt.messages[-2]["role"] == "assistant"
        words = self.choices.pop(0) if asks_to_choose else self.thoughts
        return sp.Reply({"role": "assistant", "content": words})


def play(game, player, tmp_path=None, **settings):
    transcript = None if tmp_path is None else tmp_path / "run.jsonl"
    with sp.Episode(game, seed=7, transcript=transcript, **settings) as episode:
        return sp.play(episode, player, protocol="paper")


def contents(prompt):
    return [message["content"] for message in prompt.messages]


# Prompts, byte for byte.


@pytest.mark.parametrize("path", sorted((DATA / "paper_protocol").glob("*.txt")), ids=lambda path: path.stem)
def test_a_prompt_in_full(path):
    """Our own output, for the games whose prompts were not recorded."""
    actions = get_spec(path.stem).make().actions
    thinker = Thinker(actions[0], actions[1], actions[0], thoughts="I have no idea.")
    play(path.stem, thinker, budget=sp.Budget(tool_calls=3))
    shown = "\n".join(f"=== {message['role']}\n{message['content']}" for message in thinker.prompts[5].messages)
    assert shown + "\n" == path.read_text(encoding="utf-8")


@pytest.mark.parametrize(("game", "rows"), episodes())
def test_the_recorded_games_give_the_recorded_prompts(game, rows):
    """Every text of a prompt but the questions was recorded; in Hanoi with 5 steps of history, in others with all."""
    shown = 5 if game.startswith("Hanoi") else 50
    thinker = Thinker(*(row["action"] for row in rows[1:]))
    with sp.Episode(game, seed=0, budget=sp.Budget(history=shown, tool_calls=len(rows) - 1)) as episode:
        begin(episode.game, rows)
        sp.play(episode, thinker, protocol="paper")
    assert len(thinker.prompts) == 2 * min(len(rows) - 1, episode.spec.rollout)
    past = list(enumerate(row["obs"] for row in rows))
    for row, prompt in zip(rows, thinker.prompts[::2], strict=False):
        role, manual, *history, observation, question = contents(prompt)
        assert role == "You’re a player trying to play the game."
        assert sha256(manual.encode()).hexdigest() == MANUALS[game]
        assert history == ([history_text(past[: row["step"]][-shown:])] if row["step"] else [])
        if row.get("history"):  # not every row has it
            assert history == [row["history"]]
        assert observation == f"current step observation: {row['obs']}"
        assert question == "What is the best action to take? Let's think step by step, "


CRAFTER = [json.loads(line) for line in lzma.decompress((DATA / "crafter.jsonl.xz").read_bytes()).splitlines()]


@pytest.mark.parametrize("seed", sorted({row["seed"] for row in CRAFTER}))
def test_crafters_history_begins_with_the_noop_of_the_reset(seed):
    reset, *rest = (row for row in CRAFTER if row["seed"] == seed)
    rows = list(takewhile(lambda row: row["action"] != "reset", rest))
    noop = f"You took action noop.\n\n{reset['obs']}"
    texts = [noop, reset["obs"], *(row["obs"] for row in rows)]
    thinker = Thinker(*(row["action"] for row in rows))
    with sp.Episode("Crafter-v0", seed=seed, budget=sp.Budget(tool_calls=len(rows))) as episode:
        sp.play(episode, thinker, protocol="paper")
    assert len(thinker.prompts) == 2 * len(rows)
    for step, prompt in enumerate(thinker.prompts[::2]):
        first = max(0, step - 4)  # five observations, the noop's 0, the reset's 1, that of the first action 2
        shown = [f"Player Observation Step {at}:\n{texts[at]}" for at in range(first, step + 1)]
        title = f"Most recent {len(shown)} steps of the player's in-game observation:"
        assert contents(prompt)[2] == "\n\n".join([title, *shown])
        assert contents(prompt)[3] == f"current step observation: {texts[step + 1]}"


# The answer.


@pytest.mark.parametrize(
    ("answer", "action"),
    [
        ("Rock", 0),
        ("scissor", 2),
        ("I play PAPER, because Rock is weak.", 1),
        ("Papers!", 1),
        ("Stone", None),
        ("", None),
        ("3", None),
    ],
)
def test_the_earliest_name_in_the_answer_is_the_action(answer, action):
    assert chosen_action(answer, ["Rock", "Paper", "Scissor"]) == action


def test_a_name_is_taken_with_its_full_stop():
    assert chosen_action("Pull slot machine 2", ["Pull slot machine 1.", "Pull slot machine 2."]) is None


def test_of_two_names_at_one_place_the_first_listed_is_meant():
    assert chosen_action("Make it so", ["Make", "Make it"]) == 0


def test_an_answer_without_a_name_plays_the_first_action_and_is_counted(tmp_path):
    result = play(
        "RockPaperScissorBasic-v0", Thinker("Paper", "Fire", None, "Rock"), tmp_path, budget=sp.Budget(tool_calls=4)
    )
    events = sp.read_transcript(tmp_path / "run.jsonl")
    choices = [(event["action"], event["fallback"]) for event in events if event["event"] == "choice"]
    assert choices == [("Paper", False), ("Rock", True), ("Rock", True), ("Rock", False)]
    assert (result.steps, result.fallback_actions) == (4, 2)
    assert (result.illegal_actions, result.malformed_calls, result.idle_replies) == (0, 0, 0)


# Budgets.


def test_no_prompt_is_over_its_cap_and_the_history_is_as_long_as_fits():
    game, counter = "BanditTwoArmedHighLowFixed-v0", TokenCounter()
    thinker = Thinker(*["Pull slot machine 1."] * 50)
    result = play(game, thinker, budget=sp.Budget(prompt_tokens=900))
    assert result.steps == 50
    sizes = [counter.prompt(prompt.messages) for prompt in thinker.prompts]
    assert max(sizes) <= 900
    assert result.tokens.prompt == sum(sizes)
    # One step more would have been too long: a step takes fewer than 30 tokens.
    assert min(sizes[-10:]) > 900 - 30
    history = contents(thinker.prompts[-1])[2]
    assert history.endswith(contents(thinker.prompts[-3])[3].removeprefix("current step observation: "))


def test_a_budget_that_cannot_hold_the_smallest_prompt_is_refused_at_once():
    budget = sp.Budget(prompt_tokens=420, result_tokens=1000)
    refused = pytest.raises(sp.InvalidArgumentError, match="prompt_tokens=420")
    with sp.Episode(HANOI, seed=7, budget=budget) as episode, refused:
        PaperConversation(episode)


def test_thoughts_that_fill_the_prompt_end_the_episode():
    result = play(HANOI, Thinker("?", thoughts="word " * 900), budget=sp.Budget(prompt_tokens=1000))
    assert (result.end_reason, result.steps, result.turns) == ("prompt_tokens", 0, 1)


def test_a_withheld_manual_is_in_no_prompt():
    thinker = Thinker("Rock")
    play("RockPaperScissorBasic-v0", thinker, manual="none", budget=sp.Budget(tool_calls=1))
    assert contents(thinker.prompts[0])[1] == "current step observation: New round begins."


# Records.


@pytest.mark.parametrize(("result_tokens", "cut"), [(None, 0), (40, 6)])
def test_a_record_holds_what_stood_before_the_reset(result_tokens, cut, tmp_path):
    thinker = Thinker("Do", "Sleep", "Noop")
    result = play("Crafter-v0", thinker, tmp_path, budget=sp.Budget(result_tokens=result_tokens, tool_calls=3))
    assert result.cut_results == cut  # manual, noop, reset, three actions
    path = tmp_path / "run.jsonl"
    assert sp.replay(path).differences == []
    rebuilt = [sent.prompt for sent in sent_prompts(sp.read_transcript(path))]
    assert [prompt.messages for prompt in rebuilt] == [prompt.messages for prompt in thinker.prompts]


@pytest.mark.parametrize(
    "budget",
    [sp.Budget(), sp.Budget(prompt_tokens=700), sp.Budget(history=2), sp.Budget(prompt_tokens=600, result_tokens=40)],
    ids=repr,
)
def test_the_record_replays_and_holds_every_prompt(budget, tmp_path):
    actions = get_spec(HANOI).make().actions
    thinker = Thinker(*[*actions * 5, "Nothing."][1:], thoughts="Hm. 河内塔 🗼")
    result = play(HANOI, thinker, tmp_path, budget=budget)
    assert result.end_reason == "rollout"
    path = tmp_path / "run.jsonl"
    assert sp.replay(path).differences == []
    events = sp.read_transcript(path)
    assert events[0]["config"]["protocol"] == "paper"
    rebuilt = [sent.prompt for sent in sent_prompts(events)]
    assert [prompt.messages for prompt in rebuilt] == [prompt.messages for prompt in thinker.prompts]


def test_a_changed_record_is_noticed(tmp_path):
    play(HANOI, Thinker(*["rod A to the top of rod B"] * 30), tmp_path)
    path = tmp_path / "run.jsonl"
    path.write_text(path.read_text().replace('"fallback": true', '"fallback": false', 1))
    assert "choice" in sp.replay(path).differences[0]


def test_a_player_that_fails_is_on_the_record(tmp_path):
    result = play(HANOI, Thinker("Move the top disk of rod A to the top of rod C"), tmp_path)
    assert (result.end_reason, result.steps, result.turns) == ("player_error", 1, 3)
    assert sp.replay(tmp_path / "run.jsonl").identical


def test_it_plays_on_an_event_loop_too():
    async def play_it():
        with sp.Episode(HANOI, seed=7) as episode:
            return await sp.aplay(episode, Thinker(*["Noop"] * 30), protocol="paper")

    assert asyncio.run(play_it()).fallback_actions == 30
