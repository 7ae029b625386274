"""Compactors: what they are given, what may come back, what is sent, asked, counted and recorded."""

from __future__ import annotations

import asyncio
import copy
import itertools
import json
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context import ContextOverflowError, asked
from smartplay_tools.context.compacting import MOST_QUESTIONS
from smartplay_tools.context.strategies.custom import IN_FILES
from smartplay_tools.episode.carried import Carried
from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.evaluation.pages.report.episodes import episode_data
from smartplay_tools.players.prompt_reading import call
from smartplay_tools.providers.prices import Price
from smartplay_tools.records import Record, replay, resume, sent_prompts
from smartplay_tools.records.requests import requests_of
from smartplay_tools.types.messages import text_of
from tests.evaluation.runs import under_way

RPS = "RockPaperScissorBasic-v0"
MARKER = "[observation left the history window]"
ANSWER: sp.Message = {"role": "assistant", "content": "He likes Rock."}
ROCK = call("act", action="Rock")
NUMBERS = itertools.count()


def named(compact: Any, *, persistent: bool = True) -> str:
    """Register a class whose method is this function, and return its name."""
    name = f"tested-{next(NUMBERS)}"
    sp.register_strategy(name, type("Tested", (), {"persistent": persistent, "compact": compact}))
    return name


def begin(compact: Any, *, persistent: bool = True, session: bool = False, **options: Any) -> Any:
    given = {name: options.pop(name) for name in [*options] if name in sp.Budget.model_fields}
    given = {"history": None, "stalled_turns": None, "strategy": named(compact, persistent=persistent), **given}
    record = options.pop("transcript", [])
    episode = sp.Episode(RPS, seed=1, budget=sp.Budget(**given), transcript=record, **options)
    conversation = sp.AgentSession(episode, summaries=True) if session else sp.Conversation(episode)
    conversation.record = record
    return conversation


def play(conversation: Any, turns: int, reply: sp.Message = ROCK) -> list[sp.Prompt]:
    """Play turns, answer every question, and return the prompts to play."""
    played: list[sp.Prompt] = []
    while len(played) < turns and (prompt := conversation.prompt()) is not None:
        played += [] if prompt.purpose != "play" else [prompt]
        conversation.receive(ANSWER if prompt.purpose != "play" else reply)
    return played


def events_of(conversation: Any) -> list[Any]:
    return json.loads(json.dumps(conversation.record))


def error_of(compact: Any, **options: Any) -> str:
    """What a compactor ends an episode with, after three turns."""
    conversation = begin(compact, **options)
    play(conversation, 9)
    assert conversation.result.end_reason == "strategy_error"
    assert replay(events_of(conversation)).identical
    return conversation.result.error


def texts(prompt: sp.Prompt) -> list[str]:
    return [text_of(message) for message in prompt.messages[1:]]


def user(text: str) -> sp.Message:
    return {"role": "user", "content": text}


def same(self: Any, history: Any, room: Any) -> Any:
    return history


def after(turns: int, change: Any) -> Any:
    """A compactor that begins to change the history after some turns."""
    return lambda self, history, room: change([*history]) if len(history) > 2 * turns else history


# When, and what it is given.


def test_it_is_called_once_for_each_prompt_to_play_with_what_it_returned_and_what_came_since():
    seen: list[list[str]] = []

    def compact(self, history, room):
        seen.append([message["role"] for message in history])
        return [user("So far: nothing."), *history[1:]]

    conversation = begin(compact)
    conversation.prompt()
    assert conversation.prompt().messages[1] == user("So far: nothing.")
    play(conversation, 2)
    assert seen == [["user"], ["user", "assistant", "tool"]]
    assert not hasattr(compact, "persistent")  # which may be left out: it is True by default


def test_without_persistence_it_is_always_given_the_whole_conversation_and_shown_once():
    lengths: list[int] = []

    def compact(self, history, room):
        lengths.append(len(history))
        return history[-1:] if len(history) < 2 else history[-2:]

    conversation = begin(compact, persistent=False)
    prompts = play(conversation, 3)
    assert lengths == [1, 3, 5]
    assert [len(prompt.messages) for prompt in prompts] == [2, 4, 4]  # the task stands before a reply


def test_copies_are_given_and_only_what_comes_back_matters():
    kept: list[Any] = []

    def compact(self, history, room):
        back = copy.deepcopy([*history])
        for message in [*kept, *history]:
            message["content"] = "changed"
        kept.extend(back)
        return back

    for first, second in zip(play(begin(compact), 4), play(begin(same), 4), strict=True):
        assert first.messages == second.messages


def test_room_has_the_tokens_that_are_left_the_count_of_the_window_and_the_latest_prompt():
    rooms: list[Any] = []

    def compact(self, history, room):
        rooms.append((room, room.count(history)))
        return history

    conversation = begin(compact, prompt_tokens=2000, question_tokens=300)
    prompts = play(conversation, 2)
    counter = conversation.episode.counter
    for (room, tokens), prompt in zip(rooms, prompts, strict=True):
        total = counter.prompt(prompt.messages, prompt.tools)
        assert tokens == total - (2000 - room.tokens)
        assert room.question_tokens == 300
    assert [room.last for room, _ in rooms] == [None, counter.prompt(prompts[0].messages, prompts[0].tools)]
    rooms.clear()
    play(begin(compact), 1)
    assert (rooms[0][0].tokens, rooms[0][0].question_tokens) == (None, None)


def test_the_peak_of_prompts_is_of_those_to_play_where_a_question_may_be_longer():
    def compact(self, history, room):
        if len(history) > 3:
            yield [*history, {"role": "user", "content": "What did he play? " * 200}]
        return history

    conversation = begin(compact, prompt_tokens=900, question_tokens=2000)
    play(conversation, 3)
    record = Record(events_of(conversation))
    tokens = {view.get("purpose", "play"): view["tokens"] for view in record.views}
    assert tokens["compaction"] > 900
    assert record.peak_prompt_tokens == tokens["play"] <= 900


def test_it_is_not_asked_where_system_message_and_tools_alone_do_not_fit():
    calls: list[int] = []
    episode = begin(same, notes_tokens=400).episode
    cap = episode.counter.prompt(episode.head, episode.tools) + 50
    conversation = begin(lambda self, h, r: calls.append(1) or h, notes_tokens=400, prompt_tokens=cap)
    play(conversation, 3, call("take_notes", text="word " * 390))
    assert conversation.result.end_reason == "prompt_tokens"
    assert len(calls) == conversation.result.turns == 1
    assert replay(events_of(conversation)).identical


# What stays in view.


def test_a_pinned_manual_and_the_newest_notes_are_in_the_system_message():
    conversation = begin(lambda self, h, r: h[-1:] if len(h) < 2 else h[-2:], notes_tokens=9, manual="pinned")
    play(conversation, 1, call("take_notes", text="Rock wins"))
    system = text_of(play(conversation, 1)[0].messages[0])
    assert conversation.episode.manual_text in system
    assert system.endswith("\n\ntake_notes:\nRock wins")
    play(conversation, 1, call("take_notes", text=" "))
    assert "take_notes:" not in text_of(play(conversation, 1)[0].messages[0])
    assert all(sent.sha256 == sent.recorded_sha256 for sent in sent_prompts(events_of(conversation)))


def test_a_manual_that_was_read_is_a_result_and_can_be_lost_and_read_again():
    conversation = begin(lambda self, h, r: [h[0], *h[-2:]] if len(h) > 2 else h)
    play(conversation, 1, call("read_manual"))
    manual = conversation.episode.manual_text
    (prompt,) = play(conversation, 1)
    assert texts(prompt)[-1] == manual
    assert manual not in text_of(prompt.messages[0])
    (prompt,) = play(conversation, 1, call("read_manual"))
    assert manual not in str(prompt.messages)
    assert texts(play(conversation, 1)[0])[-1] == manual
    whole = [message for turn in Record(events_of(conversation)).turns for message in turn.messages]
    assert [text_of(message) for message in whole].count(manual) == 2


# What comes back.


def respelled(message: Any) -> Any:
    """The same message as frameworks write it."""
    spelled = {**message, "content": [{"type": "text", "text": text_of(message)}], "extra": {1, 2}, "name": "agent"}
    if message.get("tool_calls"):
        (only,) = message["tool_calls"]
        arguments = json.dumps(json.loads(only["function"]["arguments"]), indent=1)
        spelled["tool_calls"] = [{**only, "function": {**only["function"], "arguments": arguments}}]
        spelled.pop("reasoning_content", None)
    return spelled


def test_a_message_that_says_the_same_is_the_same_however_it_is_spelled():
    thinking: sp.Message = {**ROCK, "reasoning_content": "Rock is best.", "provider_items": [{"signature": "x"}]}
    conversation = begin(lambda self, h, r: tuple(respelled(message) for message in h))
    plain = begin(same)
    for first, second in zip(play(conversation, 4, thinking), play(plain, 4, thinking), strict=True):
        assert first.messages == second.messages
    assert conversation.episode.stats.rewrites == 0
    assert conversation.view.shown_steps == 3


@pytest.mark.parametrize("persistent", [True, False])
def test_marks_on_messages_are_given_again_and_shown_to_nobody(persistent):
    seen: list[list[Any]] = []

    def compact(self, history, room):
        seen.append([message.get("meta") for message in history])
        own = history[:1] if persistent and len(seen) > 1 else [{**user("So far."), "meta": "summary"}, *history[:1]]
        return [*own, *({**message, "meta": at} for at, message in enumerate(history[1:]))]

    conversation = begin(compact, persistent=persistent)
    prompts = play(conversation, 3)
    marks = [["summary", None, None, None], ["summary", 0, 1, 2, None, None]]
    assert seen[1:] == (marks if persistent else [[None] * 3, [None, 0, 1, None, None]])
    assert not any("meta" in message for prompt in prompts for message in prompt.messages)
    assert "meta" not in json.dumps(events_of(conversation))
    conversation.episode.close()
    assert replay(events_of(conversation)).differences == []


def test_of_replies_that_say_the_same_each_stays_itself():
    conversation = begin(lambda self, h, r: [{**message} for message in h], tool_calls=None)
    for thought in ("a", "b"):
        play(conversation, 1, {"role": "assistant", "content": "Hm", "reasoning_content": thought})
    (prompt,) = play(conversation, 1)
    assert [m["reasoning_content"] for m in prompt.messages if m["role"] == "assistant"] == ["a", "b"]


def test_other_messages_are_its_own_and_show_no_observation():
    def compact(self, history, room):
        for message in history:
            if message["role"] == "tool":
                message["content"] = "[cleared]"
        return history

    conversation = begin(compact)
    prompts = play(conversation, 3)
    assert texts(prompts[-1])[-1] == "[cleared]"
    assert conversation.view.shown_steps == 0
    assert conversation.episode.stats.blind_prompts == 2


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda h: None, "It has returned nothing: return the history, also where it was changed in place."),
        (iter, "Messages are a list, not list_iterator. Return list(...) of it."),
        (lambda h: (m for m in h), "What is yielded is a question, a list of messages, not dict: yield [message]"),
        (lambda h: "text", "Messages are a list, not str."),
        (lambda h: [*h, "text"], "Message 7 cannot be sent"),
        (lambda h: [*h, {"role": "model", "content": "x"}], "Message 7 cannot be sent"),
        (lambda h: [*h, user(b"x")], "Message 7 cannot be sent: InvalidArgumentError: Its content is bytes."),  # type: ignore[arg-type]
        (lambda h: [*h, user([{"type": "image", "sha256": "0" * 64}])], "Message 7 cannot be sent"),  # type: ignore[arg-type]
        (lambda h: [*h, user(" \n")], "Message 7 is empty."),
        (lambda h: [*h, ANSWER], "Message 7 is the last, and a reply."),
        (lambda h: h[:-1], "Message 5 is the last, and a call has no result."),
        (lambda h: [h[0], h[2], *h[3:]], "Message 1 is a result without its call."),
        (lambda h: [*h[:2], user("between"), *h[2:]], "Message 2 stands between a call and its result."),
        (lambda h: [*h, *h[1:3]], "Message 7 has the id of another call."),
    ],
)
def test_what_no_provider_could_take_ends_the_episode_with_the_number_of_the_message(change, sentence):
    assert error_of(after(3, change)).startswith(f"StrategyError: {sentence}")


def test_an_exception_ends_the_episode_with_its_traceback_and_the_score_so_far_counts():
    conversation = begin(after(3, lambda h: h["no such place"]))
    play(conversation, 9)
    assert conversation.result.error.startswith("TypeError: ")
    assert conversation.result.steps == 3
    end = events_of(conversation)[-1]
    assert "no such place" in end["traceback"]
    assert replay(events_of(conversation)).identical


def test_what_it_was_given_is_never_at_fault():
    example: list[sp.Message] = [user("An example:"), {"role": "assistant", "content": ""}]
    episode = sp.Episode(RPS, seed=1, budget=sp.Budget(strategy=named(lambda self, h, r: [*h])))
    conversation = sp.Conversation(episode, head=example)
    assert len(conversation.prompt().messages) == 4


def test_system_messages_may_stand_anywhere_and_halves_of_characters_are_joined():
    note: sp.Message = {"role": "system", "content": "\ud83d\ude00 Note."}
    (prompt,) = play(begin(lambda self, h, r: [note, *h]), 1)
    assert texts(prompt)[0] == "\U0001f600 Note."


# The cap.


def test_turns_leave_the_prompt_oldest_first_and_stay_in_the_history():
    lengths: list[int] = []

    def compact(self, history, room):
        lengths.append(len(history))
        return history

    conversation = begin(compact, prompt_tokens=700)
    dropping = begin(same, prompt_tokens=700, strategy=None)
    for first, second in zip(play(conversation, 20), play(dropping, 20), strict=True):
        assert first.messages == second.messages
        assert conversation.view.tokens == dropping.view.tokens <= 700
        assert conversation.view.prefix_tokens == dropping.view.prefix_tokens
    assert lengths[-1] == 39
    stats = conversation.episode.stats
    assert stats.over_prompts == conversation.view.dropped_turns > 9
    assert stats.over_peak > 1000


def test_what_stands_before_the_first_reply_leaves_after_the_turns_and_the_task_stands_in_for_it():
    long = user("word " * 500)
    conversation = begin(after(2, lambda h: [long, user("short"), *h[-4:]]), prompt_tokens=700)
    prompt = play(conversation, 3)[-1]
    assert texts(prompt)[0] == "short"
    assert len(prompt.messages) == 4
    conversation = begin(after(2, lambda h: [long, *h[-4:]]), prompt_tokens=700)
    assert texts(play(conversation, 3)[-1])[0] == texts(play(begin(same), 1)[0])[0]


# Age.


def test_results_age_by_the_date_of_their_call_and_words_do_not():
    def compact(self, history, room):
        for message in history:
            if message["role"] == "tool" and message["content"] != MARKER:
                message["content"] += " (edited)"
        return [user("Words of old."), *history]

    conversation = begin(compact, history=1)
    prompt = play(conversation, 5)[-1]
    results = [text_of(message) for message in prompt.messages if message["role"] == "tool"]
    assert [text == MARKER for text in results] == [True, True, False, False]
    assert texts(prompt).count("Words of old.") == 5
    assert all(sent.sha256 == sent.recorded_sha256 for sent in sent_prompts(events_of(conversation)))


# Questions.


def summing(self: Any, history: Any, room: Any) -> Any:
    if len(history) < 7:
        return history
    reply = yield [*history, user("Summarise.")]
    return [user(f"Summary: {reply['content']}"), *history[-2:]]


def test_a_question_is_a_prompt_without_options_and_its_reply_is_no_turn():
    conversation = begin(summing)
    play(conversation, 3)
    question = conversation.prompt()
    assert question.purpose == "compaction"
    assert question.purpose == "compaction"
    assert question.messages[-1] == user("Summarise.")
    assert question.tool_choice == "none"  # it has calls, so it has tools
    assert question.tools == conversation.episode.tools
    assert conversation.receive({**ROCK, "content": "He likes Rock."}) == []
    assert conversation.episode.stats.refused_calls == 1
    prompt = conversation.prompt()
    assert texts(prompt)[0] == "Summary: He likes Rock."
    assert conversation.episode.stats.turns == 3
    tokens = conversation.episode.stats.tokens
    assert tokens.prompt > conversation.episode.counter.prompt(question.messages, question.tools)
    usages = [event for event in events_of(conversation) if event["event"] == "usage"]
    assert usages[-1]["purpose"] == "compaction"


def test_a_question_without_calls_has_no_tools_and_an_empty_answer_is_an_answer():
    def compact(self, history, room):
        reply = yield [{"role": "system", "content": "Be short."}, user("1. Rock\n2. Paper\nWhich?")]
        return [user(f"Said: {reply['content']!r}"), *history[1:]]

    conversation = begin(compact)
    question = conversation.prompt()
    assert (question.tools, question.tool_choice) == ((), "auto")
    assert question.settings({"tool_choice": "required", "temperature": 0}) == {"temperature": 0}
    conversation.receive({"role": "assistant", "content": None})
    assert texts(conversation.prompt())[0] == "Said: ''"


@pytest.mark.parametrize("player", ["rule", "rule-notes", "random", "first", "oracle"])
def test_scripted_players_answer_questions_in_words_with_the_newest_notes(player):
    def compact(self, history, room):
        first = yield [user("1. Rock\n2. Paper\nWhich?")]
        second = yield [user('Notes: {"clock":1}'), user('Notes: {"clock":2}'), user("1. Rock\n2. Paper\nWhich?")]
        return [user(f"{bool(first['content'])} {second['content']}"), *history[1:]]

    conversation = begin(compact, tool_calls=3)
    sp.play(conversation, sp.get_player(player, seed=0))
    record = Record(events_of(conversation))
    assert record.result.questions == 2 * record.result.turns
    assert text_of(record.questions[1]["reply"]) == 'Notes: {"clock":2}'


def test_a_question_over_its_cap_is_refused_and_what_the_compactor_does_then_counts():
    def compact(self, history, room):
        try:
            yield [user("word " * 500)]
        except ContextOverflowError as error:
            return [user(str(error)), *history[1:]]

    conversation = begin(compact, prompt_tokens=900, question_tokens=200)
    assert texts(conversation.prompt())[0] == "The question has 508 tokens, and its cap is 200."
    result = conversation.episode.stats
    assert (result.questions, result.refused_questions, result.tokens.prompt) == (1, 1, 0)
    (question,) = Record(events_of(conversation)).questions
    assert (question["reply"], question["tokens"], len(question["messages"])) == (None, 508, 1)
    assert "ContextOverflowError" in error_of(lambda self, h, r: (yield [user("word " * 500)]), prompt_tokens=490)


def test_an_empty_list_is_a_prompt_of_head_and_task():
    conversation = begin(after(1, lambda h: []), persistent=False)
    prompts = play(conversation, 4)
    assert [len(prompt.messages) for prompt in prompts] == [2, 2, 2, 2]
    assert prompts[-1].messages == prompts[0].messages
    assert len(play(begin(lambda self, history, room: []), 3)) == 3
    conversation.episode.close()
    assert replay(events_of(conversation)).differences == []


def test_asynchronous_methods_and_plain_functions_are_compactors():
    async def compact(self, history, room):
        return [*history[-1:]] if len(history) < 2 else [*history[-2:]]

    assert [len(prompt.messages) for prompt in play(begin(compact), 3)] == [2, 4, 4]

    def newest(history, room, turns=1):
        return [*history[-2 * turns :]]

    async def later(history, room):
        return newest(history, room)

    for function in (newest, later):
        name = f"tested-{next(NUMBERS)}"
        sp.register_strategy(name, function)
        with sp.Episode(
            RPS, seed=1, budget=sp.Budget(history=None, strategy=name), transcript=(events := [])
        ) as episode:
            assert len(play(sp.Conversation(episode), 4)[-1].messages) == 4
            episode.close()
        assert replay(events, calls_compactor=True).differences == []


def test_one_question_for_each_message_that_was_given_is_not_too_many():
    def compact(self, history, room):
        for message in history:
            yield [user(f"Shorten: {message['role']}")]
        return history

    conversation = begin(compact, persistent=False)
    assert len(play(conversation, 15)) == 15


def test_more_questions_than_sixteen_for_a_prompt_are_an_error():
    def compact(self, history, room):
        for _ in range(self.most):
            yield [user("Again?")]
        return history

    error = error_of(lambda self, h, r: (setattr(self, "most", MOST_QUESTIONS + 1), compact(self, h, r))[1])
    assert error == "StrategyError: It asks more than 16 questions for one prompt."
    conversation = begin(lambda self, h, r: (setattr(self, "most", MOST_QUESTIONS), compact(self, h, r))[1])
    assert len(play(conversation, 1)) == 1


@pytest.mark.parametrize("question", [user("x"), [], [ANSWER], [{"role": "tool", "tool_call_id": "?", "content": ""}]])
def test_a_question_is_checked_like_what_comes_back(question):
    def compact(self, history, room):
        yield question

    assert error_of(compact).startswith("StrategyError: ")


def test_a_spent_budget_or_a_failing_player_closes_the_generator():
    closed: list[str] = []

    def compact(self, history, room):
        try:
            yield [user("word " * 100)]
        finally:
            closed.append("closed")

    conversation = begin(compact, episode_tokens=50)
    assert conversation.prompt() is None
    assert (conversation.result.end_reason, closed) == ("episode_tokens", ["closed"])
    conversation = begin(compact)
    assert sp.play(conversation, sp.ScriptedPlayer([])).end_reason == "player_error"
    assert closed == ["closed"] * 2
    begin(compact).episode.close()


def test_another_player_can_answer_the_questions():
    first, second = sp.ScriptedPlayer([ROCK] * 9), sp.ScriptedPlayer([ANSWER] * 9)
    conversation = begin(summing, tool_calls=6)
    sp.play(conversation, first, compactor_player=second)
    assert {prompt.purpose for prompt in first.prompts} == {"play"}
    assert {prompt.purpose for prompt in second.prompts} == {"compaction"}
    again = begin(summing, tool_calls=6)
    asyncio.run(sp.aplay(again, sp.ScriptedPlayer([ROCK] * 9), compactor_player=sp.ScriptedPlayer([ANSWER] * 9)))
    for name in ("score", "questions", "rewrites", "tokens"):
        assert getattr(again.result, name) == getattr(conversation.result, name)


def test_an_option_of_the_player_names_the_other_player_of_a_run(tmp_path):
    budget = sp.Budget(history=None, strategy=named(summing), tool_calls=8)
    options = {"compactor_player": {"name": "rule-notes", "words": True}}
    given: Any = {"trials": 1, "budgets": [budget], "player_options": options, "executor": "inline"}
    run = sp.evaluate([RPS], ["random"], out=tmp_path / "run", **given)
    (row,) = run.rows
    assert row["player_options"] == options
    assert row["questions"] > 0
    record = Record.read(run.transcript(row["key"]), {"rule-notes": Price.per_million(1, 1)})
    assert len(requests_of(record).requests) == len(record.views)
    usages = [event for event in sp.read_transcript(run.transcript(row["key"])) if event["event"] == "usage"]
    asked = [usage["prompt"] + usage["reply"] for usage in usages if usage.get("purpose") == "compaction"]
    assert record.totals.cost == record.cost == record.question_cost == pytest.approx(sum(asked) / 1e6)
    with pytest.raises(InvalidArgumentError, match="compactor_player is the name of a player"):
        sp.evaluate([RPS], ["random"], out=tmp_path / "2", **{**given, "player_options": {"compactor_player": 3}})


def test_a_cap_on_cost_holds_at_the_price_of_the_player_that_is_asked(tmp_path):
    budget = sp.Budget(history=None, strategy=named(summing), tool_calls=40, reply_tokens=50)
    options, prices = {"compactor_player": {"name": "rule-notes", "words": True}}, {"random": Price.per_million(1, 1)}
    prices["rule-notes"] = Price.per_million(1000, 1000)
    given: Any = {"trials": 1, "budgets": [budget], "player_options": options, "executor": "inline", "prices": prices}
    free = sp.evaluate([RPS], ["random"], out=tmp_path / "free", **given)
    cost = Record.read(free.transcript(free.rows[0]["key"]), prices).totals.cost
    capped = sp.evaluate([RPS], ["random"], out=tmp_path / "capped", run_cost=0.7 * cost, **given)
    assert capped.status.paused == 1
    [attempt] = capped.folder.attempts()
    assert 0.2 * cost < Record.read(attempt, prices).totals.cost <= 0.7 * cost


def test_a_question_that_fails_is_billed_at_the_price_of_the_player_that_was_asked():
    """Its provider may have charged for it, and a call may be under way when the process dies."""
    options = {"compactor_player": "rule-notes"}
    prices = {"random": Price.per_million(1000, 1000), "rule-notes": Price.per_million(1, 1)}
    conversation = begin(summing, player="random", player_options=options)
    while (prompt := conversation.prompt()).purpose == "play":
        conversation.receive(ROCK)
    conversation.spend(sp.Usage(prompt=50, reply=7))
    record = Record(events_of(conversation), prices=prices)
    assert record.question_cost == pytest.approx(57 / 1e6)
    assert record.open_call.unknown_cost == pytest.approx(prompt.tokens / 1e6)
    assert episode_data("", record, {})["turns"][-1]["questions"] == 0
    conversation.episode.close()
    assert replay(events_of(conversation)).identical


COUNTING = """
import smartplay_tools as sp

class Counting:
    name, asked = "counting", 0
    def __init__(self, *, seed): pass
    def reply(self, prompt):
        self.asked += 1
        return sp.Reply({"role": "assistant", "content": f"Answer {self.asked}."})
"""


def test_the_other_player_has_its_state_again_where_an_episode_goes_on(tmp_path):
    file = tmp_path / "counting.py"
    file.write_text(COUNTING)
    given: Any = {"trials": 1, "budgets": [sp.Budget(history=None, strategy=named(summing), tool_calls=12)]}
    given |= {"player_options": {"compactor_player": f"{file}:Counting"}, "executor": "inline", "out": tmp_path / "run"}
    run = sp.evaluate([RPS], ["random"], **given)
    key = run.rows[0]["key"]
    answers = [event["reply"]["content"] for event in Record.read(run.transcript(key)).questions]
    under_way(tmp_path / "run", key)
    again = Record.read(sp.evaluate([RPS], ["random"], **given).transcript(key))
    assert again.resumes
    assert [event["reply"]["content"] for event in again.questions] == answers


def test_an_agent_session_answers_questions_only_where_the_host_makes_further_calls():
    session = begin(summing, session=True)
    for _ in range(5):
        reply = session.ask(lambda prompt: sp.Reply(ANSWER if prompt.purpose != "play" else ROCK))
        for opened in session.receive(reply.message):
            session.answer(opened.id)
    assert session.episode.stats.questions == 1
    with pytest.raises(InvalidArgumentError, match="strategy takes additional model calls"):
        sp.AgentSession(sp.Episode(RPS, seed=1, budget=sp.Budget(strategy=named(same))))
    with pytest.raises(InvalidArgumentError, match="head of an episode cannot change"):
        session.change_head([user("Other words.")], [])


# asked.


def test_blocking_and_asynchronous_code_asks_in_a_thread():
    threads: set[str] = set()

    def work(ask: Any) -> Any:
        threads.add(threading.current_thread().name)
        return [user(ask([user("One?")])["content"])]

    async def slow(ask: Any) -> Any:
        await asyncio.sleep(0)
        return work(ask)

    for each in (work, slow):
        (prompt,) = play(begin(lambda self, h, r, each=each: asked(each)), 1)
        assert texts(prompt) == ["He likes Rock."]
    assert threads == {"smartplay-tools compactor"}


def test_a_refused_question_is_the_exception_that_the_framework_expects():
    class TooLong(Exception):  # noqa: N818
        pass

    def work(ask: Any) -> Any:
        with pytest.raises(TooLong, match="its cap is 490"):
            ask([user("word " * 500)])
        raise RuntimeError("It gives up.")

    error = error_of(lambda self, h, r: asked(work, overflow=TooLong), prompt_tokens=490)
    assert error == "RuntimeError: It gives up."


def test_a_thread_that_asks_ends_once_the_generator_is_closed():
    ended = threading.Event()

    def work(ask: Any) -> None:
        try:
            while True:
                try:
                    ask([user("One?")])
                except Exception:  # as frameworks do
                    continue
        finally:
            ended.set()

    conversation = begin(lambda self, h, r: asked(work))
    conversation.prompt()
    conversation.episode.close()
    assert ended.wait(5)


# Record, replay, resume.


def test_a_compactor_that_rewrites_otherwise_differs_where_it_is_called_and_is_resumed():
    class Other:
        made = 0

        def compact(self, history, room):
            Other.made += 1
            return [user(f"Random: {Other.made}"), *history[1:]]

    sp.register_strategy("other-every-time", Other)
    conversation = begin(same, strategy="other-every-time")
    prompts = play(conversation, 3)
    events = events_of(conversation)
    assert replay(events).differences == []
    assert "rewrite, turn 0" in replay(events, calls_compactor=True).differences[0]
    with resume(events, transcript=[]) as resumed:
        prompt = resumed.conversation.prompt()
        assert texts(prompt)[1:3] == texts(prompts[2])[1:3]


def test_a_resumed_compactor_is_called_from_the_beginning_and_must_ask_what_it_asked():
    class Remembering:
        question = "Which?"

        def __init__(self):
            self.answers = []

        def compact(self, history, room):
            self.answers.append((yield [user(self.question)])["content"])
            return [user(" ".join(self.answers)), *history[1:]]

    sp.register_strategy("remembering", Remembering)
    conversation = begin(same, strategy="remembering")
    play(conversation, 4)
    events = events_of(conversation)
    (prompt,) = play(conversation, 1)
    for at in range(2, len(events)):
        with resume(events[:at], transcript=[]) as resumed:
            played = resumed.conversation.episode.stats.turns
            assert play(resumed.conversation, 5 - played)[-1].messages == prompt.messages
    Remembering.question = "Another one?"
    with pytest.raises(TranscriptError, match="does not ask the question that is on record"):
        resume(events, transcript=[])


def test_a_record_is_replayed_without_its_compactor_which_has_to_be_named_to_be_called(tmp_path, monkeypatch):
    file = tmp_path / "kept.py"
    file.write_text("class Kept:\n    def compact(self, history, room):\n        return history[-1:] + history[:0]\n")
    conversation = begin(same, strategy=f"{file}:Kept")
    play(conversation, 1)
    events = events_of(conversation)
    monkeypatch.setattr(IN_FILES, "read", {})  # as in a process in which nobody has named the file
    assert not replay(events).differences
    for again in (lambda: resume(events, transcript=[]), lambda: replay(events, calls_compactor=True)):
        with pytest.raises(InvalidArgumentError, match="name it with --strategy"):
            again()


# Measures and combinations.


def test_rewrites_are_what_is_neither_what_came_back_nor_new():
    def compact(self, history, room):
        return [user("Summary."), *history[3:]]

    conversation = begin(compact, persistent=False)
    play(conversation, 4)
    assert conversation.episode.stats.rewrites == 2  # the summary, then without the first turn; then the same and more


def test_a_prompt_is_blind_if_the_newest_observation_is_neither_shown_nor_told():
    blind = begin(lambda self, h, r: [*h[:1], user("Forget."), *h[-3:-2]])
    play(blind, 3)
    assert blind.episode.stats.blind_prompts == 2
    told = begin(lambda self, h, r: [user("You saw: " + " ".join(text_of(message) for message in h))])
    play(told, 3)
    assert told.episode.stats.blind_prompts == 0


def test_recall_searches_what_is_not_visible():
    conversation = begin(lambda self, h, r: [h[0], *h[-2:]] if len(h) > 2 else h, recall_tokens=500, history=9)
    play(conversation, 3)
    assert {form.step for form in conversation.view.forms} == {None, 2}
    conversation.prompt()
    (result,) = conversation.receive(call("recall", query="0-9"))
    assert result.data["recalled"] == [1, 2]


def test_a_carried_message_can_be_lost():
    config = begin(same, notes_tokens=20).episode.config.model_copy(update={"carry": "notes"})
    lost = named(lambda self, h, r: h[:1] + h[2:])
    config = config.model_copy(update={"budget": config.budget.model_copy(update={"strategy": lost})})
    carried = Carried(record="0" * 32, result="The last.", notes="Rock")
    with sp.Episode.from_config(config, carried=carried) as episode:
        assert len(sp.Conversation(episode).prompt().messages) == 2


class Moving:
    """Shows the first picture that it is given in a message of its own, and makes all others small."""

    def compact(self, history, room):
        shown = [message for message in history if isinstance(message["content"], list)]
        earlier = [user([{"type": "text", "text": "Earlier:"}, m["content"][-1]]) for m in shown[:1]]  # type: ignore[arg-type]
        for message in shown:
            message["content"] = [{**part, "width": 1} for part in message["content"]]
        return [*history[:1], *earlier, *[message for message in history[1:] if message["role"] != "user"]]


def test_pictures_are_those_that_were_given_and_leave_by_their_number():
    sp.register_strategy("moving-pictures", Moving)
    budget = sp.Budget(history=None, newest_pictures=1, strategy="moving-pictures", stalled_turns=None)
    events: list[Any] = []
    with sp.Episode("Crafter-v0", seed=1, budget=budget, observation="both", transcript=events) as episode:
        conversation = sp.Conversation(episode)
        prompt = play(conversation, 4, call("act", action="Move West"))[-1]
    pictured = [m["content"][-1] for m in prompt.messages if isinstance(m["content"], list)]
    assert all(part["width"] > 1 for part in pictured)  # as recorded
    assert [isinstance(m["content"], list) for m in prompt.messages if m["role"] == "tool"] == [False, False, True]
    assert prompt.pictures.keys() == {part["sha256"] for part in pictured}
    assert len(pictured) == 2  # words of a compactor do not age, and nor does a picture beside them
    assert conversation.view.shown_steps == 3
    assert all(sent.sha256 == sent.recorded_sha256 for sent in sent_prompts(json.loads(json.dumps(events))))
    assert replay(json.loads(json.dumps(events))).differences == []


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"beyond_history": "mask", "history": 3}, "so beyond_history would do nothing"),
        ({"summary_tokens": 30, "slack": 0.5, "prompt_tokens": 900}, "so summary_tokens would do nothing"),
        ({"first_turns": 2, "prompt_tokens": 900}, "so first_turns would do nothing"),
        ({"slack": 0.5}, "so slack would do nothing"),
        ({"own_words": 3}, "so own_words would do nothing"),
        ({"context": "host"}, 'context="host" leaves the past to the host'),
        ({"strategy": None, "question_tokens": 9}, "question_tokens caps the questions of a compactor"),
    ],
)
def test_what_chooses_itself_is_refused_beside_it(given, sentence):
    with pytest.raises(InvalidArgumentError, match=sentence):
        begin(same, **given)


def test_a_class_needs_one_of_two_methods():
    sp.register_strategy("neither", type("Neither", (), {}))
    with pytest.raises(InvalidArgumentError, match="needs one of two methods"):
        begin(same, strategy="neither")


def test_asynchronous_conversations_call_it_in_a_thread():
    threads: set[int] = set()

    def compact(self, history, room):
        threads.add(threading.get_ident())
        time.sleep(0)
        return history

    async def playing() -> None:
        conversation = begin(compact)
        for _ in range(3):
            await conversation.aprompt()
            await conversation.areceive(ROCK)

    asyncio.run(playing())
    assert threading.get_ident() not in threads


def test_a_framework_acts_at_four_fifths_of_the_room_unless_it_is_told_when():
    for told, room, limit in ((None, 1_000, 800), (300, 1_000, 300), (300, None, 300)):
        compactor = ImportedCompactor(told)
        compactor.room = SimpleNamespace(tokens=room)
        assert compactor.limit == limit
