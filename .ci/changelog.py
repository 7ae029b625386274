"""Say what keeps the version of `pyproject.toml` from being released; one sentence each, and exit code 1 if any.

    python .ci/changelog.py            # what keeps the version from being released
    python .ci/changelog.py collect    # put the fragments into CHANGELOG.md, under "Unreleased"

A change that users can see brings a fragment: a file `changelog.d/NAME.KIND.md` with one or more items, so that changes
that are made at the same time do not meet in one file. A script of our own does this because other tools name fragments
by the numbers of an issue tracker and render them by templates.

A release is dated by hand, in two files, so that the date is reviewed like everything else: the changelog's section has
the version and the date as its heading, and CITATION.cff has the same two.
"""

from __future__ import annotations

import datetime
import re
import sys
import tomllib
from pathlib import Path

HEADING = re.compile(r"^## (?P<title>.*?)(?: - (?P<date>\S+))?$", flags=re.MULTILINE)
KINDS = ("added", "changed", "deprecated", "removed", "fixed", "security")
"""What a fragment can be, in the order of the changelog's headings."""
FIELD = re.compile(r"^(?P<name>version|date-released): *[\"']?(?P<value>[^\"'\s]+)[\"']?\s*$", flags=re.MULTILINE)


def problems(root: Path) -> list[str]:
    """Return what is in the way of a release; empty if nothing is."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = project["version"]
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = {match["title"]: match["date"] for match in HEADING.finditer(changelog)}
    date = sections.get(version)
    remedies = []
    if any(fragments(root).values()):
        remedies.append("changelog.d has fragments: run `make changelog`, and read what it wrote.")
    if "Unreleased" in sections:
        today = datetime.datetime.now(tz=datetime.UTC).date()
        remedies.append(f"CHANGELOG.md has a section without a date: make '## Unreleased' '## {version} - {today}'.")
    elif version not in sections:
        remedies.append(
            f"CHANGELOG.md has no section for {version}: write one, with the heading '## {version} - DATE'."
        )
    elif date is None or not _is_date(date):
        remedies.append(f"CHANGELOG.md does not say when {version} is released: make it '## {version} - YYYY-MM-DD'.")
    elif next(iter(sections)) != version:
        remedies.append(f"CHANGELOG.md has {next(iter(sections))} before {version}: the newest section comes first.")
    cited = dict(FIELD.findall((root / "CITATION.cff").read_text(encoding="utf-8")))
    if cited.get("version") != version:
        remedies.append(f"CITATION.cff is of version {cited.get('version')}: make it 'version: {version}'.")
    if cited.get("date-released") != date or date is None:
        remedies.append(f"CITATION.cff needs the changelog's date: write 'date-released: {date or 'YYYY-MM-DD'}'.")
    return remedies


def fragments(root: Path) -> dict[str, list[Path]]:
    """Return the fragments by kind; one that cannot be collected is a `ValueError`."""
    by_kind: dict[str, list[Path]] = {kind: [] for kind in KINDS}
    for path in sorted((root / "changelog.d").glob("*.md")):
        kind = path.name.split(".")[1]
        if path.name.count(".") != 2 or kind not in KINDS:
            raise ValueError(f"changelog.d/{path.name}: name it NAME.KIND.md; KIND is one of {', '.join(KINDS)}.")
        if not path.read_text(encoding="utf-8").startswith("- "):
            raise ValueError(f"changelog.d/{path.name}: begin each item with '- '.")
        by_kind[kind].append(path)
    return by_kind


def collect(root: Path) -> None:
    """Move the fragments into the changelog's section "Unreleased", which is made if there is none."""
    changelog = root / "CHANGELOG.md"
    text = changelog.read_text(encoding="utf-8")
    if "\n## Unreleased\n" not in text:
        text = text.replace("\n## ", "\n## Unreleased\n\n## ", 1)
    before, heading, rest = text.partition("\n## Unreleased\n")
    section, following, older = rest.partition("\n## ")
    items = {
        title.lower(): body.strip()
        for title, body in re.findall(r"^### (\w+)\n(.*?)(?=^### |\Z)", section, re.MULTILINE | re.DOTALL)
    }
    by_kind = fragments(root)
    for kind, paths in by_kind.items():
        lines = [items[kind]] if kind in items else []
        lines += [path.read_text(encoding="utf-8").strip() for path in paths]
        if lines:
            items[kind] = "\n".join(lines)
    section = "\n".join(f"\n### {kind.title()}\n\n{items[kind]}" for kind in KINDS if kind in items)
    changelog.write_text(f"{before}{heading}{section}\n{following}{older}", encoding="utf-8")
    for path in (path for paths in by_kind.values() for path in paths):
        path.unlink()


def _is_date(text: str) -> bool:
    try:
        return datetime.date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


if __name__ == "__main__":
    if sys.argv[1:] == ["collect"]:
        collect(Path(__file__).parents[1])
        sys.exit()
    in_the_way = problems(Path(__file__).parents[1])
    print("\n".join(in_the_way), end="\n" if in_the_way else "", file=sys.stderr)
    sys.exit(1 if in_the_way else 0)
