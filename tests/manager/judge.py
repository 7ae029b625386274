"""A judge of fitted prompts, written from docs/any-agent.md: it counts, pairs and chooses by its own code.

`faults` names what is wrong with a prompt. Its tokenizer is its own, too: the manager gets it as an object.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from typing import Any

from smartplay_tools import FittedPrompt, Summaries
from tests.manager.histories import Messages

MASKED = "[result left the history window]"
SUMMARY = "Summary of the conversation before this point:\n"
SMALLEST_RESULT = 32


class Letters:
    """A token for every four characters that have begun."""

    name = "letters"

    def count(self, text: str) -> int:
        return -(-len(text) // 4)


n = Letters().count


def kind(form: str, message: dict[str, Any]) -> str:
    """Whether a message is a `reply`, a `result` or a `word`."""
    if form == "responses" and message["type"] != "message":
        return "result" if message["type"] == "function_call_output" else "reply"
    if message["role"] == "assistant":
        return "reply"
    if message["role"] == "tool":
        return "result"
    blocks = message["content"] if isinstance(message["content"], list) else []
    return "result" if any(block["type"] == "tool_result" for block in blocks) else "word"


def events(form: str, message: dict[str, Any]) -> list[tuple[str, str]]:
    """The calls and the answers of a message, in their order."""
    if form == "chat":
        if message["role"] == "tool":
            return [("answer", message["tool_call_id"])]
        return [("call", call["id"]) for call in message.get("tool_calls") or ()]
    if form == "responses":
        names = {"function_call": "call", "function_call_output": "answer"}
        return [(names[message["type"]], message["call_id"])] if message["type"] in names else []
    found = []
    for block in message["content"] if isinstance(message["content"], list) else ():
        if block["type"] == "tool_use":
            found.append(("call", block["id"]))
        if block["type"] == "tool_result":
            found.append(("answer", block["tool_use_id"]))
    return found


def is_broken(form: str, messages: Messages) -> bool:
    """Whether a provider would refuse the pairs: every result stands right after the reply with its call."""
    waiting: Counter[str] = Counter()
    for message in messages:
        if kind(form, message) == "result":
            for name, call in events(form, message):
                if not waiting[call]:
                    return True
                waiting[call] -= name == "answer"
        else:
            goes_on = form == "responses" and kind(form, message) == "reply"
            if waiting.total() and not goes_on:
                return True
            waiting.update(call for name, call in events(form, message) if name == "call")
        if form == "anthropic" and kind(form, message) == "result" and waiting.total():
            return True
    return bool(waiting.total())


def tokens(form: str, message: dict[str, Any], *, opens: bool = True) -> int:
    """The budget tokens of a message; `opens` is False for an item that goes on with a reply."""
    if form == "chat":
        total = 3 + n(message["role"]) + n(message["content"] or "") + n(message.get("reasoning_content", ""))
        for call in message.get("tool_calls") or ():
            total += 11 + n(call["function"]["name"]) + n(call["function"]["arguments"])
        return total + 8 * (message["role"] == "tool")
    if form == "responses":
        match message["type"]:
            case "message":
                content = message["content"]
                said = content if isinstance(content, str) else "".join(part["text"] for part in content)
                return 3 + n(message["role"]) + n(said)
            case "function_call_output":
                return 3 + n("tool") + n(message["output"]) + 8
            case "function_call":
                return opens * (3 + n("assistant")) + 11 + n(message["name"]) + n(message["arguments"])
            case _:
                thoughts = "".join(part["text"] for part in message["summary"])
                return opens * (3 + n("assistant")) + n(thoughts) + math.ceil(len(message["encrypted_content"]) / 4)
    if isinstance(message["content"], str):
        return 3 + n(message["role"]) + n(message["content"])
    total, said, thoughts, others = 0, "", "", 0
    for block in message["content"]:
        if block["type"] == "tool_result":
            total += 3 + n("tool") + n(block["content"]) + 8
            continue
        others += 1
        if block["type"] == "tool_use":
            total += 11 + n(block["name"]) + n(json.dumps(block["input"], ensure_ascii=False))
        said += block.get("text", "")
        thoughts += block.get("thinking", "")
    return total + (3 + n(message["role"]) + n(said) + n(thoughts) if others else 0)


def total(form: str, messages: Messages) -> int:
    """The budget tokens of a prompt without tools."""
    before = [None, *messages]
    openings = [form != "responses" or b is None or kind(form, b) != "reply" for b in before]
    return 3 + sum(tokens(form, m, opens=opens) for m, opens in zip(messages, openings, strict=False))


def units(form: str, messages: Messages, begin: int) -> list[list[int]]:
    """The units of a list in which nothing is broken, as numbers of messages."""
    found: list[list[int]] = []
    for number in range(begin, len(messages)):
        is_next = kind(form, messages[number]) == "result" or (
            form == "responses"
            and bool(found)
            and kind(form, messages[number]) == kind(form, messages[number - 1]) == "reply"
        )
        if is_next:
            found[-1].append(number)
        else:
            found.append([number])
    return found


def chosen(form: str, messages: Messages, cap: int, options: dict[str, Any]) -> set[int] | None:
    """The messages that a prompt has to show of a list in which nothing is broken; None if it does not fit.

    Results are not cut (`result_tokens=None`), and a unit that has to be is not judged here.
    """
    replies = [number for number, message in enumerate(messages) if kind(form, message) == "reply"]
    begin = replies[0] if replies else len(messages)
    if options["head"] == "system":
        begin = next((i for i, m in enumerate(messages) if m.get("role") not in ("system", "developer")), len(messages))
    has_summaries = options["strategy"] is not None
    if has_summaries:
        cap -= 3 + n("user") + n(SUMMARY) + options["strategy"].tokens
    whole = units(form, messages, begin)
    head = 3 + sum(tokens(form, message) for message in messages[:begin])
    steps, step = [], 0
    for unit in whole:
        step += any(kind(form, messages[number]) == "result" for number in unit)
        steps.append(step)
    history, slack, masks = options["history"], options["slack"], options["beyond_history"] == "mask"
    jump = math.floor(slack * history) + 1 if history is not None else 1
    oldest = 0 if history is None or step <= history else math.ceil((step - history) / jump) * jump

    def cost(at: int, *, shown: bool) -> int:
        found = 0
        for number in whole[at]:
            message = messages[number]
            if shown and steps[at] < oldest and kind(form, message) == "result":
                message = masked(form, message)
            found += tokens(form, message, opens=number == whole[at][0] or kind(form, message) != "reply")
        return found

    def newest(*roles: str) -> set[int]:
        found = [
            at
            for at, unit in enumerate(whole)
            if kind(form, messages[unit[0]]) == "word" and messages[unit[0]]["role"] in roles
        ]
        return set(found[-1:])

    last = len(whole) - 1
    pins = newest("user") | newest("system", "developer")
    places = [sum(cost(at, shown=False) for at in range(unit)) for unit in range(len(whole))]
    block = max(1, math.floor(slack * (cap - head)))
    for first in range(len(whole)):
        is_allowed = first == last or (places[first] % block == 0 or first == 0)
        if first and not is_allowed:
            is_allowed = places[first] // block > places[first - 1] // block
        if first < last and not masks and steps[first] < oldest:
            continue
        starts_at_age = not masks and first and steps[first] >= oldest > steps[first - 1]
        shown = {*range(first, len(whole)), *(pin for pin in pins if pin < first)}
        if (is_allowed or starts_at_age) and head + sum(cost(at, shown=True) for at in shown) <= cap:
            if has_summaries and first:
                return {*range(begin), *(number for at in shown for number in whole[at])}
            if options["head"] == "system" and kind(form, messages[whole[first][0]]) == "reply" and min(shown) == first:
                first = next((at for at in range(first, len(whole)) if newest_user(form, messages, whole[at])), first)
                shown = {*range(first, len(whole)), *(pin for pin in pins if pin < first)}
            return {*range(begin), *(number for at in shown for number in whole[at])}
    return None


def newest_user(form: str, messages: Messages, unit: list[int]) -> bool:
    """Whether a unit is words of a user."""
    return kind(form, messages[unit[0]]) == "word" and messages[unit[0]]["role"] == "user"


def masked(form: str, message: dict[str, Any]) -> dict[str, Any]:
    """A message whose results have left the history."""
    if form == "chat":
        return {**message, "content": MASKED}
    if form == "responses":
        return {**message, "output": MASKED}
    return {
        **message,
        "content": [{**b, "content": MASKED} if b["type"] == "tool_result" else b for b in message["content"]],
    }


def head_of(form: str, given: Messages, which: str) -> Messages:
    """The messages with which every prompt has to begin; `which` is a manager's `head`."""
    replies = [number for number, message in enumerate(given) if kind(form, message) == "reply"]
    head = [m for m in given[: replies[0] if replies else len(given)] if kind(form, m) == "word"]
    return head if which == "task" else [message for message in head[:1] if message["role"] == "system"]


def keeps_task(form: str, given: Messages, shown: Messages, which: str) -> bool:
    """Whether a prompt begins with its head, and has the user's newest words."""
    head = head_of(form, given, which)
    requests = [m for m in given if kind(form, m) == "word" and m["role"] == "user"]
    return shown[: len(head)] == head and (not requests or requests[-1] in shown)


def faults(
    form: str, given: Messages, before: str, prompt: FittedPrompt, cap: int, options: dict[str, Any]
) -> list[str]:
    """What is wrong with a prompt; `before` is the given list as JSON, from before it was fitted."""
    shown, found = prompt.messages, []
    if json.dumps(given) != before:
        found.append("the list that was given has changed")
    own = total(form, shown)
    if own > cap or prompt.tokens > cap:
        found.append(f"over its cap of {cap}: {own}, by its own count {prompt.tokens}")
    if prompt.tokens < own or (form != "responses" and prompt.tokens != own):
        found.append(f"counted {prompt.tokens} instead of {own}")
    if is_broken(form, shown):
        found.append("calls and results are apart")
    head = head_of(form, given, options["head"])
    made = [message for message, source in zip(shown, prompt.sources, strict=True) if source is None]
    summaries = [message for message in made if str(message.get("content")).startswith(SUMMARY)]
    if summaries and (summaries != [shown[len(head)]] or total(form, summaries) - 3 > prompt.parts["summary"]):
        found.append("there are several summaries, or it is not after the head")
    left = [number for number in prompt.dropped if kind(form, given[number]) != "reply" or options["own_words"] is None]
    if isinstance(options["strategy"], Summaries) and left and not summaries:
        found.append("messages have left without a summary")
    if not keeps_task(form, given, shown, options["head"]):
        found.append("the head is not whole, or the user's newest words are lost")
    kept = [number for number in range(len(given)) if number not in prompt.repaired]
    if kept and kept[-1] not in {*prompt.sources, *prompt.rewritten}:
        found.append("the newest message is lost")
    changed = {*prompt.masked, *prompt.trimmed, *prompt.cut, *prompt.repaired, *prompt.rewritten}
    for source, message in zip(prompt.sources, shown, strict=True):
        if source is not None and source not in changed and message is not given[source]:
            found.append(f"message {source} is another object")
    accounted = {*(source for source in prompt.sources if source is not None), *prompt.dropped}
    accounted |= {*prompt.repaired, *prompt.rewritten}
    if accounted != {*range(len(given))}:
        found.append("messages are neither shown nor named")
    if options["history"] is not None:
        results = sum(
            any(name == "answer" for name, _ in events(form, m)) and MASKED not in json.dumps(m) for m in shown
        )
        replies_shown = [m for m in shown if kind(form, m) == "reply"]
        if results and len(replies_shown) and form == "anthropic" and results > options["history"] + 2:
            found.append("results are older than the history")
    return found
