"""Memory: a tool with which the agent keeps files, none of which is in view unless it looks.

The tool has the commands of Anthropic's `memory_20250818`, and is offered as that tool where the provider has it. What
the files hold, their paths included, never exceeds the cap. The files are a fold over the calls on record.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer
from smartplay_tools.context.strategies.files import FileError, Files, Outcome
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.transcript.events import CallEvent
from smartplay_tools.types import MEMORY_TOOL, Budget, ToolSpec
from smartplay_tools.types.arguments import read

COMMANDS: Mapping[str, Mapping[str, bool]] = {
    "view": {"path": True, "view_range": False},
    "create": {"path": True, "file_text": True},
    "str_replace": {"path": True, "old_str": True, "new_str": True},
    "insert": {"path": True, "insert_line": True, "insert_text": True},
    "delete": {"path": True},
    "rename": {"old_path": True, "new_path": True},
}
"""The arguments of every command, and whether each is required."""


class MemoryFiles(BudgetStrategy):
    """Adds `memory`, a store of files that is not in view."""

    name = "memory_tokens"
    option_help = "Cap on the files that the agent keeps with a tool, their paths included; none: no such tool."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        assert budget.memory_tokens is not None
        self._cap, self._count, self._words = budget.memory_tokens, counter.text, words
        self.files = Files(self._tokens, words)
        """The files that the agent has now."""
        self.size = 0
        """The tokens of all files, their paths included."""
        spec = memory_spec(self._cap, words)
        self.tools = (StrategyTool(spec, None, words("memory_usage"), self._answer),)

    def begin(self, held: Mapping[str, str]) -> None:
        """Begin with these files."""
        self.files.apply(held)
        self.size = sum(self._tokens(path, text) for path, text in held.items())

    def _answer(self, values: Mapping[str, Any]) -> ToolAnswer:
        """Carry out a command, unless it would make the files larger than they are and larger than the cap."""
        given = {name: value for name, value in values.items() if value is not None}
        if problem := self._problem(given):
            return ToolAnswer(problem, mistake="malformed")
        try:
            outcome: Outcome = getattr(self.files, given.pop("command"))(**given)
        except FileError as error:
            return ToolAnswer(str(error), mistake="file")
        size = self.size
        for path, text in outcome.changes.items():
            if path in self.files.texts:
                size -= self._tokens(path, self.files.texts[path])
            size += 0 if text is None else self._tokens(path, text)
        if self._cap < size > self.size:
            return ToolAnswer(self._words("memory_too_large", size=size, cap=self._cap), mistake="memory")
        self.files.apply(outcome.changes)
        self.size = size
        return ToolAnswer(outcome.text)

    def _tokens(self, path: str, text: str) -> int:
        return self._count(path) + self._count(text)

    def _problem(self, given: Mapping[str, Any]) -> str | None:
        """Return what is wrong with arguments, and how to call the tool."""
        words, usage = self._words, self._words("memory_usage")
        command = given.get("command")
        if not isinstance(command, str) or command not in COMMANDS:
            return words("memory_no_command", commands=", ".join(COMMANDS), usage=usage)
        taken = COMMANDS[command]
        if missing := [name for name, is_required in taken.items() if is_required and name not in given]:
            return words("memory_needs", command=command, arguments=self._listed(missing), usage=usage)
        for name, value in given.items():
            if name == "command":
                continue
            if name not in taken:
                return words("memory_takes", command=command, arguments=self._listed(taken), usage=usage)
            is_right, kind = KINDS.get(name, STRING)[:2]
            if not is_right(value):
                return words("memory_kind", argument=name, kind=words(kind), usage=usage)
        return None

    def _listed(self, arguments: Iterable[str]) -> str:
        return self._words("memory_and").join(f"`{name}`" for name in arguments)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_range(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


STRING = (_is_text, "memory_string", {"type": "string"})
INTEGER = (_is_number, "memory_integer", {"type": "integer"})
INTEGERS = (_is_range, "memory_integers", {"type": "array", "items": {"type": "integer"}})
KINDS = {"insert_line": INTEGER, "view_range": INTEGERS}
"""The arguments that are no texts: how each is checked, the name of its kind in `Wording`, and its schema."""


class FilesStore:
    """The files of the tool `memory`, none of which is in view."""

    field = "memory_tokens"
    kept = "files"

    @staticmethod
    def after(calls: Iterable[CallEvent], before: Mapping[str, str] | None, words: Wording) -> dict[str, str] | None:
        """Return the files after the commands that were carried out; None if there are none."""
        files = Files(lambda path, text: 0, words)  # sizes are for answers, which are on record
        files.apply(before or {})
        for call in calls:
            if call["name"] == MEMORY_TOOL and not call["is_error"]:
                sent = read(call["arguments"]).values or {}
                given = {name: value for name, value in sent.items() if value is not None}
                command = given.pop("command")
                if command not in COMMANDS:
                    raise ValueError(f"{command!r} is not a command of the memory")
                files.apply(getattr(files, command)(**given).changes)
        return dict(files.texts) or None


def memory_spec(cap: int, words: Wording) -> ToolSpec:
    """Return the tool with which an agent keeps files of at most `cap` tokens."""
    command = {"type": "string", "description": words("memory_command"), "enum": list(COMMANDS)}
    others = {
        name: {"anyOf": [KINDS.get(name, STRING)[2], {"type": "null"}], "description": words(f"memory_{name}")}
        for name in dict.fromkeys(name for taken in COMMANDS.values() for name in taken)
    }
    properties = {"command": command, **others}
    parameters = {"type": "object", "properties": properties, "required": [*properties], "additionalProperties": False}
    return ToolSpec(MEMORY_TOOL, words("memory", cap=cap), parameters)
