"""The worlds of every seed stay what they are, in every setting."""

from __future__ import annotations

import json

import pytest

from tests.worlds import FILE, cases, digest

PINNED = json.loads(FILE.read_text(encoding="ascii"))


def test_every_setting_is_pinned():
    assert sorted((setting, int(seeds)) for setting, of in PINNED.items() for seeds in of) == sorted(cases())


@pytest.mark.parametrize(
    ("setting", "seeds"),
    [
        pytest.param(setting, seeds, marks=[pytest.mark.slow] if "Minedojo" in setting and seeds > 2 else [])
        for setting, seeds in cases()
    ],
)
def test_no_draw_has_changed(setting: str, seeds: int):
    assert digest(setting, seeds) == PINNED[setting][str(seeds)], (
        f"the worlds of {setting} have changed for every seed: if that is meant, run `python -m tests.worlds`, and say "
        "so in CHANGELOG.md"
    )
