"""The tools of memory in lively play, with everything that can be combined with them: each answer is judged."""

from __future__ import annotations

import random

import pytest

import smartplay_tools as sp
from smartplay_tools.episode.budgets import refused_strategy
from tests import checker, scripts

WORDS = scripts.Words()


def lively_budget(chance: random.Random, game: str) -> sp.Budget:
    size = scripts.head_tokens(game, WORDS, host=False)
    while True:
        drawn = {
            "recall_tokens": chance.choice([None, 9, 40, 120, 400]),
            "beyond_result": chance.choice(["cut", "offload"]),
            "notes_tokens": chance.choice([None, 12]),
            "memory_tokens": chance.choice([None, 20, 80]),
            "beyond_history": chance.choice(["drop", "mask"]),
            "summary_tokens": chance.choice([None, None, 20]),
            "own_words": chance.choice([None, 2]),
            "first_turns": chance.choice([None, 2]),
            "result_tokens": chance.choice([None, 12, 16, 40]),
        }
        budget = sp.Budget(
            **drawn,
            history=chance.choice([None, 1, 3, 8]),
            prompt_tokens=chance.choice(
                [None, size + scripts.strategy_tokens(drawn, WORDS) + chance.randrange(200, 900)]
            ),
            slack=chance.choice([0, 0.5]),
            stalled_turns=None,
            tool_calls=None,
        )
        if refused_strategy(budget, sp.GAMES[game], context="window") is None:
            return budget


def judged_episode(seed: int) -> tuple[scripts.Played, dict[str, int]]:
    chance = random.Random(f"lively {seed}")
    game = chance.choice(scripts.GAMES)
    played = scripts.converse(
        game, scripts.lively_script(chance), seed=seed, budget=lively_budget(chance, game), tokenizer=WORDS
    )
    whole = scripts.whole_observations(played.events)
    checker.check_episode(played.events, played.sent, WORDS.count, whole=whole)
    return played, {"recalls": played.result.recalls, "pages": played.result.pages}


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 58), marks=pytest.mark.slow)])
def test_every_answer_is_what_the_definition_says(seeds):
    counts = [judged_episode(seed)[1] for seed in seeds]
    assert sum(count["recalls"] for count in counts) > 20
    assert sum(count["pages"] for count in counts) > 3
