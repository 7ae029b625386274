"""What `memory` has to answer, by brute force: written from `docs/strategies.md`, with nothing of the package."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

ROOT = "/memories"
WANTS = {
    "view": ({"path": str}, {"view_range": list}),
    "create": ({"path": str, "file_text": str}, {}),
    "str_replace": ({"path": str, "old_str": str, "new_str": str}, {}),
    "insert": ({"path": str, "insert_line": int, "insert_text": str}, {}),
    "delete": ({"path": str}, {}),
    "rename": ({"old_path": str, "new_path": str}, {}),
}
Store = dict[str, str]


class CommandError(Exception):
    """Why a command is not carried out."""


def is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def is_malformed(sent: dict[str, Any]) -> bool:
    given = {name: value for name, value in sent.items() if value is not None}
    command = given.pop("command", None)
    if not isinstance(command, str) or command not in WANTS:
        return True
    needed, free = WANTS[command]
    if needed.keys() - given.keys() or given.keys() - needed.keys() - free.keys():
        return True
    kinds = {**needed, **free}
    if not all(isinstance(value, kinds[name]) for name, value in given.items()):
        return True
    numbers = [*given.get("view_range", ()), *([given["insert_line"]] if "insert_line" in given else [])]
    return not all(map(is_whole, numbers)) or len(given.get("view_range", (1, 1))) != 2


class MemoryJudge:
    """The files of an episode, after each of its calls in turn."""

    def __init__(self, cap: int, n: Callable[[str], int]) -> None:
        self.cap, self.n = cap, n
        self.files: Store = {}

    def size(self, files: Store) -> int:
        return sum(self.n(path) + self.n(text) for path, text in files.items())

    def answer(self, sent: dict[str, Any]) -> tuple[str, str | None]:
        """The answer to a call, and the kind of mistake that it is."""
        if is_malformed(sent):
            return "", "malformed"
        given = {name: value for name, value in sent.items() if value is not None}
        after = dict(self.files)
        try:
            text = getattr(self, given.pop("command"))(after, **given)
        except CommandError as problem:
            return f"Error: {problem}", "file"
        size = self.size(after)
        if size > self.cap and size > self.size(self.files):
            return f"Error: The files would have {size} tokens, more than {self.cap}. Nothing was changed.", "memory"
        self.files = after
        return text, None

    def valid(self, path: str) -> None:
        if path == ROOT:
            return
        if path[: len(ROOT) + 1] != ROOT + "/":
            raise CommandError(f"Path must start with /memories, got: {path}")
        names = path[len(ROOT) + 1 :].split("/")
        if any(name in (".", "..") for name in names):
            raise CommandError(f"Path {path} would escape /memories directory")
        if "" in names or chr(0) in path:
            raise CommandError(f"The path {path} does not exist. Please provide a valid path.")

    def folders(self, files: Store) -> set[str]:
        every = {ROOT}
        for path in files:
            parts = path.split("/")
            every |= {"/".join(parts[:length]) for length in range(2, len(parts))}
        return every

    def room_for(self, files: Store, path: str) -> None:
        parts = path.split("/")
        for length in range(len(parts) - 1, 2, -1):
            if (above := "/".join(parts[:length])) in files:
                raise CommandError(f"The path {above} is not a directory.")

    def lines(self, texts: list[str], first: int) -> str:
        return "\n".join(str(first + at).rjust(6) + "\t" + text for at, text in enumerate(texts))

    def view(self, files: Store, path: str, view_range: list[int] | None = None) -> str:
        self.valid(path)
        if path in files:
            texts = files[path].split("\n")
            first, last = view_range or [1, -1]
            last = len(texts) if last == -1 else last
            shown = [text for number, text in enumerate(texts, 1) if first <= number <= last]
            return f"Here's the content of {path} with line numbers:\n" + self.lines(shown, max(first, 1))
        if path not in self.folders(files):
            raise CommandError(f"The path {path} does not exist. Please provide a valid path.")
        shown = [f"Here're the files and directories up to 2 levels deep in {path}, excluding hidden items:"]
        shown.append(f"{self.size({p: t for p, t in files.items() if p.startswith(path + '/')})} tokens\t{path}")
        entries = {*files, *self.folders(files)}
        below = [entry[len(path) + 1 :].split("/") for entry in entries if entry.startswith(path + "/")]
        for names in sorted(below):
            if len(names) > 2 or any(name.startswith(".") for name in names):
                continue
            whole = path + "/" + "/".join(names)
            inside = {p: t for p, t in files.items() if p == whole or p.startswith(whole + "/")}
            shown.append(f"{self.size(inside)} tokens\t{whole}{'' if whole in files else '/'}")
        return "\n".join(shown)

    def create(self, files: Store, path: str, file_text: str) -> str:
        self.valid(path)
        if path in files or path in self.folders(files):
            raise CommandError(f"File {path} already exists")
        self.room_for(files, path)
        files[path] = file_text
        return f"File created successfully at: {path}"

    def existing(self, files: Store, path: str) -> str:
        self.valid(path)
        if path in self.folders(files):
            raise CommandError(f"The path {path} is not a file.")
        if path not in files:
            raise CommandError(f"The path {path} does not exist. Please provide a valid path.")
        return files[path]

    def str_replace(self, files: Store, path: str, old_str: str, new_str: str) -> str:
        text = self.existing(files, path)
        if old_str not in text:
            raise CommandError(f"No replacement was performed, old_str `{old_str}` did not appear verbatim in {path}.")
        if text.count(old_str) > 1:
            places = [at for at in range(len(text) + 1) if text.startswith(old_str, at)]
            lines = ", ".join(str(text[:at].count("\n") + 1) for at in places)
            raise CommandError(
                f"No replacement was performed. Multiple occurrences of old_str `{old_str}` in lines: {lines}. "
                "Please ensure it is unique"
            )
        before, after = text.split(old_str, 1) if old_str else ("", text)
        files[path] = before + new_str + after
        changed, line = files[path].split("\n"), before.count("\n")
        shown = [(number, one) for number, one in enumerate(changed) if line - 2 <= number <= line + 2]
        title = "The memory file has been edited. Here is the snippet showing the change (with line numbers):\n"
        return title + self.lines([one for _, one in shown], (shown[0][0] if shown else line) + 1)

    def insert(self, files: Store, path: str, insert_line: int, insert_text: str) -> str:
        text = self.existing(files, path)
        lines = text.split("\n")
        lines = lines[:-1] if lines[-1] == "" else lines
        if insert_line < 0 or insert_line > len(lines):
            wanted = f"It should be within the range [0, {len(lines)}]."
            raise CommandError(f"Invalid `insert_line` parameter: {insert_line}. {wanted}")
        whole = "\n".join([*lines[:insert_line], insert_text.rstrip("\n"), *lines[insert_line:]])
        files[path] = whole if whole.endswith("\n") else whole + "\n"
        return f"The file {path} has been edited."

    def delete(self, files: Store, path: str) -> str:
        self.valid(path)
        if path == ROOT:
            raise CommandError("Cannot delete the /memories directory itself")
        gone = [each for each in files if each == path or each.startswith(path + "/")]
        if not gone:
            raise CommandError(f"The path {path} does not exist")
        for each in gone:
            del files[each]
        return f"Successfully deleted {path}"

    def rename(self, files: Store, old_path: str, new_path: str) -> str:
        self.valid(old_path)
        self.valid(new_path)
        if old_path == ROOT:
            raise CommandError("Cannot rename the /memories directory itself")
        if new_path in files or new_path in self.folders(files):
            raise CommandError(f"The destination {new_path} already exists")
        moved = [each for each in files if each == old_path or each.startswith(old_path + "/")]
        if not moved:
            raise CommandError(f"The path {old_path} does not exist")
        if new_path.startswith(old_path + "/"):
            raise CommandError(f"The destination {new_path} is below {old_path}")
        self.room_for(files, new_path)
        for each in moved:
            files[new_path + each[len(old_path) :]] = files.pop(each)
        return f"Successfully renamed {old_path} to {new_path}"
