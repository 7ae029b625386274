"""Fitted prompts of random conversations, judged by the definition; `tests.manager.fuzz` draws a million of them."""

from __future__ import annotations

from collections import Counter

from tests.manager.fuzz import some


def test_no_prompt_of_a_random_conversation_has_a_fault():
    rows, found = some(0, 150, seed=6)
    assert not found, found[0]
    wanted = Counter(
        {
            "prompts": 150,
            "with cuts": 15,
            "repaired": 15,
            "with summaries": 10,
            "compared with the definition": 10,
            "with rewritten messages": 10,
        }
    )
    assert rows >= wanted
