"""`ContextManager.fit`: what of an agent's messages a prompt shows, at the edges of every rule."""

from __future__ import annotations

import base64
import io
import json
import threading
from collections.abc import Callable
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import InvalidArgumentError, PromptOverflowError
from tests.manager.histories import anthropic, responses
from tests.manager.judge import Letters, total

Messages = list[dict[str, Any]]

HEAD: Messages = [{"role": "system", "content": "You read."}, {"role": "user", "content": "Read all pages."}]


def step(number: int, text: str = "", *, said: str = "Next.", calls: int = 1) -> Messages:
    """A reply with calls, and their results."""
    ids = [f"c{number}.{call}" for call in range(calls)]
    functions = [{"name": "read", "arguments": f'{{"page": {number}}}'} for _ in ids]
    made = [{"id": i, "type": "function", "function": each} for i, each in zip(ids, functions, strict=True)]
    results = [{"role": "tool", "tool_call_id": i, "content": text or f"Page {number} of the book."} for i in ids]
    return [{"role": "assistant", "content": said, "tool_calls": made}, *results]


def steps(count: int, **options: Any) -> Messages:
    return [*HEAD, *(message for number in range(count) for message in step(number, **options))]


def manager(prompt_tokens: int | None, **options: Any) -> sp.ContextManager:
    """A manager that counts by the judge's tokenizer and shows as much as fits."""
    return sp.ContextManager(prompt_tokens, **{"tokenizer": Letters(), "slack": 0, **options})


class Fewest:
    """Chooses nothing but what every prompt shows."""

    def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
        return sp.Choice()


def cost(messages: Messages) -> int:
    return total("chat", messages)


def test_what_fits_is_sent_as_it_was_given():
    messages = steps(5)
    prompt = manager(10_000).fit(messages)
    assert prompt.messages == messages
    assert all(shown is given for shown, given in zip(prompt.messages, messages, strict=True))
    assert (prompt.tokens, prompt.dropped, prompt.repaired) == (cost(messages), [], [])


def test_a_prompt_may_be_exactly_full():
    messages = steps(6)
    kept = [*HEAD, *messages[-6:]]
    assert manager(cost(kept)).fit(messages).messages == kept
    assert manager(cost(kept) - 1).fit(messages).messages == [*HEAD, *messages[-4:]]


def test_the_newest_unit_may_be_exactly_full_and_is_cut_by_a_token_more():
    messages = [*steps(2), *step(2, "word " * 400)]
    whole = cost([*HEAD, *messages[-2:]])
    exact = manager(whole, result_tokens=None).fit(messages)
    assert (exact.tokens, exact.cut) == (whole, [])
    cut = manager(whole - 1, result_tokens=None).fit(messages)
    assert cut.cut == [len(messages) - 1]
    assert cut.tokens <= whole - 1
    assert cut.messages[-1]["content"].endswith("tokens cut]")


def test_what_cannot_be_left_out_may_be_exactly_full_and_is_refused_by_a_token_more():
    messages = [*HEAD, {"role": "assistant", "content": "long " * 40}]
    assert manager(cost(messages)).fit(messages).messages == messages
    with pytest.raises(PromptOverflowError, match=r"newest turn 5\d") as refused:
        manager(cost(messages) - 1).fit(messages)
    assert sum(refused.value.parts.values()) == cost(messages)
    assert list(refused.value.parts) == ["tools", "head", "pinned", "newest turn"]


def test_head_and_tools_alone_may_be_too_long():
    tool = {"type": "function", "function": {"name": "read", "description": "Read a page.", "parameters": {}}}
    with pytest.raises(PromptOverflowError, match="tools 2"):
        manager(cost(HEAD)).fit(HEAD, tools=[tool])


@pytest.mark.parametrize("beyond", ["drop", "mask"])
def test_history_counts_results_before_the_newest(beyond: Any):
    messages = steps(6)
    prompt = manager(None, history=2, beyond_history=beyond).fit(messages)
    texts = [m["content"] for m in prompt.messages if m["role"] == "tool"]
    shown = [f"Page {number} of the book." for number in (3, 4, 5)]
    assert texts == (shown if beyond == "drop" else ["[result left the history window]"] * 3 + shown)
    assert prompt.masked == ([] if beyond == "drop" else [3, 5, 7])


def test_history_zero_shows_the_newest_result_alone():
    prompt = manager(None, history=0).fit(steps(3))
    assert [m["content"] for m in prompt.messages if m["role"] == "tool"] == ["Page 2 of the book."]


def test_the_users_newest_words_stay_and_older_ones_age():
    messages = [*steps(3), {"role": "user", "content": "Now the index."}, *steps(30)[2:]]
    prompt = manager(300).fit(messages)
    assert {"role": "user", "content": "Now the index."} in prompt.messages
    later = [*messages, {"role": "user", "content": "And the cover."}, *steps(30)[2:]]
    again = manager(300).fit(later)
    assert {"role": "user", "content": "Now the index."} not in again.messages
    assert {"role": "user", "content": "And the cover."} in again.messages


def test_the_head_may_be_the_system_message_alone():
    messages = [*HEAD, {"role": "assistant", "content": "Hello."}]
    messages += [
        {"role": role, "content": f"{role} {n} {'x' * 40}"} for n in range(20) for role in ("user", "assistant")
    ]
    prompt = manager(200, head="system").fit(messages)
    assert HEAD[1] not in prompt.messages
    assert [message["role"] for message in prompt.messages[:2]] == ["system", "user"]


def test_marked_units_and_first_turns_stay():
    messages = steps(40)
    marked = manager(400, pin=lambda message: message.get("content") == "Page 7 of the book.").fit(messages)
    assert messages[16:18] == marked.messages[2:4]
    first = manager(400, first_turns=2).fit(messages)
    assert first.messages[:6] == messages[:6]
    assert len(first.dropped) > 40


@pytest.mark.parametrize("form", [list, responses, anthropic])
def test_old_replies_lose_their_words_and_keep_their_calls_in_every_form(form: Any):
    whole = form(steps(4))
    prompt = manager(None, own_words=1).fit(whole)
    assert json.dumps(prompt.messages).count("Next.") == 2
    assert json.dumps(prompt.messages).count('"read"') == 4
    assert prompt.tokens < manager(None).fit(whole).tokens


def picture(side: int) -> dict[str, Any]:
    from PIL import Image

    file = io.BytesIO()
    Image.new("RGB", (side, side)).save(file, "PNG")
    data = base64.b64encode(file.getvalue()).decode()
    return {"type": "image", "source": {"type": "base64", "media_type": "image/png", "data": data}}


def test_pictures_count_by_their_size_and_older_ones_are_left_out():
    messages = anthropic(steps(3))
    for message in messages[3::2]:
        message["content"][0]["content"] = [{"type": "text", "text": "A map."}, picture(280)]
    window = sp.ContextManager(None, slack=0, tokenizer="o200k_base+claude-28", newest_pictures=1)
    prompt = window.fit(messages)
    left_out = [message["content"][0]["content"][1] for message in prompt.messages[3::2]]
    assert left_out[:2] == [{"type": "text", "text": "[picture left the history window]"}] * 2
    assert left_out[2]["type"] == "image"
    assert prompt.elided == [3, 5]
    whole = sp.ContextManager(None, tokenizer="o200k_base+claude-28").fit(messages)
    per_picture = 100  # ten by ten patches of 28 pixels
    assert whole.tokens - prompt.tokens == 2 * (per_picture - 6)  # the line in place of a picture has six


@pytest.mark.parametrize(
    ("part", "options", "sentence"),
    [
        ({"type": "image_url", "image_url": {"url": "https://a/b.png"}}, {}, "picture_tokens"),
        (
            {"type": "image_url", "image_url": {"url": "https://a/b.png"}},
            {"tokenizer": "o200k_base+claude-28"},
            "not in the",
        ),
        ({"type": "input_audio", "input_audio": {}}, {}, "'input_audio', whose tokens only its provider"),
        ({"type": "file", "file": {"file_id": "f"}}, {}, "extra_tokens"),
    ],
)
def test_what_cannot_be_counted_is_refused_by_position_unless_its_tokens_are_named(
    part: Any, options: Any, sentence: str
):
    messages = [*HEAD, {"role": "user", "content": [{"type": "text", "text": "See."}, part]}]
    with pytest.raises(InvalidArgumentError, match=rf"^Message 2 .*{sentence}"):
        sp.ContextManager(1_000, **options).fit(messages)
    named = sp.ContextManager(1_000, picture_tokens=70, extra_tokens=70, **options)
    words = sp.ContextManager(1_000).fit([*messages[:2], {"role": "user", "content": "See."}])
    assert named.fit(messages).tokens == words.tokens + 70


def test_encrypted_thoughts_have_an_estimate_and_are_named():
    reply = {"role": "assistant", "content": [{"type": "redacted_thinking", "data": "x" * 400}]}
    prompt = manager(1_000).fit([*HEAD, reply])
    assert prompt.uncertain == [2]
    bare = manager(1_000, sealed_tokens=0).fit([*HEAD, reply])
    assert prompt.tokens - bare.tokens == 100


# Lists that providers refuse.


def test_a_result_without_its_call_is_left_out():
    orphan = {"role": "tool", "tool_call_id": "z", "content": "Nobody asked."}
    prompt = manager(1_000).fit([*steps(1), orphan])
    assert prompt.messages == steps(1)
    assert (prompt.repaired, prompt.dropped) == ([4], [])


def test_a_call_without_a_result_is_answered():
    messages = [*steps(1), *step(1, calls=2)[:2]]
    prompt = manager(1_000).fit(messages)
    assert prompt.messages[:-1] == messages
    assert prompt.messages[-1] == {"role": "tool", "tool_call_id": "c1.1", "content": "[this call has no result]"}
    assert (prompt.sources[-1], prompt.made) == (None, 1)


def test_words_between_a_call_and_its_result_come_after_it():
    call, result = step(0)
    words = {"role": "user", "content": "Hurry."}
    prompt = manager(1_000).fit([*HEAD, call, words, result])
    assert prompt.messages == [*HEAD, call, result, words]
    assert prompt.repaired == [4]


@pytest.mark.parametrize("own", [{}, {"strategy": "clear_tool_uses_20250919"}, {"strategy": Fewest}])
@pytest.mark.parametrize("form", [list, responses, anthropic])
def test_a_late_result_that_the_model_is_asked_about_is_shown(form: Any, own: dict[str, Any]):
    call, late = step(0, "The slow page.")
    messages = [*form([*HEAD, call, {"role": "user", "content": "Go on."}, *steps(9)[4:]]), *form([late])]
    window = manager(200, history=2, **own)
    assert "The slow page." in json.dumps(window.fit(messages).messages)
    later = window.fit([*messages, *form(step(9))])
    assert "The slow page." not in json.dumps(later.messages)
    assert later == manager(200, history=2, **own).fit([*messages, *form(step(9))])


def test_ids_that_come_again_belong_to_the_latest_open_call():
    messages = json.loads(json.dumps(steps(3)).replace("c1.0", "c0.0").replace("c2.0", "c0.0"))
    prompt = manager(1_000).fit(messages)
    assert (prompt.messages, prompt.repaired) == (messages, [])


def test_two_result_messages_of_anthropic_become_one():
    messages = anthropic([*HEAD, *step(0, calls=2)])
    first, second = ({"role": "user", "content": [block]} for block in messages[-1]["content"])
    prompt = manager(1_000).fit([*messages[:-1], first, second])
    assert prompt.messages == messages
    assert prompt.repaired == [3, 4]


def test_repairs_can_be_refused_with_the_position():
    orphan = {"role": "tool", "tool_call_id": "z", "content": "Nobody asked."}
    with pytest.raises(InvalidArgumentError, match=r"^Message 4 does not fit"):
        manager(1_000, repair=False).fit([*steps(1), orphan])
    with pytest.raises(InvalidArgumentError, match=r"^A call of message 4 has no result"):
        manager(1_000, repair=False).fit([*steps(1), step(1)[0]])


def nested(levels: int) -> dict[str, Any]:
    """A message whose only part holds another, and that another."""
    part: dict[str, Any] = {"type": "note"}
    for _ in range(levels - 1):
        part = {"type": "note", "inner": part}
    return {"role": "user", "content": [part]}


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        ("words", "Message 2 is str"),
        ({"role": "critic", "content": "Bad."}, "Message 2 has the role 'critic'"),
        ({"type": "item_reference", "id": "rs_1"}, "Message 2 is a reference"),
        (nested(3_000), "Message 2 is nested 3002 levels deep"),
        ({"role": "user", "content": {1, 2}}, "Message 2 has content of the type set"),
        ({"content": "no role"}, "Message 2 has the role None"),
        ({"role": [], "content": "a list as a role"}, r"Message 2 has the role \[\]"),
        ({"role": "assistant", "tool_calls": 5}, "Message 2 has tool_calls that are no list of calls"),
        ({"role": "assistant", "tool_calls": ["read"]}, "Message 2 has tool_calls that are no list of calls"),
        ({"role": "assistant", "tool_calls": [{"function": "read"}]}, "Message 2 has tool_calls that are no list"),
    ],
)
def test_what_is_no_message_is_refused_by_position(message: Any, sentence: str):
    with pytest.raises(InvalidArgumentError, match=f"^{sentence}"):
        manager(1_000).fit([*HEAD, message])


@pytest.mark.parametrize("kind", [{}, [], 5, None])
def test_a_part_of_a_type_that_nobody_knows_is_kept_as_it_is(kind: Any):
    strange = {"role": "user", "content": [{"type": kind}]}
    assert manager(1_000).fit([*HEAD, strange]).messages[-1] is strange


@pytest.mark.parametrize("own", [nested(120), {"role": "user", "content": "Look.", "seen": {1, 2}, "raw": b"raw"}])
def test_what_is_sent_or_ignored_whatever_it_holds_is_kept(own: dict[str, Any]):
    """A model can send deeply nested arguments, and an agent can keep fields of its own in a message."""
    assert manager(100_000).fit([*HEAD, own]).messages[-1] is own


def test_objects_of_a_client_are_read_and_kept():
    from openai.types.chat import ChatCompletionMessage

    call, result = step(0)
    reply = ChatCompletionMessage.model_validate(call)
    window = manager(1_000)
    for again in (reply.model_copy(), reply):
        prompt = window.fit([*HEAD, again, result])
        assert prompt.messages[2] is again
    assert prompt.tokens == manager(1_000).fit([*HEAD, call, result]).tokens


# One function of its arguments.


def test_an_item_that_goes_on_with_a_reply_is_read_with_it():
    """The list was known as ending after the reply's first item, and grows within the reply."""
    items = responses([*steps(1), {"role": "assistant", "content": "I look."}])
    call = {"type": "function_call", "call_id": "c9", "name": "read", "arguments": "{}"}
    window = manager(1_000)
    window.fit([*items, {"type": "message", "role": "user", "content": "Go on."}])
    grown = [*items, call, {"type": "function_call_output", "call_id": "c9", "output": "A page."}]
    assert window.fit(grown) == manager(1_000).fit(grown)


@pytest.mark.parametrize(
    "change",
    [
        lambda messages: messages[1].update(content="Read the last page."),
        lambda messages: messages[4]["tool_calls"][0]["function"].update(arguments='{"page": 12345}'),
        lambda messages: messages[4]["tool_calls"][0]["function"].update(arguments={"pages": [True] * 20}),  # equal
        lambda messages: messages[7].update(note=messages[7].pop("note")),  # "erfulwond", not "wonderful"
        lambda messages: messages.insert(2, {"role": "user", "content": "All of them."}),
        lambda messages: messages.__delitem__(slice(2, 4)),
    ],
)
def test_what_was_changed_in_place_is_read_again(change: Callable[[Messages], Any]):
    messages = steps(12)
    messages[4]["tool_calls"][0]["function"]["arguments"] = {"pages": [1] * 20}
    messages[7] |= {"note": "wond", "more": "erful"}
    window = sp.ContextManager(300)
    window.fit(messages)
    change(messages)
    fresh = sp.ContextManager(300)
    for end in (len(messages), 8, len(messages)):
        assert window.fit(messages[:end]) == fresh.fit(messages[:end]) == sp.ContextManager(300).fit(messages[:end])


@pytest.mark.parametrize("own", [{"own_words": 1}, {"strategy": "clear_tool_uses_20250919:trigger=100,keep=1"}])
def test_what_an_equal_list_was_changed_to_is_in_no_later_prompt(own: dict[str, Any]):
    """A framework makes its messages anew for each request, and a client edits those that it has sent."""
    window, sent = sp.ContextManager(2_000, **own), steps(12)
    window.fit(sent)
    for message in sent[2:]:
        message.update(content="edited", tool_call_id="other", tool_calls=[])
    again = [*steps(12), *step(12)]
    assert window.fit(again).messages == sp.ContextManager(2_000, **own).fit(again).messages


@pytest.mark.parametrize("own", [{}, {"strategy": "clear_tool_uses_20250919:trigger=1,keep=1"}, {"result_tokens": 32}])
@pytest.mark.parametrize("nothing", [None, "absent", ""])
def test_a_result_without_content_is_empty(own: dict[str, Any], nothing: Any):
    calls = [{"type": "tool_use", "id": f"c{at}", "name": "read", "input": {}} for at in range(2)]
    results: Messages = [{"type": "tool_result", "tool_use_id": f"c{at}"} for at in range(2)]
    results[1]["content"] = "Page 1 of the book. " * 60
    if nothing != "absent":
        results[0]["content"] = nothing
    messages: Messages = [HEAD[1], {"role": "assistant", "content": calls}, {"role": "user", "content": results}]
    prompt = sp.ContextManager(8_000, form="anthropic", **own).fit([*messages, {"role": "user", "content": "Go on."}])
    shown = [block for message in prompt.messages for block in message["content"] if isinstance(block, dict)]
    assert [block.get("tool_use_id") for block in shown if block["type"] == "tool_result"] == ["c0", "c1"]
    chat = [*HEAD, *step(0), *step(1)]
    chat[3]["content"] = None if nothing == "absent" else nothing
    assert len(sp.ContextManager(8_000, **own).fit(chat).messages) == len(chat)


def test_items_of_a_providers_tools_keep_what_it_requires():
    thoughts: Messages = [
        {"type": "reasoning", "id": f"rs_{at}", "summary": [{"type": "summary_text", "text": "Thought of at length."}]}
        for at in range(2)
    ]
    search = {
        "type": "web_search_call",
        "id": "ws_1",
        "status": "completed",
        "action": {"type": "search", "query": "x"},
    }
    reply = {"type": "message", "id": "msg_1", "role": "assistant", "content": "Read."}
    items: Messages = [HEAD[1], thoughts[0], search, reply, {"role": "user", "content": "Go on."}]
    items += [thoughts[1], {**reply, "id": "msg_2"}, {"role": "user", "content": "And?"}]
    prompt = sp.ContextManager(8_000, form="responses", strategy="clear_thinking_20251015", extra_tokens=9).fit(items)
    assert [item for item in prompt.messages if item in thoughts] == thoughts[1:]
    assert search in prompt.messages
    assert [item["id"] for item in prompt.messages if item.get("role") == "assistant" and "id" in item] == ["msg_2"]


def test_a_providers_own_summary_stays_under_a_strategy():
    summary = {"type": "compaction", "id": "cmp_1", "encrypted_content": "x" * 40}
    pages = [item for number in range(20) for item in responses(step(number))]
    for own in ({}, {"strategy": "clear_tool_uses_20250919"}):
        window = sp.ContextManager(400, form="responses", sealed_tokens=20, **own)
        assert summary in window.fit([HEAD[1], summary, *pages]).messages


def test_two_threads_on_one_manager_get_their_own_prompts():
    window = manager(300)
    conversations = [[*HEAD, {"role": "user", "content": f"I am {name}."}, *steps(30)[2:]] for name in range(4)]
    wanted = [manager(300).fit(messages) for messages in conversations]
    wrong: list[int] = []

    def ask(number: int) -> None:
        for end in (*range(4, 60, 7), len(conversations[number])):
            prompt = window.fit(conversations[number][:end])
        if prompt != wanted[number]:
            wrong.append(number)

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"prompt_tokens": 0}, "prompt_tokens is a whole number from 1 on"),
        ({"prompt_tokens": True}, "prompt_tokens is a whole number"),
        ({"slack": 2}, "slack is a share"),
        ({"history": -1}, "history is a whole number from 0 on"),
        ({"beyond_history": "mask"}, "give history a number"),
        ({"beyond_history": "hide", "history": 1}, "beyond_history must be one of drop, mask"),
        ({"head": "none"}, "head must be one of"),
        ({"form": "gemini"}, "form must be one of"),
        ({"tokenizer": "nope"}, "nope"),
    ],
)
def test_settings_are_checked_at_once(options: dict[str, Any], sentence: str):
    with pytest.raises((InvalidArgumentError, KeyError), match=sentence):
        sp.ContextManager(**{"prompt_tokens": 100, **options})


def test_tools_and_their_provider_count():
    tools: list[Any] = [
        {"type": "function", "function": {"name": "read", "description": "Read a page.", "parameters": {}}},
        {"type": "function", "name": "read", "description": "Read a page.", "parameters": {}},
        {"name": "read", "description": "Read a page.", "input_schema": {}},
        sp.ToolSpec("read", "Read a page.", {}),
    ]
    counts = {manager(1_000).fit(HEAD, tools=[tool]).parts["tools"] for tool in tools}
    assert len(counts) == 1
    with pytest.raises(InvalidArgumentError, match="web_search"):
        manager(1_000).fit(HEAD, tools=[{"type": "web_search_20250305", "name": "web_search"}])
    search = [{"type": "web_search_20250305", "name": "web_search"}]
    assert manager(1_000, extra_tokens=300).fit(HEAD, tools=search).parts["tools"] == 300


@pytest.mark.parametrize(
    "options",
    [{}, {"head": "system"}, {"strategy": lambda messages, room: messages}],
    ids=["rule", "system", "function"],
)
def test_a_list_that_was_refused_changes_no_later_prompt(options: dict[str, Any]):
    """A part that cannot be counted, and a `pin` that raises, behind a known beginning."""

    def pin(message: Any) -> bool:
        if message.get("content") == "Look up!":
            raise OSError("a lookup that failed")
        return False

    made, whole = manager(2_000, pin=pin, **options), [*steps(2), {"role": "user", "content": "Go on."}]
    audio = [{"type": "input_audio", "input_audio": {"data": "", "format": "wav"}}]
    for content, error in ((audio, InvalidArgumentError), ("Look up!", OSError)):
        assert made.fit(whole).messages == whole
        with pytest.raises(error):
            made.fit([*whole[:-1], {"role": "user", "content": content}])
        assert made.fit(whole).messages == whole
        assert made.fit(other := [*HEAD, *step(7)]).messages == other


@pytest.mark.parametrize("own", [{}, {"strategy": "clear_tool_uses_20250919:trigger=4000,keep=1"}])
def test_results_of_two_replies_in_one_message_go_to_their_calls(own: dict[str, Any]):
    """Anthropic takes two messages of the model, one after the other, as one."""
    replies: Messages = [
        {"role": "assistant", "content": [{"type": "tool_use", "id": f"c{at}", "name": "read", "input": {}}]}
        for at in range(2)
    ]
    results: Messages = [{"type": "tool_result", "tool_use_id": f"c{at}", "content": f"Page {at}."} for at in range(2)]
    words = {"type": "text", "text": "Be quick."}
    prompt = sp.ContextManager(8_000, **own).fit([HEAD[1], *replies, {"role": "user", "content": [*results, words]}])
    one, two = ({"role": "user", "content": content} for content in (results[:1], [results[1], words]))
    assert [*prompt.messages] == [HEAD[1], replies[0], one, replies[1], two]
    assert [*prompt.repaired] == [3]
