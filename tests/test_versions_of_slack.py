"""Version 3 of the prompts moves a window with slack on a grid: what it changes, and what stays as it was."""

from __future__ import annotations

import hashlib
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context.prompts.wording import versions
from smartplay_tools.episode.cells import cell_config
from tests import scripts
from tests.test_accounts import BANDIT, Talker

OF_THE_FOLD: dict[str, tuple[dict[str, Any], str]] = {
    "cap": ({"history": None, "prompt_tokens": 900}, "ea85358487e6906f"),
    "history": ({"history": 6}, "dfb8c7416e668030"),
    "both": ({"history": 10, "prompt_tokens": 700}, "826bb918d6b41dee"),
    "masking": ({"history": 6, "prompt_tokens": 900, "beyond_history": "mask"}, "6a15143a7e2a61d3"),
    "notes": ({"history": 8, "prompt_tokens": 1_000, "notes_tokens": 60}, "1c8c43a2ed47008f"),
    "words": ({"history": None, "prompt_tokens": 900, "own_words": 4, "first_turns": 2}, "570c8048c8a6b49a"),
    "summary": ({"history": None, "prompt_tokens": 900, "summary_tokens": 60}, "f349dd7d7c3da922"),
}
"""Budgets, and the sha256 of all prompts of three episodes under each, as a release with version 2 made them."""


def played(budget: dict[str, Any], version: str, game: str = BANDIT) -> list[Any]:
    events: list[Any] = []
    config = cell_config(sp.GAMES[game], budget=sp.Budget(**budget)).with_seed(3)
    with sp.Episode.from_config(config.model_copy(update={"prompts": version}), transcript=events) as episode:
        sp.play(episode, Talker())
    return events


def sha256s(events: list[Any]) -> list[str]:
    return [event["sha256"] for event in events if event["event"] == "view"]


@pytest.mark.parametrize("version", ["v1", "v2"])
@pytest.mark.parametrize("name", OF_THE_FOLD)
def test_records_of_earlier_versions_go_on_by_the_fold(name, version):
    budget, sha256 = OF_THE_FOLD[name]
    made = [played({**budget, "slack": slack}, version) for slack in (0.25, 0.5, 1.0)]
    assert hashlib.sha256("".join(map("".join, map(sha256s, made))).encode()).hexdigest()[:16] == sha256
    assert sha256s(made[1]) != sha256s(played({**budget, "slack": 0.5}, versions()[-1]))
    for events in made:
        scripts.check_record(events)
        player = Talker()
        with sp.resume(events[: len(events) // 2], transcript=(further := [])) as resumed:
            player.turn = resumed.episode.stats.turns - 1
            while (prompt := resumed.conversation.prompt()) is not None:
                resumed.conversation.receive(player.reply(prompt).message)
        assert further[0]["config"]["prompts"] == version
        assert sha256s(further) == sha256s(events)
