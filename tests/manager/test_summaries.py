"""Summaries of what has left the prompts of a context manager: when a model is asked, what, and what is kept."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import InvalidArgumentError
from tests.manager.histories import anthropic, responses
from tests.manager.judge import SUMMARY, Letters
from tests.manager.test_fit import HEAD, Messages, cost, manager, step, steps

CAP = 600


class Model:
    """Answers with the number of the question, and keeps what it was asked."""

    def __init__(self, *answers: Any) -> None:
        self.asked: list[str] = []
        self.answers = list(answers)

    def __call__(self, messages: Messages, max_tokens: int) -> str:
        (message,) = messages
        assert cost(messages) <= CAP
        self.asked.append(message["content"])
        answer = self.answers.pop(0) if self.answers else f"Summary {len(self.asked)}."
        if isinstance(answer, Exception):
            raise answer
        return str(answer)


def summarising(ask: Any, *, tokens: int = 40, question_tokens: int | None = None, **options: Any) -> sp.ContextManager:
    return manager(CAP, **{"slack": 0.5, "strategy": sp.Summaries(tokens, question_tokens), "ask": ask, **options})


def ends(messages: Messages) -> range:
    return range(4, len(messages) + 1, 2)


def test_what_leaves_is_summarised_once_for_each_move_and_stands_after_the_head():
    model, messages = Model(), steps(60)
    window, moves, before = summarising(model), 0, 0
    for end in ends(messages):
        prompt = window.fit(messages[:end])
        moves += len(prompt.dropped) != before
        before = len(prompt.dropped)
        assert prompt.tokens == cost(prompt.messages) <= CAP
        if moves:
            assert prompt.messages[2] == {"role": "user", "content": f"{SUMMARY}Summary {moves}."}
            assert (prompt.sources[2], prompt.summary) == (None, prompt.messages[2]["content"])
            assert prompt.parts["summary"] == cost(prompt.messages[2:3]) - 3
        assert len(model.asked) == moves
    assert moves > 3
    assert "earlier summary" not in model.asked[0]
    assert all(f"Summary {number}." in asked for number, asked in enumerate(model.asked[1:], 1))
    told = "".join(model.asked)
    assert all(told.count(f"tool: Page {number} of the book.") == 1 for number in range(before // 2))
    assert 'assistant calls read: {"page": 0}' in told


@pytest.mark.parametrize("form", [list, responses, anthropic])
def test_another_process_with_the_memo_asks_nothing_and_shows_the_same(form: Any, tmp_path: Path):
    model, nobody, messages = Model(), Model(), form(steps(60))
    window, again = summarising(model, memo=tmp_path), summarising(nobody, memo=str(tmp_path))
    shown = [window.fit(messages[:end]) for end in ends(messages)]
    assert [again.fit(messages[:end]) for end in ends(messages)] == shown
    assert (len([*tmp_path.iterdir()]), nobody.asked) == (len(model.asked), [])
    assert shown[-1].messages[2].items() >= {"role": "user", "content": shown[-1].summary}.items()


def test_a_part_that_is_longer_than_a_question_is_asked_in_pieces_and_whole():
    model, text = Model(), "".join(f"{number:04}" for number in range(1_200))
    messages = [*steps(1), {"role": "user", "content": text[:1_600]}, *steps(40)[2:]]
    prompt = summarising(model, question_tokens=300).fit(messages)
    assert all(cost([{"role": "user", "content": asked}]) <= 300 for asked in model.asked)
    parts = [asked.partition("The part:\n\n")[2] for asked in model.asked]
    assert text[:1_600] in "".join(parts).replace("\n\nuser: ", "user: ")
    assert prompt.summary == f"{SUMMARY}Summary {len(model.asked)}."


def test_two_threads_ask_at_once_and_get_one_text():
    both, messages, shown = threading.Barrier(2), steps(20), list[str]()

    def ask(_: Any, __: int) -> str:
        both.wait(10)  # no lock is held here
        return f"By {threading.current_thread().name}."

    window = summarising(ask)
    threads = [threading.Thread(target=lambda: shown.append(window.fit(messages).summary)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(shown) == 2
    assert len(set(shown)) == 1


def test_an_exception_passes_and_the_next_prompt_asks_again():
    memo: dict[str, str] = {}
    model = Model(TimeoutError("no answer"))
    window = summarising(model, memo=memo)
    with pytest.raises(TimeoutError, match="no answer"):
        window.fit(steps(20))
    assert memo == {}
    assert window.fit(steps(20)).summary == f"{SUMMARY}Summary {len(model.asked)}."


@pytest.mark.parametrize("head", ["task", "system"])
def test_a_prompt_can_go_on_without_a_summary_and_says_so(head: Any):
    window = summarising(Model(*[TimeoutError("no answer")] * 2), on_error="drop", head=head)
    messages = [*steps(10), {"role": "user", "content": "Go on."}, *steps(10)[2:]]
    prompt = window.fit(messages)
    assert (prompt.summary, prompt.failed) == ("", "TimeoutError: no answer")
    plain = manager(CAP - prompt_reserve(), slack=0.5, head=head).fit(messages)
    assert prompt.messages == plain.messages
    assert prompt.messages[1]["role"] == "user"


def prompt_reserve() -> int:
    return cost([{"role": "user", "content": SUMMARY}]) - 3 + 40


@pytest.mark.parametrize(("answer", "shown"), [("", "Summary 1."), ("  \n", "Summary 1."), ("word " * 200, "cut]")])
def test_an_answer_may_be_empty_or_too_long(answer: str, shown: str):
    messages = steps(60)
    model = Model("Summary 1.", answer)
    window = summarising(model)
    for end in ends(messages):
        prompt = window.fit(messages[:end])
        if len(model.asked) == 2:
            break
    assert prompt.summary.endswith(shown)
    assert prompt.tokens == cost(prompt.messages) <= CAP
    assert prompt.parts["summary"] <= prompt_reserve()


def test_a_summary_never_covers_what_it_has_not_seen():
    model, messages = Model(), steps(20)
    window = summarising(model)
    window.fit(messages)
    number = len(model.asked)
    edited = [*HEAD, *step(0, "Another page."), *messages[4:]]
    assert window.fit(edited).summary != window.fit(messages).summary
    assert len(model.asked) == 2 * number
    assert "Another page." in model.asked[number]


@pytest.mark.parametrize("is_asynchronous", [True, False])
async def test_an_asynchronous_model_is_awaited(is_asynchronous: bool):
    model = Model()

    async def ask(messages: Messages, max_tokens: int) -> str:
        return model(messages, max_tokens)

    window = summarising(ask if is_asynchronous else model)
    assert await window.afit(steps(20)) == summarising(Model()).fit(steps(20))
    with pytest.raises(ValueError, match="broken"):
        await summarising(Model(ValueError("broken"))).afit(steps(20))


def test_the_budget_of_games_asks_for_the_same_summaries():
    budget = sp.Budget(prompt_tokens=CAP, slack=0.5, summary_tokens=40, question_tokens=300)
    options = {"tokenizer": Letters(), "ask": Model()}
    of_budget = sp.ContextManager.of(budget, **options)
    own = summarising(Model(), question_tokens=300, result_tokens=budget.result_tokens)
    assert of_budget.fit(steps(60)) == own.fit(steps(60))


async def asynchronous(messages: Messages, max_tokens: int) -> str:
    return ""


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"ask": None}, "give ask"),
        ({"strategy": None}, "Nobody asks without a strategy"),
        ({"strategy": 3}, r"int is no strategy: give Summaries\(tokens=...\)"),
        ({"question_tokens": 300}, "questions of a compactor"),
        ({"strategy": sp.Summaries(0)}, "tokens is a whole number from 1 on"),
        ({"strategy": sp.Summaries(40, 100)}, "raise question_tokens"),
        ({"slack": 0}, "at every step"),
        ({"history": 1}, "at every step"),
        ({"prompt_tokens": None}, "Nothing ever leaves"),
        ({"memo": 3}, "a folder or a mutable mapping"),
        ({"memo": __file__}, "is no folder"),
        ({"on_error": "ignore"}, "on_error must be one of"),
        ({"ask": asynchronous}, "afit"),
        ({"ask": lambda _, __: 3}, "returns the text of an answer, not int"),
    ],
)
def test_what_cannot_be_summarised_is_refused(options: dict[str, Any], sentence: str):
    given = {"prompt_tokens": CAP, "slack": 0.5, "strategy": sp.Summaries(40), "ask": Model(), **options}
    with pytest.raises(InvalidArgumentError, match=sentence):
        manager(**given).fit(steps(20))


def test_the_summary_itself_may_not_fit():
    with pytest.raises(sp.PromptOverflowError, match="summary 1,0"):
        manager(1_000, slack=0.5, strategy=sp.Summaries(1_000, 9_000), ask=Model()).fit(HEAD)
