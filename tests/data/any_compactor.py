"""A compactor that does anything: everything it does follows from its seed and from what it is given."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable
from typing import Any

from smartplay_tools.context.compaction import ContextOverflowError

MARKER = "[observation left the history window]"
Messages = list[Any]


class Text(str):
    """Text of a subclass of `str`."""

    __slots__ = ()


def turns_of(messages: Messages) -> list[Messages]:
    """Return the messages before the first reply, and every reply with the messages after it."""
    turns: list[Messages] = [[]]
    for message in messages:
        if message["role"] == "assistant":
            turns.append([])
        turns[-1].append(message)
    return [turn for turn in turns if turn]


def joined(turns: list[Messages]) -> Messages:
    return [message for turn in turns for message in turn]


def text(message: Any) -> str:
    content = message.get("content")
    return content if isinstance(content, str) else ""


def user(content: Any) -> dict[str, Any]:
    return {"role": "user", "content": content}


def from_turn(messages: Messages, chance: random.Random) -> Messages:
    turns = turns_of(messages)
    return joined(turns[chance.randrange(len(turns)) :])


def with_results(messages: Messages, change: Callable[[Any], Any]) -> Messages:
    return [{**m, "content": change(m["content"])} if m["role"] == "tool" else m for m in messages]


def with_pictures(messages: Messages, change: Callable[[Any], Messages]) -> Messages:
    """Change the parts that are pictures, each into any number of parts."""

    def changed(content: Any) -> Any:
        if not isinstance(content, list):
            return content
        return [new for part in content for new in (change(part) if part.get("type") == "image" else [part])]

    return [{**m, "content": changed(m["content"])} for m in messages]


def with_ids(messages: Messages, make: Callable[[int], str]) -> Messages:
    messages, new = copy.deepcopy(messages), dict[str, str]()
    for message in messages:
        for call in message.get("tool_calls") or ():
            call["id"] = new.setdefault(call["id"], make(len(new)))
        if message["role"] == "tool":
            message["tool_call_id"] = new.get(message["tool_call_id"], message["tool_call_id"])
    return messages


def invented(messages: Messages, chance: random.Random) -> Messages:
    arguments = chance.choice(['{"a": 1}', "{", {"a": 1}, "[]", "word"])
    function = {"name": chance.choice(["act", "search", "write file"]), "arguments": arguments}
    call = {"id": chance.choice(["x1", "call_0_0", ""]), "type": "function", "function": function}
    result = {"role": "tool", "tool_call_id": call["id"], "content": chance.choice(["done", ""])}
    return [*messages, {"role": "assistant", "content": "", "tool_calls": [call]}, result]


def at(messages: Messages, place: int, *new: Any, leave: int = 0) -> Messages:
    return [*messages[:place], *new, *messages[place + leave :]]


def failing(error: Exception) -> Messages:
    raise error


def in_parts(message: Any) -> Any:
    said = text(message)
    halves = [said[: len(said) // 2], said[len(said) // 2 :]]
    return {**message, "content": [{"type": "text", "text": half} for half in halves]} if said else message


Rewriting = Callable[["AnyCompactor", Messages, random.Random], Any]

GENTLE: dict[str, Rewriting] = {
    "drop turns": lambda self, m, chance: from_turn(m, chance),
    "first and last": lambda self, m, chance: joined([turns_of(m)[0], *turns_of(m)[1:][-3:]]),
    "summary": lambda self, m, chance: [
        {
            "role": chance.choice(["user", "user", "assistant", "system", "developer"]),
            "content": f"Summary: {'word ' * chance.choice([1, 20, 200])}{self.said[-1:]}",
        },
        *from_turn(m, chance),
    ],
    "too long": lambda self, m, chance: [*m, user("word " * chance.choice([300, 3000]))],
    "long first": lambda self, m, chance: [user("word " * chance.choice([300, 3000])), *m],
    "other order of turns": lambda self, m, chance: joined(chance.sample(turns_of(m), len(turns_of(m)))),
    "cleared": lambda self, m, chance: [*with_results(m[:-3], lambda content: "[cleared]"), *m[-3:]],
    "edited": lambda self, m, chance: with_results(m, lambda c: c + "!" if isinstance(c, str) else c),
    "in parts": lambda self, m, chance: list(map(in_parts, m)),
    "no content": lambda self, m, chance: [{**e, "content": e["content"] or chance.choice([None, "", []])} for e in m],
    "merged": lambda self, m, chance: [user("\n".join(f"{e['role']}: {text(e)}" for e in m))],
    "old merged": lambda self, m, chance: [user(f"Before: {m[:2]}"), *from_turn(m, chance)],
    "text of a class": lambda self, m, chance: [{**e, "content": Text(text(e)) or e["content"]} for e in m],
    "changed later": lambda self, m, chance: self.change_later(m),
    "changed input": lambda self, m, chance: self.change_input(m),
    "told again": lambda self, m, chance: [user(f"Earlier: {self.results[-8:]}"), *m],
    "old copies": lambda self, m, chance: [
        {**e, "content": self.old.get(e["tool_call_id"], e["content"])} if e["role"] == "tool" else e for e in m
    ],
    "no picture": lambda self, m, chance: with_pictures(m, lambda part: []),
    "moved picture": lambda self, m, chance: [user([{"type": "text", "text": "Earlier:"}, *self.pictures[-3:]]), *m],
    "system": lambda self, m, chance: at(m, chance.randrange(len(m) + 1), {"role": "developer", "content": "Note."}),
    "other ids": lambda self, m, chance: with_ids(m, lambda n: f"{chance.choice(['x', 'call_', ''])}{n}"),
    "half a character": lambda self, m, chance: [user("\ud83d half"), *m],
}
"""Rewritings that mostly can be sent."""

WILD: dict[str, Rewriting] = {
    "other order": lambda self, m, chance: chance.sample(m, len(m)),
    "a message less": lambda self, m, chance: at(m, chance.randrange(len(m)), leave=1),
    "a turn twice": lambda self, m, chance: [*m, *copy.deepcopy(chance.choice(turns_of(m)))],
    "a message twice": lambda self, m, chance: at(m, place := chance.randrange(len(m)), copy.deepcopy(m[place])),
    "long ids": lambda self, m, chance: with_ids(m, lambda n: "word " * 200 + str(n)),
    "hidden field": lambda self, m, chance: [{**e, "audio": "word " * 300} for e in m],
    "hidden thoughts": lambda self, m, chance: [
        {**e, "reasoning_content": "word " * 300, "provider_items": [{"data": "word " * 300}]} for e in m
    ],
    "name": lambda self, m, chance: [{**e, "name": "word " * 50} for e in m],
    "invented call": lambda self, m, chance: invented(m, chance),
    "empty text": lambda self, m, chance: at(m, chance.randrange(len(m) + 1), user(chance.choice(["", " \n", None]))),
    "odd role": lambda self, m, chance: [*m, {"role": chance.choice(["function", "model", None, 5]), "content": "x"}],
    "ends with a reply": lambda self, m, chance: [*m, {"role": "assistant", "content": "I will play Rock."}],
    "empty": lambda self, m, chance: [],
    "nothing": lambda self, m, chance: None,
    "no messages": lambda self, m, chance: [*m, chance.choice(["text", 5, None, ("a", "b"), {}])],
    "iterator": lambda self, m, chance: iter(m),
    "raises": lambda self, m, chance: failing(chance.choice([ValueError("x"), KeyError("y"), StopIteration()])),
    "no JSON": lambda self, m, chance: [{**e, "extra": {1, 2}, "when": float("nan")} for e in m],
    "bytes": lambda self, m, chance: [*m, user(b"bytes")],
    "small picture": lambda self, m, chance: with_pictures(m, lambda part: [{**part, "width": 1, "height": 1}]),
    "invented picture": lambda self, m, chance: [user([{"type": "image", "sha256": "ab" * 32, "width": 4}]), *m],
    "picture with data": lambda self, m, chance: [user([{"type": "image_url", "image_url": {"url": "data:"}}]), *m],
}
"""Rewritings that mostly cannot be sent."""

QUESTIONS: dict[str, Callable[[Messages, random.Random], Any]] = {
    "plain": lambda m, chance: [user("Summarise: " + "word " * chance.choice([5, 50, 300]))],
    "history": lambda m, chance: [*m, user("Summarise.")],
    "system": lambda m, chance: [{"role": "system", "content": "Be short."}, user("Summarise.")],
    "long": lambda m, chance: [user("word " * 20_000)],
    "bad": lambda m, chance: [{"role": "tool", "content": "x", "tool_call_id": "?"}],
    "no list": lambda m, chance: user("Summarise."),
    "picture": lambda m, chance: [user([{"type": "image", "sha256": "0" * 64, "width": 1, "height": 1}])],
}


class AnyCompactor:
    """Draws what it does; `wild` rewritings and questions mostly end the episode."""

    def __init__(self, seed: int, wild: bool = False, persistent: bool = True) -> None:
        self._seed, self._calls, self.persistent = seed, 0, persistent
        self._is_wild = wild
        self._kinds = [*GENTLE, *WILD] if wild else [*GENTLE]
        self._asks = [*QUESTIONS] if wild else [*QUESTIONS][:4]
        self.said: list[str] = []
        self.results: list[str] = []
        self.pictures: list[Any] = []
        self.old: dict[str, Any] = {}
        self._kept: Messages = []

    def compact(self, history: Any, room: Any) -> Any:
        self._calls += 1
        chance = random.Random(f"{self._seed} {self._calls}")
        for message in history:
            if message["role"] == "tool" and message["content"] != MARKER:
                self.old.setdefault(message["tool_call_id"], message["content"])
                self.results.append(text(message))
                parts = message["content"] if isinstance(message["content"], list) else []
                self.pictures += [dict(part) for part in parts if part["type"] == "image"]
        kinds = chance.choices(self._kinds, k=chance.choice([0, 0, 0, 1, 1, 2, 3]))
        asks = chance.choices(self._asks, k=chance.choice([0, 0, 0, 0, 1, 2, 3]))
        if asks:
            return self._asking(history, asks, kinds, chance)
        return self._changed(history, kinds, chance)

    def _asking(self, history: Any, asks: list[str], kinds: list[str], chance: random.Random) -> Any:
        for ask in asks:
            try:
                reply = yield QUESTIONS[ask]([*history], chance)
                self.said.append(reply["content"])
            except ContextOverflowError:
                if chance.random() < 0.03 and self._is_wild:
                    raise
        return self._changed(history, kinds, chance)

    def _changed(self, history: Any, kinds: list[str], chance: random.Random) -> Any:
        made: Any = history if chance.random() < 0.5 else copy.deepcopy(history)
        for kind in kinds:
            if not isinstance(made, list) and kinds.index(kind):
                return made
            rewritings = GENTLE | WILD
            try:
                made = rewritings[kind](self, [*made], chance)
            except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
                if "raises" in kinds:
                    raise
                raise ValueError("It cannot change its own changes.") from error
        return made

    def change_later(self, messages: Messages) -> Messages:
        for message in self._kept:
            message["content"] = "word " * 400
        self._kept = messages
        return messages

    def change_input(self, messages: Messages) -> Messages:
        for message in messages:
            if message["role"] == "user":
                message["content"] = "changed"
        return messages
