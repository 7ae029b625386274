"""An agent session: the calls of a reply are answered one by one, by a host that may reorder, edit or refuse them."""

from __future__ import annotations

import asyncio
import itertools
import json
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

import smartplay_tools as sp
from smartplay_tools.episode import AsyncGameTools, GameTools, tool_specs
from smartplay_tools.records import replay
from smartplay_tools.records.replays import comparable
from tests import scripts

HANOI = "Hanoi3Disk-v0"
BANDIT = "BanditTwoArmedHighLowFixed-v0"


def test_an_id_in_the_place_of_an_episode_is_refused_in_words():
    with pytest.raises(sp.InvalidArgumentError, match="str is not an episode"):
        sp.AgentSession(HANOI)


def act(action: str, call_id: str = "", name: str = "act"):
    return {"id": call_id, "function": {"name": name, "arguments": json.dumps({"action": action})}}


def reply(*calls, content=None):
    return {"role": "assistant", "content": content, **({"tool_calls": list(calls)} if calls else {})}


def session(game=HANOI, **settings):
    events = []
    foreign = settings.pop("foreign_tools", ())
    return sp.AgentSession(sp.Episode(game, seed=1, transcript=events, **settings), foreign_tools=foreign), events


def texts(session):
    """The messages of the next prompt after the reply, in order."""
    return [message["content"] for message in session.prompt().messages if message["role"] == "tool"]


def assert_replays(session, events):
    session.episode.close()
    replayed = replay(events)
    assert replayed.identical, replayed.differences


def test_a_reply_is_charged_and_recorded_before_anything_is_played():
    agent, events = session()
    agent.prompt()
    calls = agent.receive(reply(act("1", "x")))
    assert [(call.id, call.name) for call in calls] == [("x", "act")]
    assert agent.progress.steps == 0
    assert agent.episode.stats.tokens.reply > 0
    assert events[-1]["event"] == "usage"
    assert not agent.answer("x").is_error
    assert agent.progress.steps == 1


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_calls_are_played_in_the_order_of_the_message_whatever_order_the_host_uses(order):
    agent, events = session()
    agent.prompt()
    ids = [call.id for call in agent.receive(reply(act("1", "a"), act("2", "b"), act("4", "c")))]
    answers = {ids[at]: agent.answer(ids[at]).text for at in order}
    assert texts(agent) == [answers[call_id] for call_id in ids]
    assert agent.progress.steps == 3
    assert_replays(agent, events)


def test_calls_from_many_threads_are_played_once_and_in_order():
    agent, events = session(BANDIT)
    agent.prompt()
    ids = [call.id for call in agent.receive(reply(*(act("1", str(at)) for at in range(8))))]
    with ThreadPoolExecutor(8) as threads:
        answers = list(threads.map(agent.answer, [*reversed(ids), *ids]))
    assert texts(agent) == [result.text for result in answers[8:]]
    assert agent.progress.steps == 8
    assert_replays(agent, events)


def test_a_hosts_edit_is_played_shown_and_on_record():
    agent, events = session()
    agent.prompt()
    [call] = agent.receive(reply(act("1", "x")))
    agent.answer(call.id, {"action": "2"})
    [played] = [event for event in events if event["event"] == "call"]
    assert (played["host"], played["arguments"]) == ("edited", '{"action": "2"}')
    [message] = [event["message"] for event in events if event["event"] == "message"]
    assert message["tool_calls"][0]["function"]["arguments"] == '{"action": "1"}', "the model's own words stay"
    [shown] = [m for m in agent.prompt().messages if m["role"] == "assistant"]
    assert shown["tool_calls"][0]["function"]["arguments"] == '{"action": "2"}'
    assert_replays(agent, events)


def test_the_same_arguments_in_another_form_are_no_edit():
    agent, events = session()
    agent.prompt()
    [call] = agent.receive(reply(act("1", "x")))
    agent.answer(call.id, '{ "action" :"1" }')
    assert "host" not in next(event for event in events if event["event"] == "call")
    with pytest.raises(sp.InvalidArgumentError, match="has been played; it can no longer be changed"):
        agent.answer(call.id, {"action": "2"})


def test_a_refused_call_has_the_hosts_words_as_its_result_and_is_not_played():
    agent, events = session()
    agent.prompt()
    agent.receive(reply(act("1", "a"), act("2", "b")))
    agent.refuse("a", "The user said no.")
    played = agent.answer("b")
    agent.refuse("b", "The user said no.")
    assert texts(agent) == ["The user said no.", played.text]
    assert agent.progress.steps == 1
    assert [event.get("host") for event in events if event["event"] == "call"] == ["refused", None]
    assert_replays(agent, events)
    assert agent.result.refused_calls == 1


@pytest.mark.parametrize("leave", ["open", "closed"])
def test_a_host_that_leaves_in_the_middle_of_a_reply_leaves_a_record_that_replays(leave):
    agent, events = session(budget=sp.Budget(tool_calls=1 if leave == "open" else 50))
    agent.prompt()
    agent.receive(reply(act("1", "a"), act("2", "b")))
    agent.answer("a")
    agent.episode.close()
    assert agent.result.end_reason == ("tool_calls" if leave == "open" else "closed")
    assert_replays(agent, events)


def test_foreign_calls_are_left_to_the_host_and_stand_in_their_place():
    agent, events = session(foreign_tools=[scripts.NOTE])
    agent.prompt()
    agent.receive(reply(act("1", "a"), act("x", "n", name="note"), act("2", "b")))
    assert [call.id for call in agent.open_calls] == ["a", "b"]
    with pytest.raises(sp.InvalidArgumentError, match="n is a call of note, not of the game: `add` its result"):
        agent.answer("n")
    agent.answer("b")
    with pytest.raises(sp.InvalidArgumentError, match="The foreign calls n have no result yet: `add` them"):
        agent.prompt()
    agent.add({"role": "tool", "tool_call_id": "n", "content": "noted"})
    assert texts(agent)[1] == "noted"
    assert agent.progress.steps == 2
    assert_replays(agent, events)


def test_a_result_that_the_host_gives_for_a_call_of_the_game_refuses_it():
    agent, events = session()
    agent.prompt()
    agent.receive(reply(act("1", "a")))
    agent.add({"role": "tool", "tool_call_id": "a", "content": "Tool call limit reached."})
    assert texts(agent) == ["Tool call limit reached."]
    assert agent.progress.steps == 0
    assert_replays(agent, events)


def test_a_call_that_there_is_not_is_one_sentence():
    agent, _ = session()
    with pytest.raises(sp.InvalidArgumentError, match="The latest reply has no call with the id 'x'"):
        agent.answer("x")


def test_a_call_is_not_played_after_a_later_one_of_its_message():
    """Or a prompt could show an observation that is older than its history: they would not be in their order."""
    agent, events = session("MessengerL2-v0", budget=sp.Budget(history=1))
    agent.prompt()
    agent.receive(reply(act("1", "a"), act("1", "b")))
    played = agent.answer("b", earlier=False)
    with pytest.raises(sp.InvalidArgumentError, match="a comes before one that has been answered: answer the calls"):
        agent.answer("a")
    assert agent.answer("b") == played
    assert agent.progress.steps == 1
    agent.refuse("a", "The user said no.")
    assert texts(agent)[0] == "The user said no."
    assert_replays(agent, events)


def test_the_asynchronous_twins_give_the_same_episode():
    async def played(asynchronous):
        agent, events = session(BANDIT)
        for _ in range(3):
            prompt = await agent.aprompt() if asynchronous else agent.prompt()
            assert prompt is not None
            message = reply(act("1", "a"), act("2", "b"))
            calls = await agent.areceive(message) if asynchronous else agent.receive(message)
            for call in reversed(calls):
                await agent.aanswer(call.id) if asynchronous else agent.answer(call.id)
        agent.episode.close()
        return list(comparable(events))

    assert asyncio.run(played(True)) == asyncio.run(played(False))


class TestToolsOfAnEpisode:
    def test_an_object_with_the_tools_as_methods(self):
        with sp.Episode(HANOI, seed=1, context="host") as episode:
            tools = GameTools(episode)
            assert "reset" not in tools.observe()
            assert not tools.done
            tools.act("Move the top disk of rod A to the top of rod B")
            assert tools.read_manual() == episode.call("read_manual", {}).text
            assert episode.progress.steps == 1
        assert tools.done

    def test_the_same_awaited(self):
        async def played():
            with sp.Episode(BANDIT, seed=1, context="host", budget=sp.Budget(tool_calls=2)) as episode:
                tools = AsyncGameTools(episode)
                texts = [await tools.observe(), await tools.act("1")]
                return texts, tools.done

        texts, done = asyncio.run(played())
        assert texts[1].startswith("You pulled slot machine 1")
        assert done

    def test_specs_need_no_episode(self):
        with sp.Episode(HANOI, seed=3) as episode:
            assert tool_specs(HANOI) == tuple(episode.tools)


def test_a_budget_of_options_takes_none_for_not_given():
    assert sp.Budget.of(history=None, prompt_tokens=700) == sp.Budget(prompt_tokens=700)
    assert sp.Budget.of(history="none") == sp.Budget(history=None)
    assert sp.Budget(history=None) != sp.Budget()


def interrupted(read, at, other):
    """Run `read`; before the line of this package that is its `at`-th one, another thread runs `other` to its end.

    Returns whether there was such a line.
    """
    lines = itertools.count()

    def trace(frame, event, _):
        if not frame.f_globals["__name__"].startswith("smartplay_tools"):
            return None
        if event == "line" and next(lines) == at:
            thread = threading.Thread(target=other)
            thread.start()
            thread.join(30)
            assert not thread.is_alive(), "the reader keeps others from answering"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        read()
    finally:
        sys.settrace(before)
    return next(lines) > at


@pytest.mark.parametrize("read", ["latest_turn", "turns", "open_calls", "message"])
@pytest.mark.parametrize("change", ["answer", "answer an edited call", "add"])
def test_what_one_thread_reads_loses_nothing_that_another_does(read, change):
    """Frameworks run the calls of a reply in threads, and each of these asks which turn it is in."""

    def played(at):
        agent, events = session()
        agent.prompt()
        first, second = agent.receive(reply(act("A"), act("1")))
        agent.answer(first.id)
        if change == "add":
            agent.answer(second.id)
        changes = {
            "answer": lambda: agent.answer(second.id),
            "answer an edited call": lambda: agent.answer(second.id, {"action": "2"}),
            "add": lambda: agent.add({"role": "user", "content": "Go on."}),
        }
        was_interrupted = interrupted(lambda: getattr(agent, read), at, changes[change])
        if not was_interrupted:
            changes[change]()
        prompt = agent.prompt()
        agent.episode.close()
        assert replay(events).identical
        return was_interrupted, (prompt.messages, comparable(events))

    _, expected = played(1_000_000)
    for at in itertools.count():
        was_interrupted, found = played(at)
        assert found == expected
        if not was_interrupted:
            break
    assert at > 1, "no line of the reading was interrupted"
