"""Prompts and answers are those of a model that was written from the documentation alone.

`python -m tests.model_from_docs --prompts 100000` compares more of them.
"""

from pathlib import Path

import pytest

import smartplay_tools as sp
from tests.model_from_docs.carrying import play_chains
from tests.model_from_docs.play import Counts, play, replay_is_identical

pytestmark = pytest.mark.slow


def test_prompts_answers_and_counters_are_those_of_the_model() -> None:
    counts, seed = Counts(), 10
    while counts.prompts < 400:
        record = play(seed, counts)
        if record and record[0]["config"]["game"] in sp.GAMES and seed % 8 == 0:
            assert replay_is_identical(record)
        seed += 1
    assert len(counts.strategies) == 9
    assert counts.requests > 0
    assert counts.refused > 0


def test_a_trial_begins_with_what_the_one_before_it_left(tmp_path: Path) -> None:
    assert sum(play_chains(seed, tmp_path / str(seed)) for seed in (3, 4, 6, 8)) > 0
