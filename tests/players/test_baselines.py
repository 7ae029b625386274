"""The baselines of one line: each plays the rule in its name, from the observations that its prompt shows."""

from __future__ import annotations

import json

import pytest

import smartplay_tools as sp
from smartplay_tools.players import player_names
from smartplay_tools.types.messages import calls_of

HANDS, MACHINES = "RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0"
BEATS = {"Rock": "Paper", "Paper": "Scissor", "Scissor": "Rock"}
PLAYERS = {"always:2": (HANDS, MACHINES), "win-stay": (HANDS, MACHINES), "leave-after-two": (HANDS, MACHINES)}
PLAYERS |= {"last-hand": (HANDS,), "count-last-5": (HANDS,)}
PLAYED = [(player, game) for player, games in PLAYERS.items() for game in games]


class Watched:
    """Plays as another player does, and keeps each action with the observation that answered it."""

    name = "watched"

    def __init__(self, player: str) -> None:
        self._player, self.actions, self.answers = sp.get_player(player), [], []

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        reply = self._player.reply(prompt)
        calls = calls_of(reply.message)
        self.actions.append(json.loads(calls[0]["function"]["arguments"])["action"] if calls else reply.content)
        if len(self.actions) > 1:
            self.answers.append(str(prompt.messages[-1]["content"]))
        return reply


def expected(player: str, acts: list[str], answers: list[str], legal: tuple[str, ...]) -> str:
    """The rule of each player, written down once more, from everything that has happened."""
    after = {action: legal[(at + 1) % len(legal)] for at, action in enumerate(legal)}
    paid = ["reward 1" in text or "You won" in text for text in answers]
    hands = [text.split("opponent chose ")[1].split(".")[0] for text in answers if "opponent" in text]
    if player == "always:2":
        return legal[1]
    if not acts:
        return legal[0]
    if player == "win-stay":
        return acts[-1] if paid[-1] else after[acts[-1]]
    if player == "leave-after-two":
        leaves = acts[-2:] == [acts[-1]] * 2 and not any(paid[-2:])
        return after[acts[-1]] if leaves else acts[-1]
    counted = hands[-1 if player == "last-hand" else -5 :]
    return BEATS[max(BEATS, key=counted.count)]


@pytest.mark.parametrize(("player", "game"), PLAYED)
def test_a_baseline_plays_its_line(player, game):
    watched = Watched(player)
    with sp.Episode(game, seed=3, budget=sp.Budget(tool_calls=20)) as episode:
        legal, result = episode.game.actions, sp.play(episode, watched)
    assert result.steps == 20
    for at, action in enumerate(watched.actions):
        assert action == expected(player, watched.actions[:at], watched.answers[:at], legal), at


@pytest.mark.parametrize("protocol", ["tools", "paper"])
@pytest.mark.parametrize(("player", "game"), PLAYED)
def test_every_baseline_plays_under_a_cap_and_in_both_protocols(player, game, protocol):
    budget = sp.Budget(prompt_tokens=700, slack=0.5)
    with sp.Episode(game, seed=3, budget=budget) as episode:
        result = sp.play(episode, sp.get_player(player), protocol=protocol)
    assert (result.steps, result.illegal_actions, result.fallback_actions) == (50, 0, 0)


def test_every_game_has_a_baseline_and_each_is_found_by_its_name():
    assert {name.partition(":")[0] for name in PLAYERS} <= set(player_names())
    for game, spec in sp.GAMES.items():
        with sp.Episode(game, seed=1) as episode:
            prompt = sp.Conversation(episode).prompt()
            (call,) = calls_of(sp.get_player(f"always:{episode.game.actions[-1]}").reply(prompt).message)
        assert json.loads(call["function"]["arguments"])["action"] == episode.game.actions[-1], spec.id


@pytest.mark.parametrize(
    ("player", "game", "told"),
    [
        ("always:Lizard", HANDS, "'Lizard' is not an action here; play one of Rock, Paper, Scissor"),
        ("win-stay", "Hanoi3Disk-v0", "win-stay cannot see what an action has paid in this game"),
        ("leave-after-two", "MessengerL1-v0", "leave-after-two cannot see"),
        ("count-last-5", MACHINES, "count-last-5 plays Rock Paper Scissors alone"),
        ("always", HANDS, "The player 'always' cannot be made"),
    ],
)
def test_what_a_baseline_cannot_play_is_one_sentence(player, game, told):
    with sp.Episode(game, seed=1) as episode, pytest.raises(sp.InvalidArgumentError, match=told):
        sp.get_player(player).reply(sp.Conversation(episode).prompt())
