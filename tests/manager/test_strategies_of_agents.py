"""Strategies that choose turns and compactors, over messages that are no game's."""

from __future__ import annotations

import copy
import random
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import InvalidArgumentError, StrategyError
from smartplay_tools.manager.record import read_thread
from tests.manager import histories
from tests.manager.fuzz import Chosen, Rewritten, cleared
from tests.manager.histories import FORMS, Messages
from tests.manager.judge import Judge, Letters, is_broken, total
from tests.manager.test_fit import HEAD, step, steps

CAP = 600
OPTIONS: dict[str, Any] = {"history": None, "beyond_history": "drop", "head": "task", "own_words": None}


class Model:
    """Answers with the length of the question."""

    def __init__(self) -> None:
        self.asked: list[Messages] = []

    def __call__(self, messages: Messages, max_tokens: int) -> str:
        self.asked.append(messages)
        return f"{len(str(messages))} letters."


def managed(strategy: Any, **options: Any) -> sp.ContextManager:
    return sp.ContextManager(CAP, **{"tokenizer": Letters(), "strategy": strategy, "slack": 0, **options})


def test_a_strategy_chooses_units_masks_and_writes():
    class FirstAndLast:
        def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
            assert [turn.tools for turn in past.turns] == [("read",)] * len(past.turns)
            assert [turn.step for turn in past.turns] == [*range(1, len(past.turns) + 1)]
            return (
                sp.Choice([0, 1], masked=[1], texts={0: "These are the first."}) if len(past.turns) > 2 else sp.Choice()
            )

    messages = steps(8)
    prompt = managed(FirstAndLast).fit(messages)
    assert prompt.messages[:3] == [*HEAD, {"role": "user", "content": "These are the first."}]
    assert prompt.sources == [0, 1, None, 2, 3, 4, 5, 16, 17]
    assert (prompt.masked, prompt.dropped, prompt.rewritten) == ([5], [*range(6, 16)], [])
    assert prompt.tokens == total("chat", prompt.messages)
    assert prompt.messages[3] is messages[2]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", [Chosen, Rewritten, cleared])
def test_prompts_are_those_of_a_game_that_is_played_from_its_beginning(strategy: Any, form: str):
    grown, at_once, again, messages = Model(), Model(), Model(), FORMS[form](steps(40))
    memo: dict[str, str] = {}
    manager = managed(strategy, ask=grown, memo=memo)
    judge = Judge(form, messages, CAP, {**OPTIONS, "strategy": strategy})
    for end in range(3, len(messages) + 1):
        prompt = manager.fit(messages[:end])
        assert not judge.faults(end, prompt)
    assert not judge.changed()
    assert managed(strategy, ask=at_once).fit(messages) == prompt
    assert managed(strategy, ask=again, memo=memo).fit(messages) == prompt
    assert not again.asked
    assert [question for question in at_once.asked if question not in grown.asked] == []


def test_what_is_always_shown_stays_whatever_a_compactor_returns():
    def nothing(history: Any, room: Any) -> Messages:
        return [{"role": "user", "content": "All is well."}]

    asked = {"role": "user", "content": "And the last page?"}
    messages = [*steps(4), asked, *step(4), *step(5)]
    prompt = managed(nothing).fit(messages)
    assert prompt.messages == [*HEAD, {"role": "user", "content": "All is well."}, asked, *messages[-2:]]
    assert prompt.parts["summary"] > 0


def test_a_result_that_a_compactor_changes_keeps_its_fields_and_is_named():
    messages = steps(12)
    messages[3]["artifact"] = "kept"
    prompt = managed(cleared).fit(messages)
    assert prompt.messages[3] == {**messages[3], "content": "[cleared]"}
    assert 3 in prompt.rewritten
    assert messages[3]["content"] != "[cleared]"


@pytest.mark.parametrize("form", FORMS)
def test_a_reply_that_a_compactor_changes_keeps_the_ids_that_the_model_has_sent(form: str):
    repeated = steps(12)
    for at in range(2, len(repeated), 2):  # servers number the calls of each reply
        repeated[at]["tool_calls"][0]["id"] = repeated[at + 1]["tool_call_id"] = "call_0"
    messages = FORMS[form](repeated)
    prompt = managed(cleared).fit(messages)
    assert not is_broken(form, prompt.messages)
    assert "shorter" in str(prompt.messages)
    assert str(prompt.messages).count("call_0") == str(messages).count("call_0") - sum(
        str(messages[number]).count("call_0") for number in prompt.dropped
    )


def test_an_object_serves_many_conversations_and_stays_as_it_was():
    class Counting:
        def __init__(self) -> None:
            self.calls = 0

        def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
            self.calls += 1
            return sp.Choice(texts={len(past.turns) - 1: f"Call {self.calls}."})

    given = Counting()
    manager = managed(given)
    assert [manager.fit(steps(count)).messages[2]["content"] for count in (3, 3, 5, 2)] == [
        f"Call {calls}." for calls in (3, 3, 5, 2)
    ]
    assert given.calls == 0


def test_own_messages_and_changed_ones_are_on_record(tmp_path: Path):
    for strategy in (Rewritten, cleared):
        folder = tmp_path / strategy.__name__
        prompt = managed(strategy, ask=Model(), record=folder).fit(steps(30))
        thread = read_thread(next(folder.iterdir()))
        assert thread.differing == []
        assert [*thread.prompts[0].messages] == prompt.messages
        assert thread.prompts[0].changed("rewritten") == [*prompt.rewritten]


def test_a_question_nobody_answers_passes_or_leaves_the_compactor_out():
    def broken(messages: Messages, max_tokens: int) -> str:
        raise TimeoutError("no answer")

    messages = steps(40)
    with pytest.raises(TimeoutError, match="no answer"):
        managed(Rewritten, ask=broken).fit(messages)
    prompt = managed(Rewritten, ask=broken, on_error="drop").fit(messages)
    assert prompt.failed == "TimeoutError: no answer"
    assert prompt.tokens == total("chat", prompt.messages) <= CAP


def test_a_name_is_a_strategy_as_in_a_budget():
    budget = sp.Budget(history=None, prompt_tokens=CAP, strategy="memory-bm25:tokens=60")
    of_budget = sp.ContextManager.of(budget, tokenizer=Letters())
    prompt = of_budget.fit(steps(40))
    assert prompt == managed("memory-bm25:tokens=60").fit(steps(40))
    assert prompt.messages[2]["content"].startswith("Turn ")
    shared = sp.Budget(history=None, prompt_tokens=CAP)
    given = sp.ContextManager.of(shared, strategy="memory-bm25:tokens=60", tokenizer=Letters())
    assert given.fit(steps(40)) == prompt


def test_a_subclass_takes_a_budget_and_a_tool_keeps_an_agents_own_data():
    class Own(sp.ContextManager):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)

    tool = {"name": "read", "description": "Reads.", "input_schema": {"type": "object"}, "call": print}
    assert Own.of(sp.Budget(history=2, prompt_tokens=CAP)).fit(steps(4), tools=[tool]).tokens <= CAP


def too_long(history: Any, room: Any) -> Any:
    return [{"role": "tool", "content": "nobody asked", "tool_call_id": "x"}]


class Overfull:
    def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
        return sp.Choice(range(len(past.turns)))


@pytest.mark.parametrize("strategy", [too_long, Overfull])
def test_what_cannot_be_sent_is_an_error(strategy: Any):
    with pytest.raises(StrategyError):
        managed(strategy).fit(steps(60))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"first_turns": 2}, "chooses the turns itself, so first_turns has no meaning"),
        ({"history": 3, "beyond_history": "mask"}, "beyond_history has no meaning"),
        ({"newest_pictures": 2}, "newest_pictures has no meaning"),
        ({"strategy": cleared, "own_words": 2}, "rewrites messages itself, so own_words has no meaning"),
        ({"question_tokens": 100}, "questions of a compactor"),
        ({"strategy": Rewritten}, "give ask"),
        ({"strategy": int}, "int is no strategy"),
    ],
)
def test_what_a_strategy_cannot_be_combined_with_is_refused(options: dict[str, Any], sentence: str):
    with pytest.raises(InvalidArgumentError, match=sentence):
        managed(**{"strategy": Chosen, **options}).fit(copy.deepcopy(steps(40)))


def test_a_whole_conversation_is_counted_without_the_strategy():
    messages = steps(8)
    assert managed(too_long).count(messages) == sp.ContextManager(None, tokenizer=Letters()).fit(messages).tokens


def test_a_question_without_anybody_to_ask_is_an_error_whatever_becomes_of_others():
    manager = managed(lambda history, room: (yield [{"role": "user", "content": "What matters?"}]), on_error="drop")
    with pytest.raises(InvalidArgumentError, match="asks a model; give ask"):
        manager.fit(steps(8))


def without_old_thoughts(messages: Messages, keep: int) -> Messages:
    """The messages with the thoughts of all turns but the newest that have any cleared."""
    turns: list[Messages] = [[]]
    for message in messages:
        turns += [[]] if message["role"] == "user" else []
        turns[-1].append({**message})
    thinking = [turn for turn in turns if any("reasoning_content" in message for message in turn)]
    for message in (message for turn in thinking[:-keep] for message in turn):
        message.pop("reasoning_content", None)
    return [message for turn in turns for message in turn]


def without_inputs(messages: Messages, keep: int) -> Messages:
    """The messages with all tool uses but the newest cleared; thoughts stay."""
    ids = [message["tool_call_id"] for message in messages if message["role"] == "tool"]
    old, cleared = {*ids[: max(0, len(ids) - keep)]}, copy.deepcopy(messages)
    for message in cleared:
        if message.get("tool_call_id") in old:
            message["content"] = "[cleared]"
        for call in message.get("tool_calls", ()):
            call["function"]["arguments"] = "{}" if call["id"] in old else call["function"]["arguments"]
    return cleared


USES = "clear_tool_uses_20250919"
EDITS = [
    ("clear_thinking_20251015", lambda messages: without_old_thoughts(messages, 1)),
    ("clear_thinking_20251015:keep=thinking_turns=2", lambda messages: without_old_thoughts(messages, 2)),
    ("clear_thinking_20251015:keep=all", lambda messages: messages),
    (f"{USES}:trigger=1,keep=2,clear_tool_inputs=true", lambda messages: without_inputs(messages, 2)),
    (
        'context_management:edits=[{"type":"clear_thinking_20251015"},'
        f'{{"type":"{USES}","trigger":{{"type":"tool_uses","value":1}},"clear_tool_inputs":true}}]',
        lambda messages: without_inputs(without_old_thoughts(messages, 1), 3),
    ),
]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("strategy", "edited"), EDITS)
def test_thoughts_leave_by_turns_and_stay_where_tool_uses_are_cleared(form: str, strategy: str, edited: Any):
    for seed in range(6):
        rng = random.Random(seed)
        given = histories.chat(rng, rng.choice(["task", "chat", "parallel"]))
        messages, wanted = FORMS[form](given), FORMS[form](edited(given))
        prompt = sp.ContextManager(None, tokenizer=Letters(), strategy=strategy, result_tokens=None).fit(
            messages, form=form
        )
        assert prompt.messages == wanted
        assert prompt.tokens == total(form, wanted)
        changed = {*prompt.rewritten, *prompt.dropped}
        assert {at for at, message in enumerate(messages) if message not in wanted} <= changed


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", ["compact_20260112:trigger=300", "compaction:compact_threshold=300"])
def test_conversations_are_compacted_in_every_form(form: str, strategy: str):
    def ask(messages: Messages, max_tokens: int) -> str:
        return "<summary>Page 7 is next.</summary>"

    given = FORMS[form]([*steps(8), {"role": "user", "content": "Go on."}, *step(8)])
    prompt = sp.ContextManager(None, tokenizer=Letters(), strategy=strategy, ask=ask).fit(given, form=form)
    words = [
        each["content"] for each in prompt.messages if each.get("role") == "user" and isinstance(each["content"], str)
    ]
    assert words.count("A summary stands in place of the conversation before this message:\nPage 7 is next.") == 1
    assert prompt.messages[-1] is given[-1]
    assert len(prompt.messages) < len(given) / 2
