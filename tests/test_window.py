"""The window without an episode: head, turns, tools, budget and counter are made by hand."""

from __future__ import annotations

from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context import ContextWindow, Turn, TurnBuilder
from smartplay_tools.context.choosing import choosing
from smartplay_tools.context.compacting import Compacting
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.types import ResolvedBudget
from smartplay_tools.types.messages import read_calls
from tests.scripts import Words

HEAD: list[Any] = [{"role": "system", "content": "You look things up."}, {"role": "user", "content": "Who won?"}]
SEARCH = sp.ToolSpec("search", "Search the web.", {"type": "object", "properties": {"query": {"type": "string"}}})
COUNTER = TokenCounter(Words())


def searches(number: int) -> list[Turn]:
    """Turns of an agent that searches; every third search fails."""
    builder = TurnBuilder(Wording.of(VERSION))
    for at in range(number):
        call = {"id": f"c{at}", "type": "function", "function": {"name": "search", "arguments": '{"query": "x"}'}}
        reply: Any = {"role": "assistant", "content": f"Search {at}.", "tool_calls": [call]}
        builder.open(at, reply, read_calls(reply, [f"c{at}"]))
        builder.add_result(0, f"page {at} says no", {"observation_step": at + 1}, is_error=at % 3 == 2)
    builder.close()
    return builder.turns


class Failures:
    """Keeps what failed."""

    def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
        return sp.Choice([turn.number for turn in past.turns if turn.errors and not turn.is_pinned][:2])


class LastFour:
    """Keeps the task and the last four messages."""

    def compact(self, history: Any, room: Any) -> Any:
        return [history[0], *history[-4:]] if len(history) > 5 else history


CAP = COUNTER.prompt(HEAD, [SEARCH]) + 4 * COUNTER.messages(searches(1)[0].messages)
"""Room for four turns."""


def shown(window: ContextWindow) -> list[str]:
    """Play twelve turns; return the first two words of each message of the last prompt."""
    for turn in searches(12):
        window.append(turn)
        view = window.view()
        assert view.tokens == COUNTER.prompt(view.messages, [SEARCH]) <= CAP
    return [" ".join(str(message["content"]).split()[:2]) for message in view.messages]


@pytest.mark.parametrize(
    ("budget", "turns"),
    [
        ({}, [8, 9, 10, 11]),
        ({"first_turns": 1}, [0, 9, 10, 11]),
        ({"slack": 0.5}, [8, 9, 10, 11]),
        ({"slack": 0.75}, [9, 10, 11]),
        ({"history": 1}, [10, 11]),
    ],
)
def test_it_shows_the_newest_turns_that_fit(budget: dict[str, Any], turns: list[int]) -> None:
    window = ContextWindow(HEAD, [SEARCH], ResolvedBudget(prompt_tokens=CAP, **budget), COUNTER)
    words = [word for turn in turns for word in (f"Search {turn}.", f"page {turn}")]
    assert shown(window) == ["You look", "Who won?", *words]
    assert list(window.view().selection) == turns


def test_observations_that_are_too_old_are_masked() -> None:
    budget = ResolvedBudget(prompt_tokens=CAP, history=1, beyond_history="mask")
    assert shown(ContextWindow(HEAD, [SEARCH], budget, COUNTER))[3::2] == ["[observation left", "page 10", "page 11"]


def test_a_reader_of_records_can_go_back_to_an_earlier_prompt() -> None:
    window = ContextWindow(HEAD, [SEARCH], ResolvedBudget(history=1, beyond_history="mask"), COUNTER)
    for turn in searches(6):
        window.add(turn)
    for oldest in (0, 4, 2, 0, 3):
        window.age(oldest)
        assert [form.message["content"].startswith("page") for form in window.now[1::2]] == [
            step >= oldest for step in range(1, 7)
        ]
        assert window.tokens(window.row(0, 6)) == COUNTER.messages(form.message for form in window.now)


def test_a_strategy_chooses_by_what_failed() -> None:
    window = ContextWindow(HEAD, [SEARCH], ResolvedBudget(prompt_tokens=CAP), COUNTER)
    window.follow(choosing(window, Failures()))
    assert shown(window)[2::2] == ["Search 2.", "Search 5.", "Search 11."]


def test_a_compactor_rewrites() -> None:
    window = ContextWindow(HEAD[:1], [SEARCH], ResolvedBudget(prompt_tokens=CAP), COUNTER, lead=HEAD[1:])
    window.follow(Compacting(window, LastFour()).make, by_words=True)
    assert shown(window)[1::2] == ["Who won?", "page 10", "page 11"]
