"""The rule players of Crafter: how they read observations, and their scores."""

import json

import pytest

import smartplay_tools as sp
from smartplay_tools.players.prompt_reading import Reading
from smartplay_tools.players.rules.crafter import notes as crafter_notes, player as crafter
from smartplay_tools.players.rules.crafter.home import Home
from smartplay_tools.players.rules.crafter.sight import ANY, BIT, Map, read_frame
from smartplay_tools.players.rules.memory import LINE
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.messages import Message

TEXT = """You took action move_north.

You see:
- water 5 steps to your south-west
- grass 1 steps to your west
- tree 3 steps to your north
- cow 2 steps to your south-east

You face tree at your front.

Your status:
- health: 9/9
- food: 8/9
- drink: 7/9
- energy: 9/9

Your inventory:
- wood: 2"""


class RulesPlayer:
    """A player by the rules of one module."""

    def __init__(self, rules: object) -> None:
        self.name = rules.__name__
        self._decide = rules.decide
        self.replies: list[Message] = []

    def reply(self, prompt: Prompt) -> Reply:
        self.replies.append(self._decide(Reading(prompt)))
        return Reply(self.replies[-1])


def play(rules: object, seed: int, **options: object) -> tuple[sp.EpisodeResult, RulesPlayer]:
    player = RulesPlayer(rules)
    with sp.Episode("Crafter-v0", seed=seed, **options) as episode:
        return sp.play(episode, player), player


def test_a_frame_is_read() -> None:
    frame = read_frame(TEXT)
    assert frame.nearest["cow"] == (2, 1, 1)
    assert frame.cells("cow") == ((1, 1),)
    assert frame.cells("tree") == ((0, -3),)
    assert frame.cells("water") == ((-4, 1), (-3, 2), (-2, 3))
    assert (frame.faced, frame.amounts["drink"], frame.amounts["wood"]) == ("tree", 7, 2)
    assert not frame.asleep


def notes_in(text: str) -> crafter_notes.CrafterNotes | None:
    match = LINE.search(text)
    return crafter_notes.notes_of(json.loads(match[1])) if match else None


def test_notes_are_read_as_they_were_written() -> None:
    own_map = Map(
        at=(3, -2), facing="Move East", kinds={(3, -1): BIT["water"], (9, 9): ANY}, visited=[(2, -2), (3, -2)]
    )
    notes = crafter_notes.CrafterNotes(own_map, 17, False, Home(1, 2, 3, 2, "Move West"), goal=(5, 5))
    assert notes_in("Some words.\n" + notes.text()) == notes
    assert notes_in("No notes.") is None


def test_the_player_without_notes_writes_nothing_down() -> None:
    result, player = play(crafter, 3, budget=sp.Budget(tool_calls=40))
    assert result.end_reason == "tool_calls"
    assert result.illegal_actions == result.malformed_calls == 0
    assert not any(reply["content"] for reply in player.replies)


def test_the_player_with_notes_keeps_them_in_its_replies() -> None:
    _, player = play(crafter_notes, 3, budget=sp.Budget(tool_calls=40))
    notes = [notes_in(reply["content"]) for reply in player.replies[1:]]
    assert [note.clock for note in notes] == list(range(1, 40))


@pytest.mark.slow
def test_without_notes_the_paper_s_window_is_enough_to_beat_its_models() -> None:
    """The better of them has 846."""
    scores = [play(crafter, seed)[0].score for seed in range(10)]
    assert sum(scores) / len(scores) > 2000


@pytest.mark.slow
def test_notes_let_a_player_live_for_ever() -> None:
    result, *_ = play(crafter_notes, 4, budget=sp.Budget(tool_calls=3_000))
    assert result.end_reason == "tool_calls", "the calls are spent before the player dies"
    assert result.score > 30_000
    assert json.dumps(result.model_dump())
