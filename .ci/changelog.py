"""Say what keeps the version of `pyproject.toml` from being released; one sentence each, and exit code 1 if any.

    python .ci/changelog.py

A release is dated by hand, in two files, so that the date is reviewed like everything else: the changelog's section has
the version and the date as its heading, and CITATION.cff has the same two.
"""

from __future__ import annotations

import datetime
import re
import sys
import tomllib
from pathlib import Path

HEADING = re.compile(r"^## (?P<title>[^\s:]+)(?:: .*?)?(?: - (?P<date>\S+))?$", flags=re.MULTILINE)
"""A version, perhaps what it is after a colon, and its date."""
FIELD = re.compile(r"^(?P<name>version|date-released): *[\"']?(?P<value>[^\"'\s]+)[\"']?\s*$", flags=re.MULTILINE)


def problems(root: Path) -> list[str]:
    """Return what is in the way of a release; empty if nothing is."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = project["version"]
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = {match["title"]: match["date"] for match in HEADING.finditer(changelog)}
    date = sections.get(version)
    remedies = []
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


def _is_date(text: str) -> bool:
    try:
        return datetime.date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


if __name__ == "__main__":
    in_the_way = problems(Path(__file__).parents[1])
    print("\n".join(in_the_way), end="\n" if in_the_way else "", file=sys.stderr)
    sys.exit(1 if in_the_way else 0)
