"""Drafts: what a prompt shows of a conversation before anybody is asked: head, units, and tokens by part."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.errors import InvalidArgumentError, PromptOverflowError
from smartplay_tools.manager.asking import Asking
from smartplay_tools.manager.counting import Cost
from smartplay_tools.manager.fitted import Conversation, Draft
from smartplay_tools.manager.forms import FORMS, Given, MessageForm
from smartplay_tools.manager.plain import named
from smartplay_tools.manager.reading import Reading, kind_of
from smartplay_tools.manager.settings import Settings
from smartplay_tools.manager.strategy import AskedStrategy
from smartplay_tools.manager.summaries import Covered
from smartplay_tools.manager.tools import specs_of
from smartplay_tools.manager.units import Chosen, Part, Shown
from smartplay_tools.manager.window import AgentWindow
from smartplay_tools.transcript.hashing import canonical_json

READINGS = 16
"""How many conversations are remembered, by their heads."""


class Drafts:
    """Makes drafts of prompts, and remembers the latest readings."""

    def __init__(self, settings: Settings, asking: Asking) -> None:
        self._settings, self._asking = settings, asking
        self._counter, self._messages = settings.messages.counter, settings.messages
        self._readings: dict[object, Reading] = {}

    def of(self, conversation: Conversation, beside: Mapping[str, Any], *, has_summary: bool) -> Draft:
        """Return the draft of a conversation; `has_summary` says whether a summary will be shown of what leaves."""
        data, keys, form = conversation.data, conversation.keys, conversation.form
        schema = beside["output_schema"]
        tool_tokens = self._tool_tokens(beside["tools"]) + (self._counter.text(json.dumps(schema)) if schema else 0)
        begin = self.first_reply(data, form)
        messages_of_head, left_out = self._head_of(data[:begin], form)
        head = [Part(n, m, self._cost(n, m, form, keys), m is data[n]) for n, m in messages_of_head]
        head_tokens = PRIMING + self._system_tokens(beside["system"]) + sum(part.cost.whole for part in head)
        parts = {"tools": tool_tokens, "head": head_tokens}
        reserved = parts if self._asking.summaries is None else {**parts, "summary": self._asking.summaries.reserve}
        cap = self._settings.budget.prompt_tokens
        room = math.inf if cap is None else cap - sum(reserved.values())
        if room < 0:
            raise PromptOverflowError.of(cap or 0, reserved)
        reading = self._reading(form, begin, self._most(room), keys)
        reading.read(data, keys)
        reading.window.reserved = cap or 0, reserved
        repaired = sorted({*left_out, *reading.repaired})
        if not self._settings.repair and (repaired or reading.made):
            self._refuse(repaired, reading)
        lacks_user = all(message.get("role") != "user" for _, message in messages_of_head)
        draft = Draft([*map(Shown.whole, head)], parts, repaired, len(reading.made), lacks_user)
        if self._asking.strategy is not None:
            lead = []
            if self._asking.strategy.compacts:
                lead = [*itertools.dropwhile(lambda part: part.message.get("role") in ("system", "developer"), head)]
            seed, tokens = self._seed(data[:begin], form, beside), None if math.isinf(room) else int(room)
            asked = AskedStrategy(reading.copy(), seed, tokens, (cap or 0, parts), lead, lacks_user)
            return replace(draft, head=draft.head[: len(head) - len(lead)], asked=asked)
        chosen, covered = Chosen(pinned=range(0)), None
        if reading.turns:
            users = reading.users if lacks_user and not has_summary else ()
            chosen = reading.window.newest_units(room, reading.kept(len(reading.turns)), users)
        if has_summary and (first := len(chosen.pinned)):
            ends = reading.window.beginnings(room, first)
            covered = Covered(
                self._seed(data[:begin], form, beside), [turn.unit for turn in reading.turns[:first]], ends, form
            )
        return replace(draft, chosen=chosen, covered=covered)

    def _seed(self, head: Sequence[Given], form: MessageForm, beside: Mapping[str, Any]) -> bytes:
        """The digest of what shapes prompts beside their units."""
        return canonical_json([self._settings.recorded | self._asking.recorded, form.name, head, beside])

    def first_reply(self, data: Sequence[Given], form: MessageForm) -> int:
        """The number of the first message after the head."""
        for number, message in enumerate(data):
            kind = kind_of(form, number, message)
            if kind == "reply":
                return number
            if self._settings.head == "system" and (
                kind == "result" or message.get("role") not in ("system", "developer")
            ):
                return number
        return len(data)

    @staticmethod
    def _head_of(data: Sequence[Given], form: MessageForm) -> tuple[list[tuple[int, Given]], list[int]]:
        """The messages of the head with their numbers, and those that lost results, since no call is before them."""
        head: list[tuple[int, Given]] = []
        changed: list[int] = []
        for number, message in enumerate(data):
            if form.kind(message) != "result":
                head.append((number, message))
                continue
            changed.append(number)
            words = form.with_results(message, [None] * len(form.results(message)))
            if words is not None:
                head.append((number, words))
        return head, changed

    def _cost(self, number: int, message: Given, form: MessageForm, keys: Sequence[object]) -> Cost:
        """The cost of a message of the head."""
        with named(f"Message {number}"):
            return self._messages.cost(message, form, None, keys[number])

    def _system_tokens(self, system: str | Sequence[Any] | None) -> int:
        if not system:
            return 0
        return self._messages.tokens({"role": "system", "content": system}, FORMS["chat"])

    def _tool_tokens(self, tools: Iterable[Any]) -> int:
        specs, extra = specs_of(tools, self._messages.extra)
        return self._counter.tools(specs) + extra

    def _most(self, room: float) -> int | None:
        """The cap on a result."""
        if self._settings.result_tokens == "auto":
            return None if math.isinf(room) else max(32, int(room) // 4)
        return self._settings.result_tokens

    def _reading(self, form: MessageForm, begin: int, most: int | None, keys: Sequence[object]) -> Reading:
        """The reading of this conversation so far; a new one if its head is not known."""
        known = form.name, begin, most, *keys[:begin]
        reading = self._readings.pop(known, None)
        if reading is None:
            window = AgentWindow(form, self._messages, self._settings.budget)
            reading = Reading(window, begin, most, self._settings.pin or (lambda _: False))
        self._readings[known] = reading
        if len(self._readings) > READINGS:
            del self._readings[next(iter(self._readings))]
        return reading

    def _refuse(self, repaired: Sequence[int], reading: Reading) -> None:
        if repaired:
            raise InvalidArgumentError(
                f"Message {repaired[0]} does not fit its neighbours: a result without its call, or apart from it. "
                "Mend the list, or let repair=True do it."
            )
        source = reading.turns[reading.made[0]].unit.parts[0].source
        raise InvalidArgumentError(
            f"A call of message {source} has no result. Mend the list, or let repair=True do it."
        )
