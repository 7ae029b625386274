"""Files: the store behind the tool `memory`, with the commands and the answers of Anthropic's `memory_20250818`.

A path is /memories, then names; it is taken literally, and is a file or a folder, never both. Folders exist while a
file is below them. A command answers with a text and the changes that it makes; nothing changes until they are applied.

The texts are in `Wording`; listings give tokens in place of sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from smartplay_tools.context.prompts.wording import Wording

ROOT = "/memories"
LEVELS = 2
"""How many levels below a folder its listing shows."""
NUMBER_WIDTH = 6
"""The width of a line number."""
AROUND = 2
"""How many lines the answer shows before and after a change."""


class FileError(Exception):
    """A command that cannot be carried out; its message is what the agent is told."""


@dataclass(frozen=True)
class Outcome:
    """The answer to a command, and what the command changes."""

    text: str
    changes: Mapping[str, str | None] = field(default_factory=dict)
    """The new texts of files, by path; None deletes a file."""


class Files:
    """The files of one agent."""

    def __init__(self, tokens: Callable[[str, str], int], words: Wording) -> None:
        """`tokens` counts a file, given its path and its text; `words` are those of the answers."""
        self._words = words
        self.texts: dict[str, str] = {}
        """The text of every file, by its path."""
        self._tokens = tokens

    def apply(self, changes: Mapping[str, str | None]) -> None:
        """Make changes."""
        for path, text in changes.items():
            if text is None:
                del self.texts[path]
            else:
                self.texts[path] = text

    # The commands.

    def view(self, path: str, view_range: Sequence[int] | None = None) -> Outcome:
        """Show a file with line numbers, or list a folder."""
        self._check(path)
        if path in self.texts:
            lines = self.texts[path].split("\n")
            first, last = (1, -1) if view_range is None else view_range
            start = max(1, first)
            shown = lines[start - 1 : len(lines) if last == -1 else max(0, last)]
            return Outcome(self._words("memory_shown", path=path, lines=_numbered(shown, start)))
        if not self._is_folder(path):
            raise self._error("memory_invalid_path", path=path)
        title = self._words("memory_listed", levels=LEVELS, path=path)
        return Outcome("\n".join([title, self._entry(path, path), *self._listed(path, LEVELS)]))

    def create(self, path: str, file_text: str) -> Outcome:
        """Make a new file."""
        self._check(path)
        if path in self.texts or self._is_folder(path):
            raise self._error("memory_exists", path=path)
        self._check_folders(path)
        return Outcome(self._words("memory_created", path=path), {path: file_text})

    def str_replace(self, path: str, old_str: str, new_str: str) -> Outcome:
        """Replace a text that occurs once in a file."""
        text = self._file(path)
        places = list(_places(text, old_str))
        if not places:
            raise self._error("memory_not_found", old_str=old_str, path=path)
        if text.count(old_str) > 1:
            lines = ", ".join(str(text.count("\n", 0, place) + 1) for place in places)
            raise self._error("memory_not_unique", old_str=old_str, lines=lines)
        changed = text.replace(old_str, new_str)
        line = text.count("\n", 0, places[0])
        first = max(0, line - AROUND)
        snippet = _numbered(changed.split("\n")[first : line + AROUND + 1], first + 1)
        return Outcome(self._words("memory_replaced", lines=snippet), {path: changed})

    def insert(self, path: str, insert_line: int, insert_text: str) -> Outcome:
        """Insert text after a line of a file; line 0 is before the first."""
        lines = self._file(path).split("\n")
        if lines[-1] == "":
            lines.pop()
        if not 0 <= insert_line <= len(lines):
            raise self._error("memory_no_line", line=insert_line, last=len(lines))
        lines.insert(insert_line, insert_text.rstrip("\n"))
        text = "\n".join(lines)
        changed = text if text.endswith("\n") else f"{text}\n"
        return Outcome(self._words("memory_inserted", path=path), {path: changed})

    def delete(self, path: str) -> Outcome:
        """Delete a file, or a folder with everything below it."""
        self._check(path)
        if path == ROOT:
            raise self._error("memory_keeps_root", command="delete")
        gone = [path] if path in self.texts else list(self._below(path))
        if not gone:
            raise self._error("memory_no_path", path=path)
        return Outcome(self._words("memory_deleted", path=path), dict.fromkeys(gone))

    def rename(self, old_path: str, new_path: str) -> Outcome:
        """Move a file, or a folder with everything below it, to another path."""
        self._check(old_path)
        self._check(new_path)
        if old_path == ROOT:
            raise self._error("memory_keeps_root", command="rename")
        if new_path in self.texts or self._is_folder(new_path):
            raise self._error("memory_taken", path=new_path)
        moved = [old_path] if old_path in self.texts else list(self._below(old_path))
        if not moved:
            raise self._error("memory_no_path", path=old_path)
        if new_path.startswith(f"{old_path}/"):
            raise self._error("memory_below_itself", path=new_path, old_path=old_path)
        self._check_folders(new_path)
        changes: dict[str, str | None] = dict.fromkeys(moved)
        changes |= {new_path + path[len(old_path) :]: self.texts[path] for path in moved}
        return Outcome(self._words("memory_renamed", old_path=old_path, new_path=new_path), changes)

    # Look-ups.

    def _error(self, name: str, **values: object) -> FileError:
        return FileError(self._words(name, **values))

    def _check(self, path: str) -> None:
        """Raise a `FileError` unless a path is /memories, or names below it."""
        if path == ROOT:
            return
        if not path.startswith(f"{ROOT}/"):
            raise self._error("memory_outside", path=path)
        names = path.split("/")[2:]
        if "." in names or ".." in names:
            raise self._error("memory_escapes", path=path)
        if "" in names or "\0" in path:
            raise self._error("memory_invalid_path", path=path)

    def _file(self, path: str) -> str:
        self._check(path)
        if path not in self.texts:
            if self._is_folder(path):
                raise self._error("memory_no_file", path=path)
            raise self._error("memory_invalid_path", path=path)
        return self.texts[path]

    def _is_folder(self, path: str) -> bool:
        return path == ROOT or any(True for _ in self._below(path))

    def _below(self, folder: str) -> Iterator[str]:
        return (path for path in self.texts if path.startswith(f"{folder}/"))

    def _check_folders(self, path: str) -> None:
        """Raise a `FileError` if a folder of a path is a file."""
        while (path := path.rpartition("/")[0]) != ROOT:
            if path in self.texts:
                raise self._error("memory_no_folder", path=path)

    def _listed(self, folder: str, levels: int) -> Iterator[str]:
        """The entries of a folder and of its folders, in the order of their names, without hidden ones."""
        names = {path[len(folder) + 1 :].partition("/")[0] for path in self._below(folder)}
        for name in sorted(names):
            path = f"{folder}/{name}"
            if name.startswith("."):
                continue
            if path in self.texts:
                yield self._entry(path, path)
                continue
            yield self._entry(path, f"{path}/")
            if levels > 1:
                yield from self._listed(path, levels - 1)

    def _entry(self, path: str, shown: str) -> str:
        files = [path] if path in self.texts else self._below(path)
        tokens = sum(self._tokens(file, self.texts[file]) for file in files)
        return self._words("memory_entry", tokens=tokens, path=shown)


def _places(text: str, part: str) -> Iterator[int]:
    at = text.find(part)
    while at != -1:
        yield at
        at = text.find(part, at + 1)


def _numbered(lines: Sequence[str], first: int) -> str:
    return "\n".join(f"{number:>{NUMBER_WIDTH}}\t{line}" for number, line in enumerate(lines, start=first))
