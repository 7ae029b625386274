"""The edits of providers as strategies of the window, under the providers' names."""

from __future__ import annotations

from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.records import replay
from tests import provider_edits_judge

GAME = "RockPaperScissorDifferentScore-v0"


def test_edits_are_right_to_the_token() -> None:
    """A small part of `python -m tests.provider_edits_judge`."""
    found = provider_edits_judge.main(600, seed=10**6)
    cleared = [f"cleared by {kind}" for kind in (provider_edits_judge.USES, provider_edits_judge.THINKING)]
    assert all(found[kind] > 0 for kind in (*cleared, "cleared by context_management", "summaries", "cut to the cap"))


@pytest.mark.parametrize(
    "strategy",
    [
        "clear_tool_uses_20250919:trigger=900,keep=2,clear_at_least=50",
        'clear_tool_uses_20250919:trigger=tool_uses=5,exclude_tools="observe",clear_tool_inputs=["act"]',
        "compact_20260112:trigger=900,instructions=Say what matters.",
        "compaction:compact_threshold=900",
    ],
)
def test_a_game_under_an_edit_replays(strategy: str, tmp_path: Path) -> None:
    record = tmp_path / "record.jsonl"
    budget = sp.Budget(history=None, prompt_tokens=1500, question_tokens=4000, strategy=strategy)
    with sp.Episode(GAME, seed=1, budget=budget, transcript=record) as episode:
        result = sp.play(episode, sp.get_player("rule-notes"))
    assert result.rewrites > 0
    assert result.tokens.prompt > 0
    assert bool(result.questions) == ("compact" in strategy)
    assert replay(record).identical


class Thinking:
    """Thinks before each call, and every third time forgets to call."""

    name = "thinking"

    def __init__(self) -> None:
        self.count, self.thoughtful = 0, list[bool]()

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        self.count += 1
        self.thoughtful = ["reasoning_content" in each for each in prompt.messages if each["role"] == "assistant"]
        message = sp.call("act", action="1") if self.count % 3 else {"role": "assistant", "content": "Rock, I think."}
        return sp.Reply({**message, "reasoning_content": f"He has played Paper {self.count} times."})


USES = '{"type":"clear_tool_uses_20250919","trigger":{"type":"tool_uses","value":5}}'
BOTH = f'context_management:edits=[{{"type":"clear_thinking_20251015"}},{USES}]'


@pytest.mark.parametrize("strategy", ["clear_thinking_20251015:keep=2", BOTH])
@pytest.mark.parametrize("cap", [None, 1000])
def test_a_game_without_old_thoughts_replays(strategy: str, cap: int | None, tmp_path: Path) -> None:
    record = tmp_path / "record.jsonl"
    budget = sp.Budget(history=None, prompt_tokens=cap, strategy=strategy)
    with sp.Episode(GAME, seed=1, budget=budget, transcript=record) as episode:
        result = sp.play(episode, player := Thinking())
    assert result.rewrites > 0
    assert replay(record).identical
    assert player.thoughtful[-1]
    assert not player.thoughtful[0]


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
