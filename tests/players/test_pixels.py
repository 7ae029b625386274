"""The player of `experiments/rule_pixels.py` plays from pictures as `rule` plays from words."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.games.crafter.creatures import light
from smartplay_tools.players.prompt_reading import Reading
from smartplay_tools.registry import read_file

FILE = Path(__file__).parents[2] / "experiments" / "rule_pixels.py"
PIXELS = f"{FILE}:RulePixelsPlayer"


pytestmark = pytest.mark.skipif(not FILE.exists(), reason="not in a checkout")

BUDGET = sp.Budget(history=5)


def words_of(prompt):
    """The newest observation of a prompt as the player puts it into words; None if there is none yet."""
    seen = Reading(sp.Prompt(read_file(f"{FILE}:in_words").value(prompt), prompt.tools)).observations
    return seen[-1] if seen else None


def action(message):
    """What a reply plays."""
    [call] = message["tool_calls"]
    return call["function"]["name"], json.loads(call["function"]["arguments"])


def decisions(seed, steps):
    """Of every prompt of an episode that `rule` plays: the step, and what both players decide."""
    rule, pixels = sp.get_player("rule"), sp.get_player(PIXELS)
    with sp.Episode("Crafter-v0", seed=seed, observation="both", budget=BUDGET) as episode:
        conversation = sp.Conversation(episode)
        while (prompt := conversation.prompt()) is not None and episode.stats.steps < steps:
            reply = rule.reply(prompt).message
            yield episode.stats.steps, action(reply), action(pixels.reply(prompt).message)
            conversation.receive(reply)


@pytest.mark.slow
def test_of_a_day_and_a_night_nearly_every_decision_is_the_same():
    pairs = [(words, pixels) for seed in range(2) for _, words, pixels in decisions(seed, 300)]
    assert len(pairs) > 450
    assert sum(words == pixels for words, pixels in pairs) > 0.97 * len(pairs)


@pytest.mark.slow
def test_its_words_are_the_games_by_day():
    with sp.Episode("Crafter-v0", seed=4, observation="picture", budget=BUDGET) as episode:
        conversation = sp.Conversation(episode)
        player = sp.get_player("random", seed=3)
        for _ in range(40):
            prompt = conversation.prompt()
            if (seen := words_of(prompt)) is not None:
                _, _, words = episode.game.observation.partition(".")
                assert light(episode.game._world.steps).daylight > 0.5
                assert seen.strip() == words.strip()
            conversation.receive(player.reply(prompt).message)


def test_it_looks_at_the_border_as_the_words_do():
    with sp.Episode("Crafter-v0", seed=1, observation="picture", budget=BUDGET) as episode:
        conversation = sp.Conversation(episode)
        for _ in range(60):
            prompt = conversation.prompt()
            conversation.receive(sp.call("act", action="Move West"))
        prompt = conversation.prompt()
        assert ("out of the map" in words_of(prompt)) == ("out of the map" in episode.game.observation)


@pytest.mark.slow
@pytest.mark.parametrize("size", [126, 300])
def test_pictures_of_another_size_are_refused_in_a_sentence(size):
    with sp.Episode("Crafter-v0", seed=7, observation="picture", picture_size=size) as episode:
        conversation = sp.Conversation(episode)
        player = sp.get_player(PIXELS)
        conversation.receive(player.reply(conversation.prompt()).message)
        with pytest.raises(sp.InvalidArgumentError, match="picture_size=64 only"):
            player.reply(conversation.prompt())


def test_it_plays_from_pictures_only():
    with (
        sp.Episode("Crafter-v0", seed=7) as episode,
        pytest.raises(sp.InvalidArgumentError, match='rule-pixels does not play from observation="text"'),
    ):
        sp.play(episode, sp.get_player(PIXELS))
