"""A judge of fitted prompts, written from docs/any-agent.md: it counts, pairs and chooses by its own code.

`Judge` names what is wrong with the prompts of a conversation. Its tokenizer is its own, too: the manager gets it as an
object.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from itertools import accumulate
from typing import Any

from smartplay_tools import FittedPrompt, Summaries
from tests.manager.histories import Messages

MASKED = "[result left the history window]"
SUMMARY = "Summary of the conversation before this point:\n"


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


class Judge:
    """Judges the prompts of a conversation that grows.

    What a given message costs is counted once; that none was changed is seen at the end (`changed`).
    """

    def __init__(self, form: str, given: Messages, cap: int, options: dict[str, Any]) -> None:
        self.form, self.given, self.cap, self.options = form, given, cap, options
        self._before, self._kinds = json.dumps(given), [kind(form, message) for message in given]
        self._sizes: dict[tuple[int, bool, bool], int] = {}

    def changed(self) -> list[str]:
        """What is wrong with the list that was given."""
        return [] if json.dumps(self.given) == self._before else ["the list that was given has changed"]

    def _size(self, number: int, *, opens: bool = True, is_masked: bool = False) -> int:
        """The tokens of a given message, whole or with its results masked."""
        key = number, opens, is_masked
        if key not in self._sizes:
            message = self.given[number]
            self._sizes[key] = tokens(self.form, masked(self.form, message) if is_masked else message, opens=opens)
        return self._sizes[key]

    def _total(self, prompt: FittedPrompt) -> int:
        """The tokens of a prompt without tools."""
        found, before = 3, None
        for message, source in zip(prompt.messages, prompt.sources, strict=True):
            opens = self.form != "responses" or before is None or kind(self.form, before) != "reply"
            is_given = source is not None and message is self.given[source]
            found += self._size(source or 0, opens=opens) if is_given else tokens(self.form, message, opens=opens)
            before = message
        return found

    def _is_user(self, number: int) -> bool:
        return self._kinds[number] == "word" and self.given[number]["role"] == "user"

    @property
    def is_defined(self) -> bool:
        """Whether `chosen` knows the rules that the options need."""
        rules = (self.options[name] for name in ("result_tokens", "own_words", "first_turns"))
        is_built_in = self.options["strategy"] is None or isinstance(self.options["strategy"], Summaries)
        return is_built_in and all(rule is None for rule in rules)

    def chosen(self, end: int) -> set[int] | None:
        """The messages that a prompt has to show of the first `end`, if nothing is broken; None if it does not fit.

        Results are not cut (`result_tokens=None`), and a unit that has to be is not judged here.
        """
        messages, cap, options = self.given[:end], self.cap, self.options
        begin = next((at for at in range(end) if self._kinds[at] == "reply"), end)
        if options["head"] == "system":
            begin = next((i for i, m in enumerate(messages) if m.get("role") not in ("system", "developer")), end)
        has_summaries = options["strategy"] is not None
        if has_summaries:
            cap -= 3 + n("user") + n(SUMMARY) + options["strategy"].tokens
        whole = units(self.form, messages, begin)
        if not whole:
            return {*range(end)}
        last, room = len(whole) - 1, cap - 3 - sum(self._size(number) for number in range(begin))
        steps = [*accumulate(any(self._kinds[number] == "result" for number in unit) for unit in whole)]
        step, history, slack = steps[-1], options["history"], options["slack"]
        masks = options["beyond_history"] == "mask"
        jump = math.floor(slack * history) + 1 if history is not None else 1
        oldest = 0 if history is None or step <= history else math.ceil((step - history) / jump) * jump

        def cost(at: int, *, shown: bool) -> int:
            return sum(
                self._size(
                    number,
                    opens=number == whole[at][0] or self._kinds[number] != "reply",
                    is_masked=shown and steps[at] < oldest and self._kinds[number] == "result",
                )
                for number in whole[at]
            )

        def newest(*roles: str) -> set[int]:
            words = (at for at in range(last, -1, -1) if self._kinds[whole[at][0]] == "word")
            return {*[at for at in words if messages[whole[at][0]]["role"] in roles][:1]}

        pins = newest("user") | newest("system", "developer")
        sizes = [cost(at, shown=True) for at in range(last + 1)]
        places = [0, *accumulate(cost(at, shown=False) for at in range(last + 1))]
        block = max(1, math.floor(slack * room))
        for first in range(last + 1):
            is_allowed = first in (0, last) or places[first] % block == 0
            if not is_allowed:
                is_allowed = places[first] // block > places[first - 1] // block
            if first < last and not masks and steps[first] < oldest:
                continue
            starts_at_age = not masks and first and steps[first] >= oldest > steps[first - 1]
            before = {pin for pin in pins if pin < first}
            if (is_allowed or starts_at_age) and sum(sizes[first:]) + sum(sizes[pin] for pin in before) <= room:
                is_reply = self._kinds[whole[first][0]] == "reply"
                if options["head"] == "system" and is_reply and not before and not (has_summaries and first):
                    users = (at for at in range(first, last + 1) if self._is_user(whole[at][0]))
                    first = next(users, first)
                    before = {pin for pin in pins if pin < first}
                shown = {*range(first, last + 1), *before}
                return {*range(begin), *(number for at in shown for number in whole[at])}
        return None

    def faults(self, end: int, prompt: FittedPrompt) -> list[str]:
        """What is wrong with a prompt of the first `end` messages."""
        form, options, shown, found = self.form, self.options, prompt.messages, list[str]()
        own = self._total(prompt)
        if own > self.cap or prompt.tokens > self.cap:
            found.append(f"over its cap of {self.cap}: {own}, by its own count {prompt.tokens}")
        if prompt.tokens < own or (form != "responses" and prompt.tokens != own):
            found.append(f"counted {prompt.tokens} instead of {own}")
        if is_broken(form, shown):
            found.append("calls and results are apart")
        begin = next((at for at in range(end) if self._kinds[at] == "reply"), end)
        head = head_of(form, self.given[:begin], options["head"])
        made = [message for message, source in zip(shown, prompt.sources, strict=True) if source is None]
        summaries = [message for message in made if str(message.get("content")).startswith(SUMMARY)]
        if summaries and (summaries != [shown[len(head)]] or total(form, summaries) - 3 > prompt.parts["summary"]):
            found.append("there are several summaries, or it is not after the head")
        replies_may_go = options["own_words"] is not None
        left = [number for number in prompt.dropped if self._kinds[number] != "reply" or not replies_may_go]
        if isinstance(options["strategy"], Summaries) and left and not summaries:
            found.append("messages have left without a summary")
        request = next((number for number in range(end - 1, -1, -1) if self._is_user(number)), None)
        if shown[: len(head)] != head or not (request is None or self.given[request] in shown):
            found.append("the head is not whole, or the user's newest words are lost")
        repaired = {*prompt.repaired}
        newest = next((number for number in range(end - 1, -1, -1) if number not in repaired), None)
        if newest is not None and newest not in {*prompt.sources, *prompt.rewritten}:
            found.append("the newest message is lost")
        changed = {*prompt.masked, *prompt.trimmed, *prompt.cut, *repaired, *prompt.rewritten}
        for source, message in zip(prompt.sources, shown, strict=True):
            if source is not None and source not in changed and message is not self.given[source]:
                found.append(f"message {source} is another object")
        accounted = {source for source in prompt.sources if source is not None}
        if accounted | {*prompt.dropped} | repaired | {*prompt.rewritten} != {*range(end)}:
            found.append("messages are neither shown nor named")
        if options["history"] is not None and form == "anthropic":
            answering = (m for m in shown if any(name == "answer" for name, _ in events(form, m)))
            results = sum(MASKED not in json.dumps(message) for message in answering)
            if results > options["history"] + 2 and any(kind(form, m) == "reply" for m in shown):
                found.append("results are older than the history")
        return found
