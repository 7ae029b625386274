"""Conversations, by example: what is sent, what comes back, and every way in which an episode ends."""

from __future__ import annotations

import asyncio
import copy
import dataclasses
import pickle

import pytest

import smartplay_tools as sp
from smartplay_tools.conversation import AgentSession, PaperConversation
from smartplay_tools.conversation.base import CheckedReply
from smartplay_tools.records.driver import unchained
from smartplay_tools.transcript.file import MemoryRecord

RPS, HANOI = "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"


def calling(*calls: tuple[str, str], say: str | None = None) -> sp.Message:
    """An assistant message with tool calls, all of them with the same id, as some models send them."""
    functions = [{"name": name, "arguments": arguments} for name, arguments in calls]
    tool_calls = [{"id": "call_0", "type": "function", "function": function} for function in functions]
    return {"role": "assistant", "content": say, "tool_calls": tool_calls}


def acting(action: str = "Rock", say: str | None = None) -> sp.Message:
    return calling(("act", f'{{"action": "{action}"}}'), say=say)


def saying(words: str) -> sp.Message:
    return {"role": "assistant", "content": words}


def test_the_first_prompt_is_system_and_task_and_shows_no_observation():
    conversation = sp.Conversation(sp.Episode(RPS, seed=1))
    prompt = conversation.prompt()
    assert [message["role"] for message in prompt.messages] == ["system", "user"]
    assert prompt.messages[0]["content"].startswith("You’re a player trying to play the game.")
    assert [tool.name for tool in prompt.tools] == ["observe", "act", "read_manual"]
    assert "New round begins." not in str(prompt.messages)


def test_a_reply_becomes_a_turn_with_its_results():
    conversation = sp.Conversation(sp.Episode(RPS, seed=1))
    (result,) = conversation.receive(acting(say="Rock it is."))
    *_, assistant, tool = conversation.prompt().messages
    assert assistant == acting(say="Rock it is.")
    assert tool == {"role": "tool", "content": result.text, "tool_call_id": "call_0"}


class TestEnds:
    def test_looking_for_ever_ends_some_day(self):
        with sp.Episode(RPS, seed=0, budget=sp.Budget(stalled_turns=None)) as episode:
            result = sp.play(episode, sp.ScriptedPlayer([calling(("observe", ""))] * 1_000))
        assert (result.end_reason, result.tool_calls) == ("tool_calls", 4 * 50 + 16)

    def test_the_last_result_says_that_stalled_turns_have_ended_the_episode(self):
        with sp.Episode(RPS, seed=0, context="host", budget=sp.Budget(stalled_turns=2)) as episode:
            results = [episode.call("fly") for _ in range(2)]
            assert [result.done for result in results] == [False, True]
            assert episode.call("act", {"action": "1"}).text.startswith("Error: The episode is over (stalled_turns)")

    def test_three_idle_replies_in_a_row(self):
        player = sp.ScriptedPlayer([saying("Hm."), saying("Hm."), acting(), saying("1"), saying("2"), saying("3")])
        with sp.Episode(RPS, seed=0) as episode:
            result = sp.play(episode, player)
        assert (result.end_reason, result.idle_replies, result.steps) == ("no_tool_call", 5, 1)
        assert player.prompts[1].messages[-1]["content"].startswith("Your reply called no tool.")


class TestBudgets:
    def test_the_providers_usage_stands_beside_our_count(self):
        usage = sp.Usage(prompt=500, reply=20, cached=400, requests=2)
        with sp.Episode(RPS, seed=0) as episode:
            result = sp.play(episode, sp.ScriptedPlayer([acting(), acting()], usage))
        assert result.tokens.provider == sp.Usage(prompt=1000, reply=40, cached=800, requests=4)


def test_a_foreign_call_is_not_idle():
    search = sp.ToolSpec("search", "Search the web.", {"type": "object", "properties": {"query": {"type": "string"}}})
    with sp.Episode(RPS, seed=0) as episode:
        conversation = sp.Conversation(episode, foreign_tools=[search])
        conversation.receive(calling(("search", "{}")))
        conversation.add({"role": "tool", "tool_call_id": "call_0", "content": "Nothing."})
        assert episode.stats.idle_replies == 0


def test_a_conversation_needs_the_window():
    with sp.Episode(RPS, seed=0, context="host") as episode, pytest.raises(sp.InvalidArgumentError, match="window"):
        sp.Conversation(episode)


def test_fields_that_client_libraries_add_do_no_harm():
    dumped = {**acting(), "refusal": None, "annotations": [], "audio": None, "function_call": None}
    with sp.Episode(RPS, seed=0) as episode:
        conversation = sp.Conversation(episode)
        conversation.receive(dumped)
        assert conversation.latest_turn.assistant == acting()


def test_a_script_that_has_no_more_replies_ends_an_episode_on_an_event_loop():
    class Script:
        name = "script"
        replies = iter([sp.Reply({"role": "assistant", "content": "One."})])

        def reply(self, prompt: sp.Prompt) -> sp.Reply:
            return next(self.replies)

    result = asyncio.run(sp.aplay(sp.Episode("Hanoi3Disk-v0", seed=0), Script()))
    assert (result.end_reason, result.error) == ("player_error", "RuntimeError: The player has no more replies.")


class Waiting:
    """The rule player, as one that waits for a network."""

    name = "waiting"

    def __init__(self) -> None:
        self._player = sp.get_player("rule")

    async def areply(self, prompt: sp.Prompt) -> sp.Reply:
        await asyncio.sleep(0)
        return self._player.reply(prompt)


def test_aplay_plays_asynchronous_and_ordinary_players():
    async def both() -> list[sp.EpisodeResult]:
        with sp.Episode(HANOI, seed=0) as one, sp.Episode(HANOI, seed=0) as other:
            return await asyncio.gather(sp.aplay(one, Waiting()), sp.aplay(other, sp.get_player("rule")))

    one, other = asyncio.run(both())
    assert one == other
    assert one.completed


def test_play_drives_an_asynchronous_player_too_also_inside_a_running_loop():
    async def in_a_notebook() -> sp.EpisodeResult:
        with sp.Episode(HANOI, seed=0) as episode:
            return sp.play(episode, Waiting())

    with sp.Episode(HANOI, seed=0) as episode:
        assert sp.play(episode, Waiting()).completed
    assert asyncio.run(in_a_notebook()).completed


@pytest.mark.parametrize("thing", [3, "rule", object()])
def test_what_is_no_player_is_one_sentence(thing):
    with sp.Episode(HANOI, seed=0) as episode, pytest.raises(sp.InvalidArgumentError, match="is not a player"):
        sp.play(episode, thing)


def test_a_prompt_is_the_same_before_and_after_its_messages_are_read():
    with sp.Episode("Hanoi3Disk-v0", seed=1, tokenizer="approximate") as episode:
        conversation = sp.Conversation(episode)
        unread, read = conversation.prompt(), conversation.prompt()
        assert read.messages is read.messages
        assert pickle.loads(pickle.dumps(unread)) == unread == read == copy.deepcopy(read)
        assert dataclasses.replace(conversation.prompt(), tools=()).messages == read.messages
        read.messages[0]["content"] = "changed"
        assert read == unread
        assert "changed" not in (unread.messages[0]["content"], conversation.prompt().messages[0]["content"])
        with pytest.raises(AttributeError, match="no attribute 'message'"):
            _ = unread.message


@pytest.mark.parametrize("kind", [sp.Conversation, AgentSession, PaperConversation])
@pytest.mark.parametrize("asynchronous", [False, True])
def test_a_reply_is_taken_as_a_message_as_a_reply_or_checked(kind, asynchronous):
    """All three leave the same record, except that a message has no usage."""
    message = saying("Rock") if kind is PaperConversation else acting(say="Rock it is.")
    reply = sp.Reply(message, sp.Usage(prompt=7, reply=2))
    taken, records = [], []
    for form in (message, reply, CheckedReply.of(reply)):
        record = MemoryRecord()
        with sp.Episode(RPS, seed=7, transcript=record) as episode:
            conversation = kind(episode)
            conversation.prompt()
            taken.append(asyncio.run(conversation.areceive(form)) if asynchronous else conversation.receive(form))
        records.append([unchained(event) for event in record.events])
    assert taken[0] == taken[1] == taken[2]
    assert records[1] == records[2]
    plain, counted = ([event for event in one if event["event"] == "usage"] for one in records[:2])
    assert [event["provider"] for event in plain] == [None]
    assert counted == [{**plain[0], "provider": reply.usage.model_dump()}]
