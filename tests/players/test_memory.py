"""The memory of `rule-notes`: one text for a game, in its own words, in notes, or in summaries."""

from __future__ import annotations

import json
from statistics import mean

import pytest

import smartplay_tools as sp
from smartplay_tools.players.prompt_reading import Reading
from smartplay_tools.players.rules import memory

BANDIT, RPS = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0"


def play(game: str, seed: int, *, words: bool, **budget: object) -> tuple[sp.EpisodeResult, list[dict]]:
    events: list[dict] = []
    with sp.Episode(game, seed=seed, transcript=events, budget=sp.Budget(**budget)) as episode:  # type: ignore[arg-type]
        result = sp.play(episode, sp.get_player("rule-notes", words=words))
    return result, events


def actions(events: list[dict]) -> list[str]:
    return [event["arguments"] for event in events if event["event"] == "call" and event["name"] == "act"]


@pytest.mark.parametrize("game", [BANDIT, pytest.param(RPS, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("words", "budget"),
    [
        (True, {"prompt_tokens": 700}),
        (False, {"prompt_tokens": 700, "notes_tokens": 200}),
        (False, {"prompt_tokens": 1_000, "memory_tokens": 100}),
        (False, {"prompt_tokens": 700, "summary_tokens": 100, "slack": 0.5}),
        (False, {"prompt_tokens": 750, "summary_tokens": 100, "notes_tokens": 200, "slack": 0.5}),
    ],
)
def test_with_any_channel_it_plays_under_a_cap_as_in_full_context(game, words, budget):
    full, all_events = play(game, 3, words=False, history=None)
    capped, events = play(game, 3, words=words, history=None, **budget)
    assert actions(events) == actions(all_events)
    assert capped.score == full.score
    assert capped.refused_notes == 0
    assert capped.tokens.prompt < full.tokens.prompt


class Tells:
    """Shows what has left as lines of a text, as many of the newest as fit."""

    def __init__(self) -> None:
        self._lines: dict[int, str] = {}

    def choose(self, past, room):
        newest = past.turns[-1]
        for message in newest.messages:
            if message["role"] == "tool" and "the opponent chose" in str(message["content"]):
                self._lines[newest.number] = f"Step {newest.step}: {message['content'].splitlines()[0]}"
        lines = [line for number, line in self._lines.items() if number < newest.number]
        while lines and past.text_tokens("\n".join(lines)) > room:
            del lines[0]
        return sp.Choice([], texts={newest.number: "\n".join(lines)} if lines else {})


def test_it_reads_the_observations_that_a_strategy_writes():
    sp.register_strategy("tells", Tells)

    def score(strategy: str | None) -> float:
        budget = {"history": None, "prompt_tokens": 700, "strategy": strategy}
        return mean(play(RPS, seed, words=False, **budget)[0].score for seed in range(3))

    assert score("tells") > score(None) + 3


@pytest.mark.slow
def test_with_any_channel_it_plays_messenger_as_with_all_that_it_uses_in_the_window():
    game, seed = "MessengerL2-v0", 6
    _, seen = play(game, seed, words=False, history=3)
    _, unseen = play(game, seed, words=False, history=0)
    _, spoken = play(game, seed, words=True, history=0)
    _, noted = play(game, seed, words=False, history=0, notes_tokens=200)
    _, summed = play(game, seed, words=False, history=5, prompt_tokens=900, summary_tokens=200, slack=0.5)
    assert actions(unseen) != actions(seen)
    assert actions(spoken) == actions(noted) == actions(summed) == actions(seen)


def test_messenger_keeps_fewer_observations_where_notes_are_short():
    result, events = play("MessengerL2-v0", 6, words=False, history=0, notes_tokens=60)
    assert result.refused_notes == 0
    kept = [json.loads(event["arguments"])["text"] for event in events if event.get("name") == "take_notes"]
    lengths = {len(json.loads(text.removeprefix("Notes: "))["views"]) for text in kept}
    assert max(lengths) == 1


def test_a_summary_of_rule_says_what_it_sees_and_is_of_no_use_to_it():
    events: list[dict] = []
    budget = sp.Budget(history=None, prompt_tokens=600, summary_tokens=60, slack=0.5)
    with sp.Episode(BANDIT, seed=3, transcript=events, budget=budget) as episode:
        result = sp.play(episode, sp.get_player("rule"))
    assert result.summaries > 2
    assert "I keep no memory" in next(event["text"] for event in events if event["event"] == "summary")


def test_the_memory_that_covers_most_is_read_wherever_it_stands():
    def seen(*messages: sp.Message) -> memory.Memory:
        return memory.recall(Reading(sp.Prompt(list(messages), ())))

    old: sp.Message = {"role": "user", "content": f"Your summary:\n{memory.line({'clock': 3})}"}
    new = {"role": "assistant", "content": f"So far.\n{memory.line({'clock': 9})}"}
    noted = memory.noted({"role": "assistant", "content": None}, memory.line({"clock": 5}))
    assert seen().facts is None
    assert seen(old).facts == {"clock": 3}
    assert seen(old, noted).facts == {"clock": 5}
    assert seen(old, new, noted).facts == {"clock": 9}  # type: ignore[arg-type]
    assert seen({"role": "assistant", "content": 'Notes: {"clock": "late"}'}).facts is None


def test_crafter_keeps_a_smaller_map_where_notes_are_short():
    result, events = play("Crafter-v0", 3, words=False, tool_calls=40, notes_tokens=300)
    assert result.refused_notes == 0
    kept = [event for event in events if event["event"] == "call" and event["name"] == "take_notes"]
    assert len(kept) > 10
    assert all(event["data"]["notes"] == "kept" for event in kept)
