"""The player `rule-pixels`: reads the pictures of the prompt and then plays as `rule` does.

It shows that a picture says what the words say: by day it plays the same actions. It looks at pictures only, even where
words are sent with them. `docs/pictures.md` says what a picture of Crafter cannot say.
"""

from __future__ import annotations

from dataclasses import replace

from smartplay_tools.context.prompts import GAME_IS_OVER
from smartplay_tools.players.crafter_pixels import texts_of
from smartplay_tools.players.rule import RulePlayer
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.messages import Message, pictures_of, text_of


class RulePixelsPlayer(RulePlayer):
    """Plays Crafter by the rules of `rule`, from the pixels of its pictures."""

    name = "rule-pixels"
    observations = ("picture", "both")

    def reply(self, prompt: Prompt) -> Reply:
        """Decide as `rule` would, from words made of the pictures."""
        return super().reply(replace(prompt, messages=in_words(prompt)))


def in_words(prompt: Prompt) -> list[Message]:
    """Return the messages of a prompt with every picture as text of the game, which replaces the text sent with it."""
    shown = [prompt.pictures[part["sha256"]] for message in prompt.messages for part in pictures_of(message)]
    texts = iter(texts_of(shown))
    return [_worded(message, next(texts)) if pictures_of(message) else message for message in prompt.messages]


def _worded(message: Message, text: str) -> Message:
    worded = message.copy()
    worded["content"] = f"{text}\n{GAME_IS_OVER}" if text_of(message).endswith(GAME_IS_OVER) else text
    return worded
