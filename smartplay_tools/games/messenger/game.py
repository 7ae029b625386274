"""The MESSENGER environment: rules, texts and manual as a text game."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Literal

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.base import TextGame
from smartplay_tools.games.messenger import manuals, rules, text as words


class Messenger(TextGame):
    """Bring the message to the goal; the manual describes which entity has which role.

    Action space: `Discrete(5)`, a step to the north, south, west or east, or none. Observation: the action taken,
    whether the agent has the message, and the distance and direction of every visible name. Reward: 0.5 for the message
    and 1 for bringing it to the goal, -1 for every enemy that is met and for the goal without the message; level 1
    ends with 1 or -1 at the first contact. Score: the reward of the last step. Terminates when the avatar dies or the
    goal is reached; a rollout has 4, 64 or 128 steps.

    Arguments: `level`, 1 to 3; `split`, the games and texts of the "test" (default), "val" or "train" set; `texts`, a
    folder with text files to read instead of ours (default: the environment variable `SMARTPLAY_MESSENGER_TEXTS`, if
    it is set); `sentences`, which sentences these have to be: "grammar" (ours), "original", or "other:" and the first
    16 digits of their file's sha256 (default: any); `text`, "original" (default) or "corrected", which says in words
    that you were caught.

    Attributes:
        sentences: which sentences are played, in the form of the argument.
    """

    actions = words.ACTIONS
    options = ("split", "texts", "sentences", "text")
    places = ("texts",)

    def __init__(
        self,
        *,
        level: int,
        split: rules.Split = "test",
        texts: str | os.PathLike[str] | None = None,
        sentences: str | None = None,
        text: Literal["original", "corrected"] = "original",
        **options: Any,
    ) -> None:
        if level not in (1, 2, 3):
            raise InvalidArgumentError(f"level must be 1, 2 or 3, not {level!r}.")
        if text not in ("original", "corrected"):
            raise InvalidArgumentError(f"text must be 'original' or 'corrected', not {text!r}.")
        folder = manuals.choose_folder(texts, split, sentences)
        self.sentences = manuals.identify(folder, split)
        self._sentences_by_entity = manuals.load(folder, split)
        self._level, self._split, self._text = level, split, text
        self._games = rules.GAMES[split]
        self.manual = words.compose(())
        super().__init__(**options)

    @classmethod
    def options_to_record(cls, options: Mapping[str, Any]) -> dict[str, Any]:
        """Add which sentences the machine's folder holds, unless they are ours."""
        split, rest = options.get("split", "test"), {k: v for k, v in options.items() if k != "sentences"}
        folder = manuals.choose_folder(options.get("texts"), split, options.get("sentences"))
        sentences = manuals.identify(folder, split)
        return rest if sentences == manuals.GRAMMAR else {**rest, "sentences": sentences}

    @classmethod
    def options_from_record(cls, options: Mapping[str, Any]) -> dict[str, Any]:
        """Our sentences, whatever folder this machine names, unless the record says something else."""
        return dict(options) if "texts" in options else {"sentences": manuals.GRAMMAR, **options}

    def deviations(self) -> dict[str, Any]:
        """The differences from the paper: the source of the sentences, and options that were given."""
        paper = {"texts": "original", "split": "test", "text": "original"}
        played = {"texts": self.sentences, "split": self._split, "text": self._text}
        return {name: {"paper": paper[name], "played": played[name]} for name in paper if played[name] != paper[name]}

    def drawing(self) -> dict[str, Any]:
        """The places in half cells by role, with names and movements; None for what is removed or dead."""
        state = self._rules_state
        avatar = {"avatar": state.avatar, "has_message": state.has_message}
        return {"names": self._names, "movements": state.movements, "places": state.places, **avatar}

    def _reset(self) -> str:
        chance = self.np_random
        game = rules.pick(self._games, chance)
        self._rules_state = rules.start(self._level, chance)
        movements = self._rules_state.movements
        self._names = words.names_by_role(game, len(movements))
        self.manual = words.compose(manuals.draw(self._level, game, movements, self._sentences_by_entity, chance))
        return words.describe(self._rules_state, self._names)

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        if self._level == 1:
            outcome = rules.step_level_1(self._rules_state, action)
        else:
            outcome = rules.step(self._rules_state, action, self.np_random)
        self._rules_state = outcome.state
        # The benchmark's score is the reward of the last step, so an earlier reward does not count.
        self.score = outcome.reward
        self.completed = outcome.ended and outcome.reward == 1
        observation = words.describe(outcome.state, self._names, action, corrected=self._text == "corrected")
        return observation, outcome.reward, outcome.ended, False

    def _state(self) -> Any:
        state = self._rules_state
        return [self._names, state.movements, state.places, state.avatar, state.has_message, self.manual]
