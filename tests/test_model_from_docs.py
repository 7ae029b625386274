"""Prompts and answers are those of a model that was written from the documentation alone.

`python -m tests.model_from_docs --prompts 100000` compares more of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context import ContextWindow
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.records.prompts import recorded_turns, sent_prompts
from smartplay_tools.transcript import Event
from tests import scripts
from tests.model_from_docs.carrying import play_chains
from tests.model_from_docs.play import FOREIGN, SMALL, Counts, play, tokenizer_of


def check_that_prompts_depend_on_turns_alone(record: Sequence[Event]) -> None:
    """Compare prompts with those of a window that was never asked for the prompts before them.

    A summary is a part of the state of a window, and a custom strategy may remember what it has chosen.
    """
    config, recorded = EpisodeConfig.from_event(record[0]), recorded_turns(record)
    if config.budget.summary_tokens is not None or config.budget.strategy is not None:
        return
    [head] = [event for event in record if event["event"] == "head"]
    with sp.Episode.from_config(config, tokenizer=tokenizer_of(record)) as episode:
        tools = [*episode.tools, *[FOREIGN] * (len(head["tools"]) > len(episode.tools))]
        about: Any = (head["messages"], tools, episode.budget, episode.counter)
        for sent in list(sent_prompts(record))[::7]:
            view = ContextWindow.of(recorded[: sent.turn], *about).view()
            assert view.messages == sent.prompt.messages


@pytest.mark.parametrize(
    ("seeds", "games"),
    [
        (range(10, 22), SMALL),
        (range(4, 6), ["Crafter-v0"]),
        pytest.param(range(22, 90), SMALL, marks=pytest.mark.slow),
        pytest.param(range(6, 40), ["Crafter-v0"], marks=pytest.mark.slow),
    ],
)
def test_prompts_answers_and_counters_are_those_of_the_model(seeds: Sequence[int], games: Sequence[Any]) -> None:
    """Also with pictures. The records replay, are continued, and say where every token went."""
    counts = Counts()
    for seed in seeds:
        record = play(seed, counts, games)
        if recorded_turns(record) and record[0]["config"]["game"] in sp.GAMES:
            scripts.check_record(scripts.as_json(record), tokenizer_of(record))
            check_that_prompts_depend_on_turns_alone(record)
    assert counts.prompts > 9 * len(seeds)
    if len(seeds) > 20:
        assert counts.refused > 0
        assert len(counts.strategies) >= 9


@pytest.mark.slow
def test_a_trial_begins_with_what_the_one_before_it_left(tmp_path: Path) -> None:
    assert sum(play_chains(seed, tmp_path / str(seed)) for seed in (3, 4, 6, 8)) > 0
