"""What a host's own list of messages means for the session of an episode."""

from __future__ import annotations

from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.conversation import HostChat

SEARCH = sp.ToolSpec("search", "Search.", {"type": "object", "properties": {}})


def reply(*calls: tuple[str, str]) -> sp.Message:
    functions = [{"name": name, "arguments": arguments} for name, arguments in calls]
    tool_calls: Any = [{"id": f"c{at}", "function": function} for at, function in enumerate(functions)]
    return {"role": "assistant", "content": "Well.", **({"tool_calls": tool_calls} if calls else {})}


def result(call_id: str, text: str) -> sp.Message:
    return {"role": "tool", "tool_call_id": call_id, "content": text}


def user(text: str) -> sp.Message:
    return {"role": "user", "content": text}


def system(text: str) -> list[sp.Message]:
    return [{"role": "system", "content": text}]


def begun(*calls: tuple[str, str]) -> tuple[HostChat, list[Any]]:
    """A chat whose model has made these calls."""
    events: list[Any] = []
    chat = HostChat(sp.Episode("Hanoi3Disk-v0", seed=7, transcript=events), player="host")
    session = chat.begin([user("Win.")], system=system("Be brief."), foreign_tools=[SEARCH])
    session.prompt()
    session.receive(reply(*calls))
    return chat, events


def turn_of(chat: HostChat) -> list[str]:
    """The messages of the next prompt after the reply."""
    prompt = chat.session.prompt()
    at = max(at for at, message in enumerate(prompt.messages) if message["role"] == "assistant")
    return [str(message["content"]) for message in prompt.messages[at + 1 :]]


def test_every_open_call_is_decided_in_the_order_of_the_message():
    calls = [
        ("act", '{"action": "3"}'),
        ("search", "{}"),
        ("fly", "{}"),
        ("act", "{"),
        ("observe", "{}"),
        ("act", "{}"),
    ]
    chat, events = begun(*calls)
    played = {"c0": None, "c4": {}}
    answers = chat.settle([result("c1", "Nothing."), result("c5", "No.")], play=played)
    assert list(answers) == ["c0", "c2", "c3", "c4", "c5"]
    texts = turn_of(chat)
    assert texts[1] == "Nothing."
    assert "no tool" in texts[2].lower()
    assert "JSON" in texts[3]
    assert texts[5] == "No."
    mistakes = [event["data"].get("mistake") for event in events if event["event"] == "call"]
    assert mistakes == [None, "malformed", "malformed", None, "host"]
    chat.episode.close()
    assert sp.replay(events).identical


def test_what_the_host_has_left_open_was_not_run():
    chat, events = begun(("search", "{}"), ("observe", "{}"))
    assert all(answer.is_error for answer in chat.settle(()).values())
    assert turn_of(chat) == ["Error: The host's agent did not run this call."] * 2
    assert [event["host"] for event in events if event["event"] == "call"] == ["refused"] * 2


@pytest.mark.parametrize("said", [None, "Cannot parse this."], ids=["by us", "by the host"])
def test_a_broken_call_of_the_hosts_tool_is_a_mistake_whoever_answers_it(said):
    """The calls around it have been played already; it is answered in its place, in the host's words if it has some."""
    chat, events = begun(("observe", "{}"), ("search", "{"), ("observe", "{}"))
    for call_id in ("c0", "c2"):
        chat.session.answer(call_id)
    chat.settle([] if said is None else [result("c1", said)])
    assert turn_of(chat)[1] == (said or "Error: The arguments are not valid JSON.")
    assert (chat.episode.stats.tool_calls, chat.episode.stats.malformed_calls) == (3, 1)
    assert chat.session.answer("c1").is_error  # once more, as any other call
    chat.episode.close()
    assert sp.replay(events).identical


def test_a_record_has_the_results_that_its_host_gave():
    """So do records of versions in which a host's words for a broken call were a result of its tool."""
    chat, events = begun(("search", "{"))
    for _ in range(12):
        chat.session.add(result("c0", "Error: The arguments are not valid JSON."))
        assert chat.session.prompt() is not None
        chat.session.receive(reply(("search", "{")))
    assert chat.episode.stats.tool_calls == 0
    chat.episode.close()
    assert sp.replay(events).identical


def test_words_are_heard_once_however_often_the_list_is_read():
    chat, _ = begun()
    chat.hear([user("Faster."), user("Faster.")])
    chat.hear([user("Faster."), user("Faster."), user("Please.")])
    assert chat.unheard([user("Please.")]) == []
    assert turn_of(chat)[1:] == ["Faster.", "Faster.", "Please."]
    chat.hear([user("Now.")])  # too late: a prompt that was made stays as it is
    assert chat.unheard([user("Now.")]) == [user("Now.")]


def test_words_that_come_while_a_prompt_awaits_its_reply_are_refused():
    chat, _ = begun(("act", '{"action": "3"}'))
    chat.settle([], play={"c0": None})
    chat.hear([user("Faster.")])
    chat.session.prompt()
    chat.refuse_late_words([user("Win."), user("Faster.")])
    with pytest.raises(sp.InvalidArgumentError, match="without new messages"):
        chat.refuse_late_words([user("Faster."), user("Faster.")])


def test_a_chat_goes_on_from_a_record_with_other_instructions():
    chat, events = begun(("observe", "{}"))
    chat.settle((), play={"c0": None})
    chat.hear([user("Go on.")])
    resumed = HostChat(sp.resume(events, session=True, transcript=[]).conversation, player="host")
    resumed.hear([user("Go on."), user("Please.")])
    resumed.change(system=system("Be wise."), foreign_tools=[SEARCH])
    prompt = resumed.session.prompt()
    assert [message["content"] for message in prompt.messages[2:4]] == ["Be wise.", "Win."]
    assert [message["content"] for message in prompt.messages[-2:]] == ["Go on.", "Please."]
