"""The edits of providers as strategies of the window, under the providers' names."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from tests import provider_edits_judge

GAME = "RockPaperScissorDifferentScore-v0"


def test_edits_are_right_to_the_token() -> None:
    """A small part of `python -m tests.provider_edits_judge`."""
    found = provider_edits_judge.main(600, seed=10**6)
    cleared = [f"cleared by {kind}" for kind in (provider_edits_judge.USES, provider_edits_judge.THINKING)]
    assert all(found[kind] > 0 for kind in (*cleared, "cleared by context_management", "summaries", "cut to the cap"))


@pytest.mark.parametrize(
    ("strategy", "words"),
    [
        ("clear_tool_uses_20250919:keep=-1", "keep=-1 of clear_tool_uses_20250919 has to be tool_uses=N"),
        ("clear_tool_uses_20250919:keep=input_tokens=3", "has to be tool_uses=N"),
        ("clear_tool_uses_20250919:trigger=true", "has to be input_tokens=N or tool_uses=N"),
        ("clear_tool_uses_20250919:trigger=tool_uses=many", "has to be input_tokens=N or tool_uses=N"),
        ("clear_tool_uses_20250919:clear_at_least=tool_uses=3", "has to be input_tokens=N"),
        ("clear_tool_uses_20250919:exclude_tools=3", "has to be the name of a tool"),
        ("clear_tool_uses_20250919:clear_tool_inputs=3", "has to be the name of a tool"),
        (
            "clear_thinking_20251015:keep=0",
            "has to be thinking_turns=N, with N at least 1",
        ),
        ("clear_thinking_20251015:keep=tool_uses=2", "has to be thinking_turns=N"),
        ("context_management:edits=3", "should be an object with a list of edits"),
        ('context_management:edits=[{"type":"compact_20260112"}]', "does not match any of 'clear_tool_uses_20250919'"),
        ('context_management:edits=[{"type":"clear_tool_uses_20250919","keeps":3}]', "edits.0.keeps: Extra inputs"),
        (
            'context_management:edits=[{"type":"clear_tool_uses_20250919"},{"type":"clear_thinking_20251015"}]',
            "must be first in",
        ),
        ("compact_20260112:trigger=tool_uses=3", "has to be input_tokens=N"),
        ("compact_20260112:trigger=0", "with N at least 1"),
        ("compact_20260112:instructions=", "are a text"),
        ("compact_20260112:pause_after_compaction=true", "cannot pause here"),
        ("compaction", "needs compact_threshold=N"),
        ("compaction:compact_threshold=0.5", "has to be input_tokens=N"),
        ("compaction:keep=3", "cannot be made with these options"),
    ],
)
def test_impossible_parameters_are_refused(strategy: str, words: str) -> None:
    with pytest.raises(sp.InvalidArgumentError, match=words):
        sp.Episode(GAME, seed=1, budget=sp.Budget(history=None, strategy=strategy))
