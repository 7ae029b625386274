"""NamedRule: the rule player, which names its world in every reply, so that no two episodes have the same replies."""

from __future__ import annotations

import dataclasses

import smartplay_tools as sp


class NamedRule:
    """The rule player of one world."""

    name = "named rule"

    def __init__(self, *, seed: int) -> None:
        self._words, self._rule = words_of(seed), sp.get_player("rule", seed=seed)

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        """Reply as the rule player does, in words as well."""
        reply = self._rule.reply(prompt)
        return dataclasses.replace(reply, message={**reply.message, "content": self._words})


def words_of(seed: int) -> str:
    """Return what the player of a world says."""
    return f"World {seed}."
