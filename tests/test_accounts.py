"""Accounts of records: prompts add up to the token, and what is said of a turn that left is true."""

from __future__ import annotations

import dataclasses
import json

import pytest

import smartplay_tools as sp
from smartplay_tools.context.strategies import custom
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.records import Record
from smartplay_tools.records.accounts import PARTS, Accounts, Departure, shown_turns
from smartplay_tools.transcript.events import concerns_summary
from smartplay_tools.types import ResolvedBudget, ToolSpec

BANDIT = "BanditTwoArmedHighLowFixed-v0"

BUDGETS = {
    "everything": sp.Budget(history=None),
    "cap": sp.Budget(history=None, prompt_tokens=900),
    "history": sp.Budget(history=3),
    "both": sp.Budget(history=6, prompt_tokens=700),
    "slack": sp.Budget(history=None, prompt_tokens=900, slack=0.5),
    "slack of a history": sp.Budget(history=6, slack=0.5),
    "mask": sp.Budget(history=3, prompt_tokens=900, beyond_history="mask"),
    "notes": sp.Budget(history=3, notes_tokens=60),
    "summary": sp.Budget(history=None, prompt_tokens=900, slack=0.5, summary_tokens=60),
    "compactor": sp.Budget(history=3, prompt_tokens=900, notes_tokens=60, strategy="shortening"),
}


class Shortening:
    """A compactor that has a message in place of all but the newest six, once there are twelve."""

    def compact(self, history, room):
        if len(history) < 12 or history[-6]["role"] == "tool":
            return history
        return [history[0], {"role": "user", "content": "So far so good."}, *history[-6:]]


class Talker:
    """Reads the manual, takes notes now and then, says something before it acts, and makes a mistake."""

    name = "talker"

    def __init__(self) -> None:
        self.turn = -1

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        if prompt.purpose == "summary":
            return sp.Reply({"role": "assistant", "content": "Both machines were pulled."})
        self.turn += 1
        if self.turn == 2:
            return sp.Reply(sp.call("read_manual"))
        if self.turn % 7 == 4 and any(tool.name == "take_notes" for tool in prompt.tools):
            return sp.Reply(sp.call("take_notes", text=f"Noted in turn {self.turn}."))
        message = sp.call("act", action="fly" if self.turn == 5 else str(1 + self.turn % 2))
        return sp.Reply({**message, "content": "Let me see." if self.turn % 3 else None})


@pytest.fixture(params=BUDGETS, scope="module")
def record(request):
    custom._NAMED["shortening"] = custom.Loaded(Shortening)
    with sp.Episode(BANDIT, seed=3, budget=BUDGETS[request.param], transcript=(events := [])) as episode:
        sp.play(episode, Talker())
    return Record(events)


def accounts_of(record: Record) -> Accounts:
    accounts = Accounts.of(record)
    assert accounts is not None
    return accounts


def test_the_parts_are_what_they_are_called(record):
    prompts = [*accounts_of(record).prompts()]
    assert [*map(sum, prompts)] == [view["tokens"] for view in record.views]
    last = dict(zip(PARTS, prompts[-1], strict=True))
    budget = sp.Budget(**record.facts["asked"])
    assert all(last[part] for part in ("task", "words", "calls", "observations"))
    assert bool(last["texts"]) == (budget.strategy is not None)
    assert bool(last["manual"]) == (budget.strategy is None)  # with a compactor it is a result, which can leave
    assert bool(last["notes"]) == (budget.notes_tokens is not None)
    assert bool(last["summary"]) == (budget.summary_tokens is not None)
    if budget.beyond_history == "mask":
        assert last["masked"]


def test_a_turn_that_was_shown_whole_is_in_the_prompt(record):
    views = [view for view in record.views if not concerns_summary(view)]
    for view, sent in zip(views, record.prompts, strict=False):
        kinds, before = shown_turns(record, view), record.turns[: view["turn"]]
        there = {turn.number for turn in before if all(message in sent.prompt.messages for message in turn.messages)}
        assert {number for number, kind in enumerate(kinds) if kind == "whole"} <= there
        assert {kinds[number] for number in there} <= {"whole", "notes"}


def shown(record: Record, left: Departure, **budget: int | None) -> bool:
    """Whether a turn is in the prompt that it left, under another budget."""
    counter = TokenCounter(record.config.tokenizer)
    tools = [ToolSpec(**tool) for tool in record.heads[0]["tools"]]
    other = ResolvedBudget(**{**record.budget, **budget})
    head = record.heads[0]["messages"]
    window = ContextWindow.of(record.turns[: left.prompt], head, tools, other, counter)
    return left.turn in window.view().selection


# With slack another cap has other blocks.
@pytest.mark.parametrize("record", [name for name, budget in BUDGETS.items() if not budget.slack], indirect=True)
def test_a_turn_would_have_stayed_with_what_is_said_and_not_with_less(record):
    for left in accounts_of(record).departures():
        if left.reason == "history":
            assert shown(record, left, history=left.keeps, prompt_tokens=None)
            assert not shown(record, left, history=left.keeps - 1, prompt_tokens=None)
        if left.reason == "full":
            assert shown(record, left, prompt_tokens=left.keeps)
            assert not shown(record, left, prompt_tokens=left.keeps - 1)
            assert left.keeps - record.budget["prompt_tokens"] == left.needs - left.free


@pytest.mark.parametrize("name", ["slack", "summary"])
def test_with_slack_it_says_what_a_prompt_with_all_its_turns_needed(name):
    with sp.Episode(BANDIT, seed=3, budget=BUDGETS[name], transcript=(events := [])) as episode:
        sp.play(episode, Talker())
    first = next(accounts_of(Record(events)).departures())
    assert first.reason == "full"
    more = {"prompt_tokens": first.keeps, "slack": 0, "summary_tokens": None}
    more["prompt_tokens"] -= episode.ledger.strategies.reserve
    assert shown(Record(events), dataclasses.replace(first, turn=0), **more)
    more["prompt_tokens"] -= 1
    assert not shown(Record(events), dataclasses.replace(first, turn=0), **more)


def test_every_turn_that_is_not_in_a_prompt_has_left_before(record):
    left = {(gone.turn, gone.prompt) for gone in accounts_of(record).departures()}
    for view in record.views:
        if view.get("purpose") != "summary":
            there = {turn for first, last in view["turns"] for turn in range(first, last + 1)}
            for turn in set(range(view["turn"])) - there:
                assert any(gone == turn and prompt <= view["turn"] for gone, prompt in left)


@pytest.mark.parametrize("record", ["everything"], indirect=True)
def test_a_figure_stacks_the_prompts_of_several_records(record):
    figures = pytest.importorskip("smartplay_tools.evaluation.analysis.figures.prompt_figures")
    first, second = figures.tokens_by_part({"one": record, "other": record}).axes
    tokens = sum(view["tokens"] for view in record.views)
    assert first.get_title().startswith(f"one: {tokens / 1000:,.0f}k tokens, score ")
    assert first.get_ylim() == second.get_ylim()


@pytest.mark.parametrize("record", ["cap"], indirect=True)
def test_a_record_whose_tokenizer_is_not_of_this_package_is_not_counted(record):
    start = json.loads(json.dumps(record.start))
    start["config"]["tokenizer"] = "hf:somebody/else"
    assert Accounts.of(Record([start, *record.events[1:]])) is None
