"""Metadata of a submission, `submission.json`: who submits what, in the field names of tau2-bench's leaderboard.

`results` differs from tau2-bench's: it lists a result for every game and budget, because a run has both. `suite` is
added. The texts come from strangers, so they are limited in length, hold no control characters, and links begin with
http:// or https://.
"""

from __future__ import annotations

import datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, FailFast, Field, ValidationError

from smartplay_tools.errors import InvalidArgumentError, in_one_line

MOST_RESULTS = 10_000


def _printable(text: str) -> str:
    if any(not (char.isprintable() or char == "\n") for char in text):
        raise ValueError("control characters are not allowed")
    return text


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
Text = Annotated[str, Field(max_length=20_000), AfterValidator(_printable)]
Link = Annotated[str, Field(max_length=2_000, pattern=r"^https?://[^\s<>\"']+$"), AfterValidator(_printable)]
Day = Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", protected_namespaces=())


class ContactInfo(_Part):
    """A person to contact."""

    email: Name | None = None
    name: Name | None = None
    github: Name | None = None


class Reference(_Part):
    """A paper, a page or a repository about the submission."""

    title: Name
    url: Link
    type: Name | None = None


class Verification(_Part):
    """What the submitter says of prompts and episodes; the check finds both out by itself."""

    modified_prompts: bool = False
    omitted_questions: bool = False
    details: Text | None = None


class Methodology(_Part):
    """How the run was made."""

    evaluation_date: Day | None = None
    smartplay_tools_version: Name
    notes: Text | None = None
    verification: Verification = Verification()


class ModelRelease(_Part):
    """When the model was released."""

    release_date: Day | None = None
    announcement_url: Link | None = None


class CellResult(_Part):
    """The result of one game under one budget."""

    game: Name
    budget: dict[str, Any]
    """The budget as asked for; empty for the default budget."""
    episodes: int
    score: float
    normalized_score: float | None = None
    cost: float | None = None
    """US dollars for all episodes, by the prices of the manifest; None where they are not known."""


class Submission(_Part):
    """The metadata of a submission."""

    model_name: Name
    model_organization: Name
    submitting_organization: Name
    submission_date: Day
    submission_type: Literal["standard", "custom"]
    """"standard": a fixed suite, followed in everything; "custom": any other run that replays."""
    contact_info: ContactInfo = ContactInfo()
    is_new: bool = True
    trajectories_available: Literal[True] = True
    """Always true: the records are part of the bundle."""
    references: Annotated[list[Reference], FailFast(), Field(max_length=50)] = []
    suite: Name | None = None
    results: Annotated[list[CellResult], FailFast(), Field(max_length=MOST_RESULTS)] = []
    reasoning_effort: Name | None = None
    methodology: Methodology
    model_release: ModelRelease | None = None


def read_submission(facts: Any) -> Submission:
    """Return the metadata in JSON data; what is wrong with it is an `InvalidArgumentError` that names the field."""
    if not isinstance(facts, dict):
        raise InvalidArgumentError("submission.json is not a JSON object.")
    try:
        submission = Submission.model_validate(facts)
        datetime.date.fromisoformat(submission.submission_date)
    except ValidationError as error:
        raise InvalidArgumentError(f"submission.json, {in_one_line(error)}.") from None
    except ValueError:
        raise InvalidArgumentError("submission.json, submission_date: this day does not exist.") from None
    return submission
