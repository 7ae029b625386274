"""Seeds that a board issues: a run that is played under one has worlds that its author did not choose.

The board keeps the seeds in a file, a line of JSON for each. Every seed of the run follows from the one that was
issued. It cannot be ruled out that a seed was played several times and the best run submitted.
"""

from __future__ import annotations

import json
import secrets
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock
from pydantic import BaseModel, ConfigDict, ValidationError

from smartplay_tools.errors import InvalidArgumentError, file_named
from smartplay_tools.evaluation.board.submissions.metadata import Name

LARGEST = 2**31


class IssuedSeed(BaseModel):
    """A seed, for whom it was issued, and when (UTC)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int
    name: Name
    suite: str | None = None
    issued: str


def issue_seed(path: str | Path, name: str, *, suite: str | None = None) -> IssuedSeed:
    """Draw an unpredictable seed, append it to the board's file, and return it.

    `name` is the `model_name` that the submission will have.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{path}.lock"):
            earlier = {issued.seed for issued in read_seeds(path)} if path.exists() else set()
            seed = next(drawn for drawn in iter(lambda: secrets.randbelow(LARGEST), -1) if drawn not in earlier)
            now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
            issued = IssuedSeed(seed=seed, name=name, suite=suite, issued=now)
            with path.open("a", encoding="ascii", newline="\n") as file:
                file.write(json.dumps(issued.model_dump()) + "\n")
    except ValidationError as error:
        raise InvalidArgumentError(
            f"{name!r} cannot be the name of a submission: {error.errors()[0]['msg']}."
        ) from None
    except OSError as error:
        raise InvalidArgumentError(f"{path} cannot be written: {error.strerror}.") from None
    return issued


def read_seeds(path: str | Path) -> list[IssuedSeed]:
    """Return the seeds of a board's file; any other line is an `InvalidArgumentError`."""
    with file_named(f"The seeds in {path}"):
        lines = Path(path).read_text(encoding="utf-8-sig", errors="replace").splitlines()
    seeds = []
    for number, line in enumerate(lines, start=1):
        try:
            seeds.append(IssuedSeed.model_validate_json(line))
        except ValidationError:
            raise InvalidArgumentError(
                f"Line {number} of {path} is not an issued seed; submit seed writes them."
            ) from None
    return seeds
