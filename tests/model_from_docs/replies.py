"""Hostile replies: what a model can send, right and wrong, several calls at a time."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from typing import Any

import smartplay_tools as sp
from smartplay_tools.types.messages import MessageToolCall

from .files import TAKES

WORDS = (
    "Rock",
    "İ",
    "ß",
    "ROCK",
    "won",
    "tied",
    "12",
    "Lizard_x",
    "step",
    "act",
    "\ud83d",
    "naïve",
    "你好",
    "🂡",
    "score",
)
PATHS = (
    *(f"/memories/{name}" for name in ("a", "b", "d/e", "d/f/g", "d", ".h", "d/.h/x", "a/b", "é")),
    *("/memories", "/memories/", "/x", "/memories/../a", "/memories//a", "/memoriesa", "", "/memories/a\0"),
)
IDS = ("c", "c", "", "call_1", "é", "toolu_01")


class Speaker:
    """Draws replies for an episode."""

    def __init__(self, rng: random.Random, tools: Sequence[sp.ToolSpec], actions: Sequence[str], foreign: str) -> None:
        """`foreign` is the name of a tool of the host."""
        self._rng = rng
        self._tools = [tool.name for tool in tools]
        self._actions = actions
        self._foreign = foreign if foreign in self._tools else None
        self._kind = rng.choice(("steady", "steady", "wild", "idle", "curious", "many", "devoted", "devoted"))
        added = [tool for tool in self._tools if tool in ("take_notes", "recall", "read_result", "memory")]
        self._favourite = rng.choice(added) if added and self._kind == "devoted" else None
        self._used = ["{}"]
        self.heard: list[str] = ["Rock"]
        """Words of the results so far, to look for."""

    def text(self, most: int = 12) -> str:
        """Return some words, hard ones among them."""
        rng = self._rng
        words = [rng.choice(WORDS) for _ in range(rng.randint(0, most))]
        return rng.choice((" ", " ", "\n", "\n\n", "-")).join(words)

    def reply(self) -> dict[str, Any]:
        """Return a reply to a prompt to play."""
        rng = self._rng
        likely = {"steady": 0.99, "wild": 0.85, "idle": 0.5, "curious": 0.97, "many": 0.98, "devoted": 0.99}[self._kind]
        count = 0 if rng.random() > likely else 1
        while count and rng.random() < (0.6 if self._kind == "many" else 0.1) and count < 5:
            count += 1
        message: dict[str, Any] = {"role": "assistant", "content": rng.choice((None, "", self.text(), self.text(40)))}
        if rng.random() < 0.1:
            message["content"] = [{"type": "text", "text": self.text()}, {"type": "text", "text": self.text()}]
        if rng.random() < 0.2:
            message["reasoning_content"] = self.text(30)
        if rng.random() < 0.1:
            message["provider_items"] = [{"type": "thinking", "thinking": self.text(), "signature": "zzz"}]
        if rng.random() < 0.05:
            message["name"] = "bob"
        if count:
            message["tool_calls"] = [self._call() for _ in range(count)]
        return message

    def summary(self) -> dict[str, Any]:
        """Return a reply to a prompt for a summary: empty, long, with calls."""
        rng = self._rng
        text = rng.choice((None, "", " \n", self.text(), self.text(60), self.text(200)))
        message: dict[str, Any] = {"role": "assistant", "content": text}
        if rng.random() < 0.2:
            message["tool_calls"] = [self._call()]
        return message

    def _call(self) -> MessageToolCall:
        rng = self._rng
        name, arguments = self._named()
        if rng.random() < 0.1:
            arguments = rng.choice(self._used)
        if rng.random() < (0.15 if self._kind == "wild" else 0.02):
            arguments = self._broken(arguments)
        self._used.append(arguments)
        return {"id": rng.choice(IDS), "type": "function", "function": {"name": name, "arguments": arguments}}

    def _named(self) -> tuple[str, str]:
        rng = self._rng
        other = [tool for tool in self._tools if tool not in ("act", "observe", "read_manual")]
        acts = 0.35 if self._kind == "curious" else 0.65
        draw = rng.random()
        if self._favourite and rng.random() < 0.6:
            return self._favourite, self._json(self._values(self._favourite))
        if draw < acts or (not other and draw < 0.85):
            return "act", self._json({"action": self._action()})
        if draw > 0.98:
            return rng.choice(("Act", "move", "", "observe ", *self._tools)), rng.choice(("{}", "", '{"x": 1}'))
        name = rng.choice([*other, *other, "observe", "read_manual"])
        return name, self._json(self._values(name))

    def _values(self, name: str) -> dict[str, Any]:
        rng = self._rng
        if name == "take_notes":
            return {"text": rng.choice((self.text(), self.text(30), " ", "", "kept"))}
        if name == "recall":
            return {"query": self._query()}
        if name == "read_result":
            return {"page": f"r{rng.randint(0, 8)}.{rng.choice((1, 2, 2, 2, 3, 4, 9))}"}
        if name == "memory":
            return self._memory()
        return {"x": self.text()} if name == self._foreign else {}

    def _json(self, values: Any) -> str:
        separators = self._rng.choice(((", ", ": "), (",", ":"), (" ,  ", ":\n")))
        return json.dumps(values, ensure_ascii=self._rng.random() < 0.5, separators=separators)

    def _action(self) -> str:
        rng = self._rng
        number = rng.randrange(len(self._actions))  # of Crafter's actions, the numbers are others
        action = self._actions[number]
        wrong = (f"{number + 1}. {self._actions[number - 1]}", "", "Fly", "0", "99", "1..", f"{action}..", "-1", "１")
        right = (action.upper(), f" {action}.\n", str(number + 1), f"{number + 1}.", f"{number + 1}. {action}")
        return action if rng.random() < 0.75 else rng.choice(right if rng.random() < 0.7 else wrong)

    def _query(self) -> str:
        rng = self._rng
        first, last = rng.randint(0, 12), rng.randint(0, 30)
        steps = (
            f"{first}",
            f" {first} - {last}\u2003",
            f"{first}-{last}",
            "0-999999",
            "0-9999999",
            "0000003",
            "١",
            "3–5",
            "-1",
        )
        if rng.random() < 0.4:
            return " ".join(rng.choice(self.heard) for _ in range(rng.randint(1, 5)))
        return rng.choice((*steps, self.text(), self.text(3), self._action(), "opponent chose", "the", ""))

    def _memory(self) -> dict[str, Any]:
        rng = self._rng
        command = rng.choice((*TAKES, "create", "create", "view"))
        path = rng.choice(PATHS[: rng.choice((1, 2, 6))]) if rng.random() < 0.8 else rng.choice(PATHS)
        values: dict[str, Any] = {"command": command, "path": path}
        texts = (self.text(4), self.text(4), "", "\n", "a\nb\nc\n", "a", "x" * rng.choice((1, 30)))
        everything = {
            **{name: rng.choice(PATHS[:8]) for name in ("path", "old_path", "new_path")},
            **{name: rng.choice(texts) for name in ("file_text", "old_str", "new_str", "insert_text")},
            "insert_line": rng.choice((0, 0, 1, 2, 3, -1, 99, "1", 1.0, True)),
        }
        values = {"command": command, **{name: everything[name] for name in TAKES[command]}}
        if "path" in values:
            values["path"] = path
        if command == "view" and rng.random() < 0.4:
            ranges = ([1, 2], [2, -1], [0, 1], [-3, 2], [3, 2], [1, -2], [2, 99], [1], "x", [1.0, 2], None)
            values["view_range"] = rng.choice(ranges)
        if rng.random() < 0.2:
            values |= {name: None for name in everything if name not in values}
        if rng.random() < 0.05:
            values[rng.choice([*everything, "other"])] = rng.choice((None, "x", 1, ["/memories/a"]))
        if rng.random() < 0.03:
            values["command"] = rng.choice((None, "VIEW", 1, "undo"))
        if rng.random() < 0.05:
            del values[rng.choice([*values])]
        return values

    def _broken(self, arguments: str) -> str:
        broken = (
            "[]",
            "null",
            "",
            '"Rock"',
            '{"action": "1", "action": "1"}',
            '{"action": NaN}',
            '{"x": 1e999}',
            "{" * 200,
        )
        long = (
            json.dumps({"action": "x" * 9_000}),
            json.dumps({"action": "x " * 6_000}),
            '{"text": ' + "[" * 100 + "]" * 100 + "}",
        )
        return self._rng.choice(
            (*broken, *long, arguments[:-1], f"{arguments} ", f"{arguments}x", f"\ufeff{arguments}")
        )
