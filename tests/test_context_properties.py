"""The context window with arbitrary conversations: every prompt is checked by `tests/checker.py`."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

import smartplay_tools as sp
from smartplay_tools.context import ContextWindow
from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.tokens import get_tokenizer
from smartplay_tools.episode.budgets import refused_strategy
from smartplay_tools.errors import PromptOverflowError
from smartplay_tools.records.prompts import recorded_turns, sent_prompts
from tests import checker, scripts

CASES = settings(deadline=None, derandomize=True, database=None)
FEW = settings(CASES, max_examples=CASES.max_examples // 6)

budgets = st.fixed_dictionaries(
    {
        "history": scripts.histories,
        "slack": scripts.slacks,
        "room": st.one_of(st.none(), st.integers(0, 120), st.integers(0, 500)),
        "reply_tokens": st.sampled_from([None, None, 1, 40]),
        "episode": st.sampled_from([None, None, None, 700, 3000]),
        "result_tokens": st.sampled_from(["auto", "auto", None, 1, 7, 20]),
        "tool_calls": st.sampled_from(["game", "game", "game", 5]),
        "stalled_turns": scripts.stalls,
    }
)


strategic = st.builds(lambda plain, strategy: {**plain, **strategy}, budgets, scripts.strategies)


def budget_of(drawn: dict[str, Any], head: int, game: str, tokenizer: Any) -> sp.Budget:
    """A budget near the size of the head, where it bites; a summary that cannot be asked for is left out."""
    drawn = dict(drawn)
    room, episode = drawn.pop("room"), drawn.pop("episode")
    prompt_tokens = None if room is None else head + scripts.strategy_tokens(drawn, tokenizer) + room
    drawn |= {"prompt_tokens": prompt_tokens, "episode_tokens": None if episode is None else head + episode}
    for change in (
        {},
        {"summary_tokens": None},
        {"beyond_history": "drop"},
        {"first_turns": None},
        {"recall_tokens": None},
        {"beyond_result": "cut"},
    ):
        drawn |= change
        if refused_strategy(sp.Budget(**drawn), sp.GAMES[game], context="window") is None:
            break
    return sp.Budget(**drawn)


conversations = st.fixed_dictionaries(
    {
        "game": st.sampled_from(scripts.GAMES),
        "script": scripts.scripts,
        "answers": scripts.answers,
        "host": st.booleans(),
        "manual": st.sampled_from(["tool", "tool", "tool", "pinned", "none"]),
        "batch": st.sampled_from(["all", "all", "first_act"]),
        "seed": st.integers(0, 3),
        "host_seed": st.one_of(st.none(), st.integers(0, 10**6)),
    }
)


def play_and_judge(drawn: dict[str, Any], budget: dict[str, Any], tokenizer: Any) -> scripts.Played:
    head = scripts.head_tokens(drawn["game"], tokenizer, host=drawn["host"], manual=drawn["manual"])
    played = scripts.converse(**drawn, budget=budget_of(budget, head, drawn["game"], tokenizer), tokenizer=tokenizer)
    whole = scripts.whole_observations(played.events) if isinstance(tokenizer, scripts.Words) else None
    checker.check_episode(played.events, played.sent, tokenizer.count, whole=whole)
    return played


@CASES
@given(conversations, strategic)
def test_every_prompt_under_every_strategy_is_what_the_rules_say(drawn: dict[str, Any], budget: dict[str, Any]) -> None:
    play_and_judge(drawn, budget, scripts.Words())


@CASES
@given(conversations, budgets)
def test_every_prompt_of_a_conversation_is_what_the_rules_say(drawn: dict[str, Any], budget: dict[str, Any]) -> None:
    play_and_judge(drawn, budget, scripts.Words())


@FEW
@given(conversations, strategic)
def test_and_so_with_the_real_tokenizer(drawn: dict[str, Any], budget: dict[str, Any]) -> None:
    play_and_judge(drawn, budget, get_tokenizer())


def judged(judge: checker.Judge, k: int, window: ContextWindow) -> None:
    """Compare a view with the judge's; where the pinned parts do not fit, there must be none."""
    expected = judge.view(k)
    if expected is None:
        with pytest.raises(PromptOverflowError):
            window.view()
    else:
        view = window.view()
        seen = scripts.view_as_json(view)
        for name, value in expected.items():
            assert seen[name] == value, f"{name} of {k} turns: {seen[name]!r}, judged {value!r}"
        checker.check_prompt(seen["messages"], judge.tools, judge, k)


@CASES
@given(
    conversations,
    st.lists(
        st.tuples(scripts.histories, scripts.slacks, st.integers(0, 400), scripts.stalls, scripts.strategies),
        max_size=2,
    ),
    st.lists(st.integers(0, 9), max_size=4),
)
def test_a_view_depends_on_the_turns_alone(
    drawn: dict[str, Any], budgets: list[tuple[int | None, float, int, int | None, dict[str, Any]]], visits: list[int]
) -> None:
    """Whichever views were taken before, and however often. Summaries are asked for whether or not a view was taken."""
    words = scripts.Words()
    played = scripts.converse(**drawn, budget=sp.Budget(notes_tokens=12, recall_tokens=40), tokenizer=words)
    [head] = [event for event in played.events if event["event"] == "head"]
    episode, turns = played.conversation.episode, played.conversation.turns
    tools = [*episode.tools, scripts.NOTE]
    plain = checker.turns_of(played.events)
    size = scripts.head_tokens(drawn["game"], words, host=drawn["host"], manual=drawn["manual"])
    for history, slack, room, stalls, strategy in budgets:
        numbers = {
            "history": history,
            "slack": slack,
            "stalled_turns": stalls,
            **strategy,
            "notes_tokens": 12,
            "recall_tokens": 40,
        }
        numbers["prompt_tokens"] = size + room + scripts.strategy_tokens(numbers, words)
        if refused_strategy(sp.Budget(**numbers), sp.GAMES[drawn["game"]], context="window"):
            numbers["summary_tokens"] = numbers["first_turns"] = None
        budget = episode.budget.model_copy(update=numbers)
        judge = checker.Judge(head["messages"], head["tools"], plain, numbers, words.count)
        window = ContextWindow(head["messages"], tools, budget, episode.counter)
        for number in range(len(turns) + 1):
            if judge.asks(number):
                if number in visits:
                    seen, expected = scripts.view_as_json(window.view()), judge.request(number)
                    assert {name: seen[name] for name in seen if name != "purpose"} == without(expected, "covers")
                judge.summaries.append((number, window.answer(f"{number} turns were played.")["text"]))
            if number in visits or number == len(turns):
                judged(judge, number, window)
            if number < len(turns):
                window.append(turns[number])
        if slack == 0:  # no prompt differs from one of version 2
            fold = Strategies(budget, episode.counter, Wording.of("v2"))
            before = ContextWindow(head["messages"], tools, budget, episode.counter, fold)
            for number, turn in enumerate(turns, 1):
                before.append(turn)
                judged(judge, number, before)
        if budget.summary_tokens is None:
            judged(judge, len(turns), ContextWindow.of(turns, head["messages"], tools, budget, episode.counter))


def without(values: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != name}


@CASES
@given(conversations, strategic)
def test_a_reload_from_the_transcript_shows_the_same(
    tmp_path_factory: pytest.TempPathFactory, drawn: dict[str, Any], budget: dict[str, Any]
) -> None:
    tokenizer = get_tokenizer("approximate")
    head = scripts.head_tokens(drawn["game"], tokenizer, host=drawn["host"], manual=drawn["manual"])
    played = scripts.converse(**drawn, budget=budget_of(budget, head, drawn["game"], tokenizer), tokenizer=tokenizer)
    rebuilt = list(sent_prompts(played.events))
    assert [scripts.as_json(one.prompt.messages) for one in rebuilt][: len(played.sent)] == [
        one["messages"] for one in played.sent
    ]
    assert all(one.sha256 == one.recorded_sha256 for one in rebuilt)
    turns = recorded_turns(played.events)
    assert turns == list(played.conversation.turns)
    [start] = [event for event in played.events if event["event"] == "head"]
    episode = played.conversation.episode
    window = ContextWindow(start["messages"], [*episode.tools, scripts.NOTE], episode.budget, episode.counter)
    summaries = [event["message"]["content"] or "" for event in played.events if event["event"] == "summary"]
    left = iter(turns)
    for one in played.sent:
        view = window.view()
        seen = scripts.view_as_json(view)
        if view.purpose != "play":
            window.answer(summaries[window.summaries])
        elif (turn := next(left, None)) is not None:
            window.append(turn)
        assert seen == {name: one[name] for name in seen}
    path = tmp_path_factory.mktemp("transcripts") / "episode.jsonl"
    path.write_text("".join(f"{line}\n" for line in map(json.dumps, played.events)), encoding="ascii")
    replayed = sp.replay(path)
    assert replayed.identical, replayed.differences
    assert replayed.result == played.result, (replayed.result, played.result)
