"""The players `first` and `oracle`, which are a lower and an upper bound."""

from __future__ import annotations

import json

import pytest

import smartplay_tools as sp
from smartplay_tools.games import hanoi
from smartplay_tools.records.replays import replay
from smartplay_tools.types.messages import calls_of

WITH_AN_ORACLE = [name for name, spec in sp.GAMES.items() if spec.family in ("bandit", "rock_paper_scissors", "hanoi")]
PROTOCOLS = ["tools", "paper"]


def play(game: str, player: str, seed: int = 0, protocol: str = "tools", **options: object) -> sp.EpisodeResult:
    with sp.Episode(game, seed=seed, **options) as episode:
        return sp.play(episode, sp.get_player(player), protocol=protocol)


@pytest.mark.parametrize("game", sp.GAMES)
def test_first_plays_the_first_action_by_name(game):
    with sp.Episode(game, seed=3) as episode:
        prompt = sp.Conversation(episode).prompt()
        (call,) = calls_of(sp.get_player("first").reply(prompt).message)
        assert json.loads(call["function"]["arguments"]) == {"action": episode.game.actions[0]}


@pytest.mark.parametrize("game", ["BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"])
def test_first_is_what_the_original_falls_back_to(game):
    """In the paper's protocol it scores as much as a player that never names an action."""
    silent = sp.ScriptedPlayer([{"role": "assistant", "content": "Hm."}] * 200)
    with sp.Episode(game, seed=5) as episode:
        fallback = sp.play(episode, silent, protocol="paper")
    first = play(game, "first", seed=5, protocol="paper")
    assert (first.state_hash, first.score, first.fallback_actions) == (fallback.state_hash, fallback.score, 0)
    assert play(game, "first", seed=5).state_hash == first.state_hash


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("game", [game for game in WITH_AN_ORACLE if "Hanoi" not in game])
def test_the_oracle_takes_the_optimal_action_at_every_step(game, protocol):
    for seed in range(3):
        result = play(game, "oracle", seed, protocol)
        assert result.score == result.steps == 50


@pytest.mark.parametrize("disks", [3, 4])
def test_hanoi_s_shortest_way_is_the_shortest_from_everywhere(disks):
    """Against distances found by flooding the state space from the goal."""
    distance = {hanoi.goal(disks): 0}
    border = [hanoi.goal(disks)]
    while border:
        border = [
            after
            for rods in border
            for source, target in hanoi.MOVES
            if hanoi.is_legal(rods, source, target)
            and (after := hanoi.move(rods, source, target)) not in distance
            and distance.setdefault(after, distance[rods] + 1)
        ]
    assert len(distance) == 3**disks
    for rods, steps in distance.items():
        first = hanoi.shortest(rods)
        assert (first is None) == (steps == 0)
        if first is not None:
            assert distance[hanoi.move(rods, *first)] == steps - 1


def test_what_the_oracle_knows_stands_in_result_and_record(tmp_path):
    record = tmp_path / "oracle.jsonl"
    result = play("Hanoi3Disk-v0", "oracle", transcript=record)
    assert result.deviations["player"]["played"].startswith("privileged")
    assert "player" not in play("Hanoi3Disk-v0", "rule").deviations
    assert [event["event"] for event in sp.read_transcript(record)].count("reveal") == 1
    replayed = replay(record)
    assert replayed.identical, replayed.differences
    assert replayed.result == result


async def test_the_oracle_sits_down_on_an_event_loop_as_well():
    with sp.Episode("BanditTwoArmedLowLowFixed-v0", seed=1) as episode:
        result = await sp.aplay(episode, sp.get_player("oracle"))
    assert result.score == 50


@pytest.mark.parametrize("game", ["Crafter-v0", "MessengerL1-v0", "MinedojoCreative0-v0"])
def test_where_no_optimum_is_known_the_oracle_says_so(game):
    with pytest.raises(sp.InvalidArgumentError, match=f"No optimum is known for {game}"):
        play(game, "oracle")


def test_an_oracle_that_was_shown_nothing_says_so():
    with sp.Episode("Hanoi3Disk-v0", seed=0) as episode:
        prompt = sp.Conversation(episode).prompt()
    with pytest.raises(sp.InvalidArgumentError, match="must be attached to a conversation"):
        sp.get_player("oracle").reply(prompt)
