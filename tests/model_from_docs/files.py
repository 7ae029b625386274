"""The files of the tool `memory` and what its commands answer: docs/strategies.md, "Memory".

The texts are those of the Python client's `BetaLocalFilesystemMemoryTool`, which that page names; what files on a disk
cannot do, and what their sizes are, is that page's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

ROOT = "/memories"
TAKES = {
    "view": ("path",),
    "create": ("path", "file_text"),
    "str_replace": ("path", "old_str", "new_str"),
    "insert": ("path", "insert_line", "insert_text"),
    "delete": ("path",),
    "rename": ("old_path", "new_path"),
}
TEXTS = frozenset({"path", "file_text", "old_str", "new_str", "insert_text", "old_path", "new_path"})


class Answer(NamedTuple):
    """An answer; without a text it is an error whose words the documentation leaves open."""

    text: str | None
    kind: str = ""


class _RefusalError(Exception):
    pass


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


class Files:
    """All files, by their paths, and the cap on their tokens."""

    def __init__(self, cap: int, n: Callable[[str], int]) -> None:
        """Begin without a file."""
        self._cap = cap
        self._n = n
        self.texts: dict[str, str] = {}

    def size(self, texts: Mapping[str, str] | None = None) -> int:
        """Return the tokens of all paths and texts."""
        return sum(self._n(path) + self._n(text) for path, text in (self.texts if texts is None else texts).items())

    def call(self, given: Mapping[str, Any]) -> Answer:
        """Answer a call with these arguments."""
        arguments = {key: value for key, value in given.items() if value is not None}
        command = arguments.pop("command", None)
        if not isinstance(command, str) or command not in TAKES or not self._are_well_formed(command, arguments):
            return Answer(None, "malformed")
        before = dict(self.texts)
        try:
            text: str = getattr(self, f"_{command}")(**arguments)
        except _RefusalError as refusal:
            return Answer(f"Error: {refusal}", "file")
        after, self.texts = self.texts, before
        if self.size(after) > max(self._cap, self.size(before)):
            numbers = f"{self.size(after)} tokens, more than {self._cap}"
            return Answer(f"Error: The files would have {numbers}. Nothing was changed.", "memory")
        self.texts = after
        return Answer(text)

    @staticmethod
    def _are_well_formed(command: str, arguments: Mapping[str, Any]) -> bool:
        may_be_missing = {"view_range"} if command == "view" else set()
        if not {*TAKES[command]} <= arguments.keys() <= {*TAKES[command], *may_be_missing}:
            return False
        lines = arguments.get("view_range", [1, 1])
        return (
            all(isinstance(value, str) for key, value in arguments.items() if key in TEXTS)
            and _is_integer(arguments.get("insert_line", 0))
            and (isinstance(lines, list) and len(lines) == 2 and all(map(_is_integer, lines)))
        )

    def _is_folder(self, path: str) -> bool:
        return path == ROOT or any(file.startswith(f"{path}/") for file in self.texts)

    def _exists(self, path: str) -> bool:
        return path in self.texts or self._is_folder(path)

    @staticmethod
    def _checked(path: str) -> str:
        if path != ROOT and not path.startswith(f"{ROOT}/"):
            raise _RefusalError(f"Path must start with {ROOT}, got: {path}")
        names = path.split("/")[2:]
        if {".", ".."} & {*names}:
            raise _RefusalError(f"Path {path} would escape {ROOT} directory")
        if "" in names or "\0" in path:
            raise _RefusalError(f"The path {path} does not exist. Please provide a valid path.")
        return path

    def _parent_is_folder(self, path: str) -> None:
        names = path.split("/")
        for length in range(3, len(names)):
            if (parent := "/".join(names[:length])) in self.texts:
                raise _RefusalError(f"The path {parent} is not a directory.")

    def _file(self, path: str) -> str:
        if not self._exists(self._checked(path)):
            raise _RefusalError(f"The path {path} does not exist. Please provide a valid path.")
        if path not in self.texts:
            raise _RefusalError(f"The path {path} is not a file.")
        return self.texts[path]

    @staticmethod
    def _numbered(lines: list[str], first: int) -> str:
        return "\n".join(f"{number:>6}\t{line}" for number, line in enumerate(lines, first))

    def _view(self, path: str, view_range: list[int] | None = None) -> str:
        if not self._exists(self._checked(path)):
            raise _RefusalError(f"The path {path} does not exist. Please provide a valid path.")
        if path not in self.texts:
            return self._listing(path)
        lines = self.texts[path].split("\n")
        first, last = view_range or (1, -1)
        first, last = max(1, first), len(lines) if last == -1 else last
        shown = [line for number, line in enumerate(lines, 1) if first <= number <= last]
        return f"Here's the content of {path} with line numbers:\n{self._numbered(shown, first)}"

    def _listing(self, folder: str) -> str:
        sizes: dict[tuple[str, ...], tuple[int, bool]] = {}
        for path, text in self.texts.items():
            if not path.startswith(f"{folder}/"):
                continue
            names = tuple(path[len(folder) + 1 :].split("/"))
            for depth in range(len(names) + 1):
                tokens, _ = sizes.get(names[:depth], (0, True))
                sizes[names[:depth]] = (tokens + self._n(path) + self._n(text), depth < len(names))
        lines = [f"{sizes.get((), (0, True))[0]} tokens\t{folder}"]
        for names, (tokens, is_folder) in sorted(sizes.items()):
            if 0 < len(names) <= 2 and not any(name.startswith(".") for name in names):
                lines.append(f"{tokens} tokens\t{folder}/{'/'.join(names)}{'/' if is_folder else ''}")
        title = f"Here're the files and directories up to 2 levels deep in {folder}, excluding hidden items:"
        return "\n".join([title, *lines])

    def _create(self, path: str, file_text: str) -> str:
        if self._exists(self._checked(path)):
            raise _RefusalError(f"File {path} already exists")
        self._parent_is_folder(path)
        self.texts = {**self.texts, path: file_text}
        return f"File created successfully at: {path}"

    def _str_replace(self, path: str, old_str: str, new_str: str) -> str:
        text = self._file(path)
        starts = [at for at in range(len(text) + 1) if text.startswith(old_str, at)]
        numbers = [text[:at].count("\n") + 1 for at in starts]
        if not starts:
            raise _RefusalError(
                f"No replacement was performed, old_str `{old_str}` did not appear verbatim in {path}.",
            )
        if text.count(old_str) > 1:
            raise _RefusalError(
                f"No replacement was performed. Multiple occurrences of old_str `{old_str}` in lines: "
                f"{', '.join(map(str, numbers))}. Please ensure it is unique",
            )
        changed = text[: starts[0]] + new_str + text[starts[0] + len(old_str) :]
        self.texts = {**self.texts, path: changed}
        first = max(1, numbers[0] - 2)
        around = self._numbered(changed.split("\n")[first - 1 : numbers[0] + 2], first)
        title = "The memory file has been edited. Here is the snippet showing the change (with line numbers):"
        return f"{title}\n{around}"

    def _insert(self, path: str, insert_line: int, insert_text: str) -> str:
        lines = self._file(path).split("\n")
        if lines[-1] == "":
            lines.pop()
        if not 0 <= insert_line <= len(lines):
            allowed = f"It should be within the range [0, {len(lines)}]."
            raise _RefusalError(f"Invalid `insert_line` parameter: {insert_line}. {allowed}")
        text = "\n".join([*lines[:insert_line], insert_text.rstrip("\n"), *lines[insert_line:]])
        self.texts = {**self.texts, path: text if text.endswith("\n") else f"{text}\n"}
        return f"The file {path} has been edited."

    def _moved(self, path: str) -> list[str]:
        return [file for file in self.texts if file == path or file.startswith(f"{path}/")]

    def _delete(self, path: str) -> str:
        if self._checked(path) == ROOT:
            raise _RefusalError(f"Cannot delete the {ROOT} directory itself")
        if not self._exists(path):
            raise _RefusalError(f"The path {path} does not exist")
        gone = self._moved(path)
        self.texts = {file: text for file, text in self.texts.items() if file not in gone}
        return f"Successfully deleted {path}"

    def _rename(self, old_path: str, new_path: str) -> str:
        self._checked(old_path)
        self._checked(new_path)
        if old_path == ROOT:
            raise _RefusalError(f"Cannot rename the {ROOT} directory itself")
        if self._exists(new_path):
            raise _RefusalError(f"The destination {new_path} already exists")
        if not self._exists(old_path):
            raise _RefusalError(f"The path {old_path} does not exist")
        if new_path.startswith(f"{old_path}/"):
            raise _RefusalError(f"The destination {new_path} is below {old_path}")
        self._parent_is_folder(new_path)
        moved = self._moved(old_path)
        self.texts = {
            new_path + file[len(old_path) :] if file in moved else file: text for file, text in self.texts.items()
        }
        return f"Successfully renamed {old_path} to {new_path}"
