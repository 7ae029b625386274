"""Memory: a tool with which the agent keeps files, none of which is in view unless it looks.

The tool has the commands of Anthropic's `memory_20250818`, and is offered as that tool where the provider has it. What
the files hold, their paths included, never exceeds the cap. The files are a fold over the calls on record.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer
from smartplay_tools.context.strategies.files import ROOT, FileError, Files, Outcome
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.types import MEMORY_TOOL, Budget, ToolSpec

COMMANDS: Mapping[str, Mapping[str, bool]] = {
    "view": {"path": True, "view_range": False},
    "create": {"path": True, "file_text": True},
    "str_replace": {"path": True, "old_str": True, "new_str": True},
    "insert": {"path": True, "insert_line": True, "insert_text": True},
    "delete": {"path": True},
    "rename": {"old_path": True, "new_path": True},
}
"""The arguments of every command, and whether each is required."""

ARGUMENTS = {
    "path": "Where the file or folder is.",
    "view_range": "view: the first line and the last, -1 for the end.",
    "file_text": "create: the text of the file.",
    "old_str": "str_replace: what to replace, which occurs once.",
    "new_str": "str_replace: what replaces it.",
    "insert_line": "insert: the line after which to insert, 0 for the beginning.",
    "insert_text": "insert: the text.",
    "old_path": "rename: where it is.",
    "new_path": "rename: where it goes.",
}
"""The arguments beside `command`, and their descriptions."""


class MemoryFiles(BudgetStrategy):
    """Adds `memory`, a store of files that is not in view."""

    name = "memory_tokens"
    option_help = "Cap on the files that the agent keeps with a tool, their paths included; none: no such tool."

    def __init__(self, budget: Budget, counter: TokenCounter) -> None:
        assert budget.memory_tokens is not None
        self._cap, self._count = budget.memory_tokens, counter.text
        self.files = Files(self._tokens)
        """The files that the agent has now."""
        self.size = 0
        """The tokens of all files, their paths included."""
        self._usage = f'Call {MEMORY_TOOL} with {{"command": "view", "path": "{ROOT}"}}, for example.'
        self.tools = (StrategyTool(memory_spec(self._cap), None, self._usage, self._answer),)

    def begin(self, held: Mapping[str, str]) -> None:
        """Begin with these files."""
        self.files.apply(held)
        self.size = sum(self._tokens(path, text) for path, text in held.items())

    def _answer(self, values: Mapping[str, Any]) -> ToolAnswer:
        """Carry out a command, unless it would make the files larger than they are and larger than the cap."""
        given = {name: value for name, value in values.items() if value is not None}
        if problem := _problem(given):
            return ToolAnswer(f"{problem} {self._usage}", mistake="malformed")
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
            reason = f"The files would have {size} tokens, more than {self._cap}. Nothing was changed."
            return ToolAnswer(reason, mistake="memory")
        self.files.apply(outcome.changes)
        self.size = size
        return ToolAnswer(outcome.text)

    def _tokens(self, path: str, text: str) -> int:
        return self._count(path) + self._count(text)


def _problem(given: Mapping[str, Any]) -> str | None:
    """Return what is wrong with arguments, in a sentence."""
    command = given.get("command")
    if not isinstance(command, str) or command not in COMMANDS:
        return f"`command` must be one of {', '.join(COMMANDS)}."
    taken = COMMANDS[command]
    if missing := [name for name, is_required in taken.items() if is_required and name not in given]:
        return f"The command {command} needs {' and '.join(f'`{name}`' for name in missing)}."
    for name, value in given.items():
        if name == "command":
            continue
        if name not in taken:
            return f"The command {command} takes {' and '.join(f'`{name}`' for name in taken)} only."
        if not _KINDS[name](value):
            return f"`{name}` must be {_WANTED[name]}."
    return None


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_range(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


_KINDS = dict.fromkeys(ARGUMENTS, _is_text) | {"insert_line": _is_number, "view_range": _is_range}
_WANTED = dict.fromkeys(ARGUMENTS, "a string") | {"insert_line": "an integer", "view_range": "two integers"}


def memory_spec(cap: int) -> ToolSpec:
    """Return the tool with which an agent keeps files of at most `cap` tokens."""
    description = (
        f"Keep files below {ROOT}, which stay when older turns leave: at most {cap} tokens, paths included. None is in "
        "view unless you look. Give null for arguments that a command does not take."
    )
    integer = {"type": "integer"}
    kinds = {"insert_line": integer, "view_range": {"type": "array", "items": integer}}
    command = {"type": "string", "description": "What to do.", "enum": list(COMMANDS)}
    others = {
        name: {"anyOf": [kinds.get(name, {"type": "string"}), {"type": "null"}], "description": text}
        for name, text in ARGUMENTS.items()
    }
    properties = {"command": command, **others}
    parameters = {"type": "object", "properties": properties, "required": [*properties], "additionalProperties": False}
    return ToolSpec(MEMORY_TOOL, description, parameters)


def is_memory_tool(tool: ToolSpec) -> bool:
    """Whether a tool is that of `memory_spec`, and not a host's own of the same name."""
    return tool.name == MEMORY_TOOL and tool.parameters == memory_spec(1).parameters
