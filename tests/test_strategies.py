"""What a budget says of the past, by example: masked turns, notes and summaries, and everything that can go wrong."""

from __future__ import annotations

import json
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context import strategies
from smartplay_tools.context.strategies import KINDS
from tests import scripts
from tests.test_conversation import acting, calling, saying

RPS, BANDIT = "RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0"
WORDS = scripts.Words()


def begin(events: list[Any] | None = None, **budget: Any) -> sp.Conversation:
    episode = sp.Episode(RPS, seed=1, tokenizer=WORDS, transcript=events, budget=sp.Budget(**budget))
    return sp.Conversation(episode)


def room(tokens: int, **budget: Any) -> dict[str, Any]:
    """A budget with `tokens` beside the head, the schemas and what summaries reserve."""
    strategy = scripts.strategy_tokens(budget, WORDS)
    plain = sp.Episode(RPS, seed=1, tokenizer=WORDS)
    head = plain.counter.prompt(plain.head, plain.tools)
    return {"prompt_tokens": head + strategy + tokens, "result_tokens": None, **budget}


def noting(text: Any) -> tuple[str, str]:
    return "take_notes", sp.transcript.hashing.canonical_json({"text": text}).decode()


def summarised(events: list[Any] | None = None, **budget: Any) -> sp.Conversation:
    """A conversation whose next prompt is its first for a summary."""
    conversation = begin(events, **room(140, **{"summary_tokens": 12, "slack": 0.5, **budget}))
    while (prompt := conversation.prompt()) is not None and prompt.purpose == "play":
        conversation.receive(acting(say="Rock it is."))
    assert prompt is not None
    return conversation


class TestMasking:
    @pytest.mark.parametrize(
        ("budget", "dropped"),
        [
            # A block has 149 tokens, and of 59 or 60 in a turn, turns 3, 6 and 8 begin one.
            (room(298, slack=0.5, history=None), [0, 0, 0, 0, 0, 3, 3, 6, 6, 6]),
            # A block has 2 steps, and turn 1 plays the second step.
            ({"slack": 0.5, "history": 3}, [0, 0, 0, 1, 1, 3, 3, 5, 5, 7]),
        ],
    )
    def test_turns_leave_in_blocks_of_tokens_and_of_steps(self, budget, dropped):
        conversation, seen = begin(**budget), []
        for _ in dropped:
            conversation.receive(acting())
            conversation.prompt()
            seen.append(conversation.view.dropped_turns)
        assert seen == dropped


@pytest.mark.parametrize(
    ("tool", "budget"), [("take_notes", {"notes_tokens": 5}), ("recall", {"recall_tokens": 400, "history": 1})]
)
@pytest.mark.parametrize(
    "arguments", ['{"text": 5}', '{"query": null}', "{}", '{"text": "1", "query": "2"}', "[]", "{", ""]
)
def test_arguments_that_are_no_text_are_malformed(tool, budget, arguments):
    conversation = begin(**budget)
    (result,) = conversation.receive(calling((tool, arguments)))
    assert result.is_error
    assert f"Call {tool} with" in result.text
    stats = conversation.episode.stats
    assert (stats.malformed_calls, stats.refused_notes, stats.recalls) == (1, 0, 0)
    assert conversation.latest_turn.notes is None


class TestNotes:
    @pytest.mark.parametrize(
        ("text", "kept", "counted", "answer"),
        [
            ("one two three", "kept", (0, 0), "Noted: 3 of 3 tokens."),
            ("word " * 9, None, (1, 0), "Error: These notes have 9 tokens, more than 3. The earlier notes stand."),
            (" ", "cleared", (0, 0), "Noted: 0 of 3 tokens."),
            (5, None, (0, 1), "Error: `text` must be a string"),
        ],
        ids=["accepted", "over the cap", "blank", "no text"],
    )
    def test_what_became_of_them_is_on_record_and_counted(self, text, kept, counted, answer):
        events: list[Any] = []
        conversation = begin(events, notes_tokens=3)
        (said,) = conversation.receive(calling(noting(text)))
        assert said.text.startswith(answer)
        conversation.episode.close()
        (call,) = [event for event in events if event["event"] == "call"]
        assert call["data"].get("notes") == kept
        result = events[-1]["result"]
        assert (result.get("refused_notes", 0), result["malformed_calls"]) == counted
        assert sp.replay(events, tokenizer=WORDS).identical


class TestSummaries:
    def test_one_is_asked_for_when_the_window_moves(self):
        conversation = summarised()
        prompt = conversation.prompt()
        assert (prompt.purpose, prompt.tool_choice) == ("summary", "none")
        assert [tool.name for tool in prompt.tools] == ["observe", "act", "read_manual"]
        assert prompt.messages[-1]["content"].startswith("The oldest turns above are about to leave your view.")
        turns = conversation.episode.stats.turns
        assert conversation.receive(saying("He likes Rock.")) == []
        after = conversation.prompt()
        assert after.purpose == "play"
        assert after.messages[2] == {
            "role": "user",
            "content": "Your summary of what has left your view:\nHe likes Rock.",
        }
        stats = conversation.episode.stats
        assert (stats.turns, stats.summaries) == (turns, 1)
        assert 0 < stats.tokens.summary_prompt < stats.tokens.prompt
        assert stats.tokens.summary_reply == 3 + 2 + 4

    def test_a_provider_that_fails_in_the_middle_ends_the_episode_and_it_can_be_resumed(self):
        class Failing(sp.ScriptedPlayer):
            def reply(self, prompt: sp.Prompt) -> sp.Reply:
                if prompt.purpose == "summary":
                    raise ConnectionError("gone")
                return sp.Reply(acting(say="Rock it is."))

        events: list[Any] = []
        budget = sp.Budget(**room(140, summary_tokens=12, slack=0.5))
        episode = sp.Episode(RPS, seed=1, tokenizer=WORDS, transcript=events, budget=budget)
        result = sp.play(episode, Failing([]))
        assert (result.end_reason, result.summaries) == ("player_error", 0)
        assert sp.replay(events, tokenizer=WORDS).identical
        again: list[Any] = []
        with sp.resume(events, transcript=again, tokenizer=WORDS) as resumed:
            assert resumed.conversation.prompt().purpose == "summary"
            resumed.conversation.receive(saying("He likes Rock."))
            assert resumed.conversation.prompt().purpose == "play"
        assert sp.replay(again, tokenizer=WORDS).identical

    @pytest.mark.parametrize(
        ("text", "cut", "empty"),
        [("He likes Rock.", False, False), ("word " * 30, True, False), ("", False, True), (" \n" * 40, False, True)],
        ids=["short", "too long", "empty", "white space"],
    )
    def test_what_became_of_one_is_on_record_and_counted(self, text, cut, empty):
        events: list[Any] = []
        conversation = summarised(events)
        conversation.receive(saying(text))
        conversation.episode.close()
        (summary,) = [event for event in events if event["event"] == "summary"]
        assert (summary["message"]["content"], summary["cut"], summary["empty"]) == (text, cut, empty)
        result = events[-1]["result"]
        assert [result.get(name, 0) for name in ("summaries", "cut_summaries", "empty_summaries")] == [1, cut, empty]
        assert sp.replay(events, tokenizer=WORDS).identical

    def test_nothing_can_be_added_between_the_request_and_the_next_turn(self):
        conversation = summarised()
        for _ in range(2):
            with pytest.raises(sp.InvalidArgumentError, match="between a reply and the next prompt"):
                conversation.add({"role": "user", "content": "Go on."})
            conversation.receive(saying("He likes Rock.")) if conversation.prompt().purpose == "summary" else None

    def test_a_summary_is_not_the_reply_that_a_host_waits_for(self):
        conversation = summarised()
        conversation.fail(ConnectionError("no route to host"))
        conversation.receive(saying("He likes Rock."))
        assert conversation.awaits_reply, "so that a host adds nothing now, whether or not the prompt has been made"
        conversation.episode.close()
        assert conversation.result.end_reason == "closed", "the failed attempt is forgotten"

    def test_play_answers_with_the_same_player_and_calls_on_turn_for_turns_only(self):
        asked, turns = [], []

        class Both(sp.ScriptedPlayer):
            def reply(self, prompt: sp.Prompt) -> sp.Reply:
                asked.append(prompt.purpose)
                return sp.Reply(saying("Rock.") if prompt.purpose == "summary" else acting(say="Rock it is."))

        budget = sp.Budget(**room(140, summary_tokens=12, slack=0.5), tool_calls=30)
        episode = sp.Episode(RPS, seed=1, tokenizer=WORDS, budget=budget)
        result = sp.play(episode, Both([]), on_turn=lambda conversation: turns.append(conversation))
        assert result.summaries == asked.count("summary") > 2
        assert result.turns == len(turns) == asked.count("play") == 30

    @pytest.mark.parametrize(
        ("budget", "why"),
        [
            ({"prompt_tokens": 900}, "slack 0"),
            ({"history": 1, "slack": 0.5}, "at every step"),
            ({"history": 0, "slack": 0.9}, "at every step"),
            ({"history": None, "slack": 0.5}, "nothing to summarise"),
            ({"beyond_history": "mask", "slack": 0.5}, "nothing to summarise"),
            ({"prompt_tokens": 280, "slack": 0.5}, "more that summary_tokens=12 needs"),
            ({"prompt_tokens": 900, "slack": 0.5, "summary_tokens": 900}, "more that summary_tokens=900 needs"),
        ],
    )
    def test_what_cannot_be_asked_for_is_refused_in_one_sentence(self, budget, why):
        with pytest.raises(sp.InvalidArgumentError, match=why) as refused:
            begin(**{"summary_tokens": 12, **budget})
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "strategy",
    [
        {"beyond_history": "mask"},
        *({name: 50} for name in ("notes_tokens", "summary_tokens", "recall_tokens", "memory_tokens")),
        {"beyond_result": "offload", "result_tokens": 20},
    ],
)
@pytest.mark.parametrize(
    ("context", "protocol", "why"),
    [("host", "tools", 'context="host" leaves the past'), ("window", "paper", "the paper's protocol has none")],
)
def test_a_strategy_needs_a_window_and_tools(strategy, context, protocol, why):
    def begin_there() -> None:
        episode = sp.Episode(RPS, seed=1, budget=sp.Budget(slack=0.5, **strategy), context=context)
        sp.play(episode, sp.get_player("rule"), protocol=protocol)

    with pytest.raises(sp.InvalidArgumentError, match=f"needs a window over tool calls, and {why}"):
        begin_there()


@pytest.mark.parametrize(
    ("strategy", "words", "field"),
    [
        ({"recall_tokens": 80}, "recalls <= 80", "recall"),
        ({"memory_tokens": 400}, "memory <= 400", "memory"),
        ({"beyond_result": "offload"}, "offloading", "pages"),
    ],
)
def test_a_strategy_has_a_name_and_where_it_is_off_no_row_has_a_field_of_it(strategy, words, field):
    assert sp.Budget(**strategy).describe() == words
    assert strategy.keys().isdisjoint(sp.Budget().model_dump())
    with sp.Episode(RPS, seed=1) as episode:
        result = sp.play(episode, sp.get_player("rule"))
    assert field not in json.dumps(result.model_dump())
    assert sp.EpisodeResult.from_record(result.model_dump()) == result


def test_two_strategies_that_decide_the_same_are_refused(monkeypatch):
    pinning = type("Pinning", (KINDS["first_turns"],), {"pinned": lambda self, turn: None})
    monkeypatch.setattr(strategies, "KINDS", {**KINDS, "first_turns": pinning})
    with pytest.raises(sp.InvalidArgumentError, match=r"first_turns.* both pin a turn, and one strategy alone can"):
        begin(**room(200, first_turns=1, notes_tokens=10))


@pytest.mark.parametrize(
    ("budget", "sentence"),
    [({"beyond_history": "mask"}, "masks nothing"), ({"first_turns": 1}, "first_turns has nothing to keep")],
)
def test_where_nothing_leaves_what_would_keep_something_is_refused(budget, sentence):
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        begin(history=None, **budget)
