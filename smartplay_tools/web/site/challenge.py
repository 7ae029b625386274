"""A challenge: an episode that somebody has played and the score to beat, written into the address of a link.

The address holds what determines the episode (game, seed and trial of the run, budget, rules) and the episode's key,
the digest of all of it. So any site in which games are played can begin the same one, and a version that would play it
differently says so. A link comes from a stranger: what it could make this machine read or import is refused.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit

from pydantic import ValidationError

from smartplay_tools.episode.config import CellConfig, Rules
from smartplay_tools.errors import InvalidArgumentError, in_one_line
from smartplay_tools.evaluation.run_folder.folder import trial_seed
from smartplay_tools.evaluation.runs.plan import check_playable, make_cells
from smartplay_tools.games.specs import GAMES
from smartplay_tools.types import Budget
from smartplay_tools.types.arguments import value_in

LATEST_TRIAL = 9_999

OF_ONE_MACHINE = re.compile(r"[:/\\]")
"""Marks of a file's path, or of a name that leads to one."""

OWN_RULES = ("manual", "batch", "protocol", "observation", "budget_line")
"""The rules that an episode can have without a run around it."""

_OPTION = "option."
_NUMBERS = {"seed": 2**31 - 1, "trial": LATEST_TRIAL}


@dataclass(frozen=True)
class Challenge:
    """An episode to play, and the score to beat."""

    cell: CellConfig
    seed: int
    """The seed of the run that it was played in."""
    trial: int
    score: float

    @property
    def key(self) -> str:
        """The key of the episode."""
        return self.cell.with_seed(trial_seed(self.seed, self.cell.game, self.trial)).key

    def query(self) -> str:
        """Return the query of the link; `InvalidArgumentError` if other machines could not play this."""
        cell, usual = self.cell, Budget()
        _check_portable(cell.game_file or cell.budget.strategy, cell.tokenizer, *cell.options.values())
        asked = {name: _text(value) for name, value in dict(cell.budget).items() if value != getattr(usual, name)}
        rules = {name: getattr(cell, name) for name in OWN_RULES if getattr(cell, name) != getattr(Rules(), name)}
        options = {_OPTION + name: json.dumps(value) for name, value in cell.options.items()}
        facts = {"game": cell.game, "seed": self.seed, "trial": self.trial, "score": f"{self.score:.17g}"}
        named = {} if cell.engine is None else {"engine": cell.engine}
        counted = {"tokenizer": cell.tokenizer, "key": self.key}
        return urlencode({**facts, **asked, **rules, **named, **options, **counted})

    @classmethod
    def read(cls, link: str) -> Challenge:
        """Return the challenge of a link, or of its query; `InvalidArgumentError` says what is wrong with it."""
        given = dict(parse_qsl(urlsplit(link).query or link, keep_blank_values=True))
        if missing := [name for name in ("game", "seed", "trial", "score", "key") if name not in given]:
            raise InvalidArgumentError(f"This is not the link of a challenge: it has no {', '.join(missing)}.")
        if not GAMES.is_loaded(game := given.pop("game")):
            raise InvalidArgumentError(f"The challenge is about {game!r}, which is not a game of this version.")
        numbers = {name: _number(name, given.pop(name), most) for name, most in _NUMBERS.items()}
        score, key = _score(given.pop("score")), given.pop("key")
        challenge = cls(_cell(game, given), score=score, **numbers)
        check_playable(challenge.cell)
        if challenge.key != key:
            raise InvalidArgumentError(
                "This version would not play the episode of the challenge, but another one: its texts, its tokenizer "
                "or its rules differ from those of the version that made the link."
            )
        return challenge


def _cell(game: str, given: dict[str, str]) -> CellConfig:
    options = {name.removeprefix(_OPTION): _value(given.pop(name)) for name in [*given] if name.startswith(_OPTION)}
    budget = {name: _value(given.pop(name)) for name in Budget.model_fields if name in given}
    rules: dict[str, Any] = {name: given.pop(name) for name in OWN_RULES if name in given}
    engine, tokenizer = given.pop("engine", None), given.pop("tokenizer", None)
    if given:
        raise InvalidArgumentError(f"A challenge has no {', '.join(given)}.")
    _check_portable(budget.get("strategy"), tokenizer, *options.values())
    try:
        (cell,) = make_cells(
            *([game], ["human"], [Budget(**budget)]), engine=engine, tokenizer=tokenizer, options=options, **rules
        )
    except ValidationError as error:
        raise InvalidArgumentError(f"The budget of the challenge is not valid: {in_one_line(error)}.") from None
    return cell


def _check_portable(own: str | None, *others: Any) -> None:
    if own is not None or any(isinstance(value, str) and OF_ONE_MACHINE.search(value) for value in others):
        raise InvalidArgumentError(
            "A challenge cannot have a game, a strategy, texts or a tokenizer of your own: other machines lack them."
        )


def _text(value: Any) -> str:
    return "none" if value is None else str(value)


def _value(text: str) -> Any:
    return None if text == "none" else value_in(text)


def _number(name: str, text: str, most: int) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) <= 10 and int(text) <= most):
        raise InvalidArgumentError(f"The {name} of a challenge is a number from 0 to {most}, not {text[:40]!r}.")
    return int(text)


def _score(text: str) -> float:
    try:
        score = float(text)
    except ValueError:
        score = math.nan
    if not math.isfinite(score):
        raise InvalidArgumentError(f"The score of a challenge is a number, not {text[:40]!r}.")
    return score
