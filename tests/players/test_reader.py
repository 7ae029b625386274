"""The reader: what its prompt shows decides how it plays, and it writes down nothing but what it has read."""

from __future__ import annotations

import re

import pytest

import smartplay_tools as sp
from smartplay_tools.games.base import TextGame, with_action_list
from smartplay_tools.players.prompt_reading import Reading
from smartplay_tools.players.reader import visible

LETTERS = ("A", "B", "C", "D")


class Echo(TextGame):
    """Repeat the letter that was shown three steps before."""

    actions = LETTERS
    manual = with_action_list("Repeat the letter of three steps before.", LETTERS)

    def _reset(self) -> str:
        self._letters = [LETTERS[draw] for draw in self.np_random.integers(4, size=41)]
        return f"Letter 0 is {self._letters[0]}."

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        step = self._steps + 1
        reward = float(step > 3 and LETTERS[action] == self._letters[step - 4])
        self.score += reward
        return f"Letter {step} is {self._letters[step]}.", reward, step == 40, False

    def _state(self) -> object:
        return self._letters

    @classmethod
    def right_actions(cls, seen, actions):
        text = seen.get(max(seen) - 3)
        return [] if text is None else [action for action in actions if text.endswith(f" is {action}.")]


ECHO = sp.GameSpec(
    id="Echo-v0", family="echo", entry_point=Echo, history=3, rollout=40, trials=5, score_bounds=(0, 37), memory=3
)


class Watched:
    """A player whose prompts and replies are kept."""

    name = "watched"

    def __init__(self) -> None:
        self.player = sp.get_player("reader", seed=1)
        self.asked: list[tuple[sp.Prompt, str]] = []
        self.attach = self.player.attach

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        reply = self.player.reply(prompt)
        if prompt.purpose != "play":
            self.asked.append((prompt, reply.message["content"]))
        return reply


def play(player=None, **budget):
    with sp.Episode(ECHO, seed=5, budget=sp.Budget(**budget)) as episode:
        return sp.play(episode, player or sp.get_player("reader", seed=1))


def test_it_plays_rightly_from_exactly_the_past_that_is_needed():
    assert play(history=3).score == 37
    assert play(history=2).score < 20


@pytest.mark.parametrize(
    "kept", [{"notes_tokens": 60}, {"memory_tokens": 80}, {"summary_tokens": 60, "slack": 0.5, "prompt_tokens": 700}]
)
def test_notes_files_and_summaries_hold_what_the_window_lost(kept):
    history = {} if "summary_tokens" in kept else {"history": 1}
    result = play(**{"history": None} | history, **kept)
    assert result.score == 37
    assert result.refused_notes == result.refused_memory == result.cut_summaries == 0


def test_a_summary_is_the_newest_observations_that_the_question_shows_one_a_line_in_the_cap():
    watched = Watched()
    play(watched, history=None, prompt_tokens=600, summary_tokens=40, slack=0.5)
    assert len(watched.asked) > 1
    for prompt, text in watched.asked:
        lines = [re.fullmatch(r"Step (\d+): Letter (\d+) is [A-D]\.", line) for line in text.splitlines()]
        steps = [int(line[1]) for line in lines]
        assert steps == [int(line[2]) for line in lines] == list(range(steps[0], steps[-1] + 1))
        assert Reading(prompt).observations[-1] in text
        assert 2 <= len(lines) <= 8


def test_it_can_lose_lines_whenever_it_writes_a_summary():
    """Of the first 8 letters, the share that is left after each summary of a summary."""

    with sp.Episode(ECHO, seed=5) as episode:
        conversation = sp.Conversation(episode)
    first = "\n".join(f"Step {step}: Letter {step} is A." for step in range(8))

    def kept(seed, summaries):
        player, text = sp.get_player("reader", seed=seed, keeps=0.5), first
        player.attach(conversation)
        for _ in range(summaries):
            question = sp.Prompt([{"role": "user", "content": text}], purpose="compaction")
            text = player.reply(question).message["content"]
        return text.splitlines()

    once, twice = ([kept(seed, summaries) for seed in range(100)] for summaries in (1, 2))
    assert 350 < sum(map(len, once)) < 450
    assert 160 < sum(map(len, twice)) < 240
    assert all(set(later) <= set(earlier) for earlier, later in zip(once, twice, strict=True))
    with pytest.raises(sp.InvalidArgumentError, match="from 0 to 1"):
        sp.get_player("reader", keeps=1.5)


def test_numbers_of_steps_count_back_from_the_newest_result_where_nothing_else_tells_them():
    prompt = sp.Prompt(
        [
            {"role": "user", "content": "Your summary:\nStep 0: Letter 0 is A."},
            sp.call("act", action="A"),
            {"role": "tool", "content": "Letter 4 is B.", "tool_call_id": "call_0"},
            sp.call("act", action="C"),
            {"role": "tool", "content": "Letter 5 is C.", "tool_call_id": "call_0"},
        ]
    )
    assert visible(Reading(prompt), 5, {}) == {0: "Letter 0 is A.", 4: "Letter 4 is B.", 5: "Letter 5 is C."}


def test_an_observation_that_was_the_newest_once_is_read_wherever_it_is_quoted():
    prompt = sp.Prompt([{"role": "user", "content": '[{"role": "tool", "content": "Letter 3 is D."}]'}])
    assert visible(Reading(prompt), 5, {"Letter 2 is A.": 2, "Letter 3 is D.": 3}) == {3: "Letter 3 is D."}


def test_a_game_that_does_not_say_what_follows_is_refused():
    with sp.Episode("Hanoi3Disk-v0", seed=1) as episode, pytest.raises(sp.InvalidArgumentError, match="Play random"):
        sp.play(episode, sp.get_player("reader"))
