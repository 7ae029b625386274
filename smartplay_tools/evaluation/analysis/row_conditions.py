"""Conditions on a figure, as users write them: score >= 40."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.pairs import MEASURES
from smartplay_tools.records.rows import Row

OPERATORS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
}
_FORM = re.compile(r"\s*(\w+)\s*(<=|>=|==|<|>)\s*(-?\d+(?:\.\d+)?)\s*")


@dataclass(frozen=True)
class RowCondition:
    """A comparison of a measure with a number."""

    measure: str
    sign: str
    number: float

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the condition that a text states."""
        match = _FORM.fullmatch(text)
        if match is None or match[1] not in MEASURES:
            names = ", ".join(MEASURES)
            raise InvalidArgumentError(f"{text!r} is not a condition; write it as 'score >= 40', with one of {names}.")
        return cls(match[1], match[2], float(match[3]))

    def __call__(self, row: Row) -> bool:
        """Whether the condition holds for an episode; an episode without the measure does not meet it."""
        value = MEASURES[self.measure](row)
        return value is not None and self.holds(value)

    def __str__(self) -> str:
        return f"{self.measure} {self.sign} {self.number:g}"

    def holds(self, value: float) -> bool:
        """Whether it holds for a value."""
        return OPERATORS[self.sign](value, self.number)
