"""The report of a check, as text for people and as JSON for a board."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from importlib import metadata
from typing import Any

from smartplay_tools.evaluation.board.submissions.bundle import Finding, printable
from smartplay_tools.evaluation.board.submissions.check import NOT_PROVED, Checked
from smartplay_tools.evaluation.board.submissions.submitted_plan import cell_results

__all__ = ["report_text"]

FORMAT = 1
"""The version of the report in JSON."""

SHOWN = 20
"""Findings of each level in the text; the JSON holds all."""


def report_json(checked: Checked) -> dict[str, Any]:
    """Return the report as plain data."""
    submission = checked.submission
    return {
        "format": FORMAT,
        "bundle": checked.bundle,
        "sha256": checked.sha256,
        "verified": checked.verified,
        "smartplay_tools_version": metadata.version("smartplay-tools"),
        "submission": None if submission is None else submission.model_dump(mode="json"),
        "seed": checked.seed,
        "issued": None if checked.issued is None else checked.issued.model_dump(),
        "episodes": {"planned": checked.planned, "verified": len(checked.rows)},
        "replayed": {"replies": checked.replies, "prompts": checked.prompts, "calls": checked.calls},
        "attempts_without_result": dict(sorted(checked.attempts.items())),
        "results": [result.model_dump(mode="json") for result in cell_results(checked.rows)],
        "findings": [asdict(finding) for finding in checked.findings],
        "not_proved": list(NOT_PROVED),
    }


def report_text(checked: Checked) -> str:
    """Return the report as text; nothing from the bundle reaches the terminal as a control character."""
    return "\n".join(_lines(checked)) + "\n"


def _lines(checked: Checked) -> Iterator[str]:
    yield f"{printable(checked.bundle)}: {checked.verdict}"
    submission = checked.submission
    if submission is not None:
        suite = f", suite {printable(submission.suite)}" if submission.suite else ""
        yield (
            f"{printable(submission.model_name)} ({printable(submission.model_organization)}), submitted by "
            f"{printable(submission.submitting_organization)}: {submission.submission_type}{suite}"
        )
    yield (
        f"{len(checked.rows)} of {checked.planned} episodes verified by replay: {checked.replies:,} replies, "
        f"{checked.calls:,} calls, {checked.prompts:,} prompts rebuilt to their sha256"
    )
    if checked.issued is not None:
        yield f"Its seed was issued for it at {printable(checked.issued.issued)}."
    if checked.attempts:
        counted = ", ".join(f"{count} {reason}" for reason, count in sorted(checked.attempts.items()))
        yield f"Attempts without a result: {counted}."
    yield from _section("Errors", checked.errors)
    yield from _section("Remarks", [finding for finding in checked.findings if finding.level == "remark"])
    yield ""
    yield "What no check can prove:"
    yield from (f"  {line}" for line in NOT_PROVED)


def _section(title: str, findings: list[Finding]) -> Iterator[str]:
    if not findings:
        return
    yield ""
    yield f"{title}:"
    for finding in findings[:SHOWN]:
        where = f"{finding.key}: " if finding.key else ""
        yield f"  {finding.kind}: {where}{finding.text}"
    if len(findings) > SHOWN:
        yield f"  and {len(findings) - SHOWN} more; --json lists all."
