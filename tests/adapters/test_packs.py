"""The packs of games of POPGym and MiniGrid: `.ci/run` has an environment with their packages."""

from __future__ import annotations

import dataclasses
import random
from typing import Any

import gymnasium
import pytest

import smartplay_tools as sp
from smartplay_tools.episode.episode import Episode
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.exports import export
from smartplay_tools.evaluation.pages.report.page import write_report
from smartplay_tools.games.base import TextGame
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records import replay
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.testing import CHECKS
from smartplay_tools.testing.game_checks import is_the_same_in_another_process as is_alike_elsewhere
from smartplay_tools.transcript import read_transcript
from tests.adapters import conformance
from tests.adapters.rows import FRAMEWORKS, QUICK, rows
from tests.evaluation.command import shown_by

POPGYM = [game for game in GAMES if game.startswith("popgym-")]
MINIGRID = [game for game in GAMES if game.startswith("minigrid-")]
PACKED = [*POPGYM, *MINIGRID]
if not PACKED:
    pytest.skip("needs popgym or minigrid; `.ci/run` has an environment with them", allow_module_level=True)

FAST = [game for game in PACKED if any(part in game for part in ("Easy", "MemoryS7", "LockedRoom", "GoToLocal"))]
"""One size of each family."""
CONTRACT = [(game, check) for game in PACKED for check in CHECKS if game in FAST or check is not is_alike_elsewhere]
"""Another process, which takes long, plays one size of each family."""
K4 = "popgym-RepeatPreviousEasy-v0"

needs_popgym = pytest.mark.skipif(not POPGYM, reason="needs popgym")
needs_minigrid = pytest.mark.skipif(not MINIGRID, reason="needs minigrid")


def play(game: str, player: str = "reader", seed: int = 3, transcript: Any = None, **budget: Any) -> sp.EpisodeResult:
    with Episode(game, seed=seed, budget=sp.Budget(**budget), transcript=transcript) as episode:
        return sp.play(episode, sp.get_player(player, seed=seed))


@pytest.mark.parametrize(("game", "check"), CONTRACT)
def test_it_keeps_the_contract_of_games(game, check):
    check(game)


@pytest.mark.parametrize("game", [game for game in POPGYM if "RepeatFirstHard" not in game])  # of 830 turns
def test_who_sees_everything_makes_no_mistake_that_seeing_avoids(game):
    result = play(game, history=None)
    assert result.completed
    if "Concentration" not in game:  # there the first cards are turned at random
        assert result.score == pytest.approx(1)


@needs_popgym
@pytest.mark.parametrize("k", [2, 8, 24])
def test_the_score_jumps_where_the_window_holds_k_less_one_past_steps(k):
    spec = sp.GameSpec(
        id=f"Repeat{k}-v0", family="popgym", entry_point="smartplay_popgym.cards:RepeatPrevious", history=0, rollout=51,
        trials=5, kwargs={"decks": 1, "k": k}, score_bounds=(-1, 1), memory=k - 1,
    )  # fmt: skip
    assert play(spec, history=k - 1).score == pytest.approx(1)
    assert play(spec, history=k - 2).score < 0.5


@pytest.mark.parametrize("game", [game for game in POPGYM if game in FAST])
def test_the_observations_that_an_action_needs_are_enough_to_play_it_rightly(game):
    made, chance, texts = GAMES[game].make(), random.Random(0), {}
    text, _ = made.reset(seed=5)
    ended = False
    while not ended:
        texts[len(texts)] = text
        newest, needs = max(texts), made.needs
        assert set(needs) <= set(texts)
        right = made.right_actions({step: texts[step] for step in {*needs, newest}}, made.actions)
        action = chance.choice(right or made.actions)
        text, reward, terminated, truncated = made.advance(made.actions.index(action))
        ended = terminated or truncated
        assert right or not needs
        assert reward > 0 or not needs or "Concentration" in game  # there a pair takes two actions
    assert made.score > 0


@pytest.mark.parametrize("game", [game for game in FAST if "Concentration" in game])
def test_what_breaks_the_rules_gains_nothing(game):
    made, chance = GAMES[game].make(), random.Random(0)
    made.reset(seed=5)
    for _ in range(60):
        action = chance.randrange(len(made.actions))
        breaks = action in made.breaks
        _, reward, terminated, truncated = made.advance(action)
        assert reward <= 0 or not breaks
        if terminated or truncated:
            break


@pytest.mark.parametrize("game", FAST)
def test_a_record_is_replayed_and_what_the_game_declares_is_never_shown(game, tmp_path):
    result = play(game, "random", transcript=tmp_path / "episode.jsonl", prompt_tokens=3_000)
    assert result.versions["popgym" if game.startswith("popgym") else "minigrid"]
    assert replay(tmp_path / "episode.jsonl").identical
    events = read_transcript(tmp_path / "episode.jsonl")
    acts = [event["data"] for event in events if event["event"] == "call" and event["name"] == "act"]
    assert any("needs" in data or "breaks" in data for data in acts) == (game.startswith("popgym"))
    prompts = "".join(str(sent.prompt) for sent in sent_prompts(events))
    assert "'needs'" not in prompts
    assert "'breaks'" not in prompts


@needs_popgym
def test_the_notes_the_summary_and_the_file_of_the_reader_hold_what_the_window_lost():
    plain = play("popgym-CountRecallEasy-v0", history=None, prompt_tokens=1_500)
    assert plain.score < 0.5
    for kept in ({"notes_tokens": 1_000}, {"memory_tokens": 1_200}, {"summary_tokens": 1_000, "slack": 0.5}):
        room = {"prompt_tokens": 4_000} if "summary_tokens" not in kept else {"prompt_tokens": 2_400}
        result = play("popgym-CountRecallEasy-v0", history=2 if "summary_tokens" not in kept else None, **room, **kept)
        assert result.score == pytest.approx(1), kept
        assert result.refused_notes == result.refused_memory == result.cut_summaries == 0


@needs_popgym
def test_the_reader_says_which_games_it_cannot_play():
    with pytest.raises(sp.SmartPlayError, match="cannot play Hanoi3Disk-v0"):
        play("Hanoi3Disk-v0")


@needs_popgym
def test_the_games_are_listed_and_are_environments_of_gymnasium():
    listed = shown_by("games", "--json")
    assert all(f'"{game}"' in listed for game in PACKED)
    made = gymnasium.make(f"smartplay/{K4}")
    assert isinstance(made.unwrapped, TextGame)
    assert made.reset(seed=1)[0].startswith("Card 1 is ")


@needs_popgym
def test_a_run_of_them_is_summarised_shown_and_exported(tmp_path):
    run = sp.evaluate([K4], ["reader", "random"], out=tmp_path / "run", trials=3, executor="inline")
    reader, guesses = summarize(run.rows).cells
    assert reader.score.mean == pytest.approx(1)
    assert reader.completion.mean == 1
    assert guesses.score.mean < 0.5
    assert guesses.normalized_score is None
    assert K4 in write_report([tmp_path / "run"], tmp_path / "page.html").read_text(encoding="utf-8")
    assert export(tmp_path / "run", tmp_path / "sft").counts["episodes"] == 6


@needs_popgym
def test_the_game_cannot_tell_adapters_apart():
    script = [conformance.calling(("act", {"action": suit})) for suit in ("Spades", "Hearts", "Clubs", "Diamonds") * 3]
    spec, answers = dataclasses.replace(GAMES[K4], rollout=12), {}
    window, _ = rows((*QUICK, *FRAMEWORKS))
    for name, row in window.items():
        if not row.slow:
            events: list[Any] = []
            with Episode(spec, seed=3, budget=sp.Budget(history=2), transcript=events) as episode:
                row.hold(episode, script)
            answers[name] = [(e["text"], e["data"]) for e in events if e["event"] == "call"]
    assert len(answers["Conversation"]) == 12
    assert answers == dict.fromkeys(answers, answers["Conversation"])


@needs_minigrid
def test_observations_can_be_pictures_and_are_replayed(tmp_path):
    with Episode("minigrid-MemoryS7-v0", seed=3, observation="picture", transcript=tmp_path / "e.jsonl") as episode:
        sp.play(episode, sp.get_player("random", seed=3))
    assert any("picture" in event.get("data", {}) for event in read_transcript(tmp_path / "e.jsonl"))
    assert replay(tmp_path / "e.jsonl").identical


@needs_minigrid
def test_nothing_is_printed_where_a_server_may_answer(capfd):
    game = GAMES["minigrid-GoToLocal-v0"].make()
    for seed in range(20):
        game.reset(seed=seed)
    assert capfd.readouterr().out == ""
