"""The budget line: the last line of a result under the rule `budget_line`, which says what the agent has left.

It counts like any other text of a prompt, but not towards `result_tokens`: a result is cut first. A reader that wants
the result alone, such as a search of old observations, takes the line off with `without_budget_line`.
"""

from __future__ import annotations

import functools
import re

from smartplay_tools.context.prompts.wording import Wording, in_any_version

SENTENCES = ("budget_line", "budget_line_without_cap", "budget_line_of_steps")
"""The sentences: for a prompt with a cap, for one without, and for a call that answers no prompt of this library."""


def with_budget_line(text: str, words: Wording, *, tokens: int | None, cap: int | None, steps: int) -> str:
    """Return a result with the line.

    `tokens` are those of the prompt that the call answers, None if this library has not made it; `steps` are left.
    """
    with_cap, without_cap, of_steps = SENTENCES
    name = of_steps if tokens is None else without_cap if cap is None else with_cap
    return f"{text}\n{words(name, tokens=tokens, cap=cap, steps=steps)}"


def without_budget_line(text: str) -> str:
    """Return a result without its line; one that has none is returned as it is."""
    return _line(tuple(text for name in SENTENCES for text in in_any_version(name))).sub("", text)


@functools.cache
def _line(sentences: tuple[str, ...]) -> re.Pattern[str]:
    lines = "|".join(re.sub(r"\\{\w+\\}", r"\\d+", re.escape(text)) for text in sentences)
    return re.compile(rf"\n(?:{lines})\Z")
