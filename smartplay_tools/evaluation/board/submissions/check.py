"""The check of a submission: everything in a bundle that can be proved is proved again from its records.

Every record is replayed, every row computed anew, every prompt rebuilt to its sha256. The plan has to be complete and
its seeds have to follow from one; a suite that is named has to be covered; what the metadata says of results has to be
what the records say. A bundle that cannot even be read has a report like any other. What no check can prove stands in
every report.

The check of records under limits of time and memory: one that crosses them is given up, and the others are checked.

A record from a stranger can make a game slow or large.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from smartplay_tools.errors import InvalidArgumentError, file_named, in_one_line
from smartplay_tools.evaluation.board.submissions.bundle import (
    ROLLOUT_CARD,
    BundleError,
    Finding,
    Limits,
    error,
    remark,
    some,
    unpacked,
)
from smartplay_tools.evaluation.board.submissions.issued_seeds import IssuedSeed, read_seeds
from smartplay_tools.evaluation.board.submissions.metadata import Submission, read_submission
from smartplay_tools.evaluation.board.submissions.records import CheckedRecord, RecordJob, check_record
from smartplay_tools.evaluation.board.submissions.submitted_plan import (
    Allowed,
    SubmittedPlan,
    cell_results,
    check_plan,
    check_suite,
    read_plan,
)
from smartplay_tools.evaluation.processes import Lost, ProcessPool
from smartplay_tools.records.rows import Row, grouped
from smartplay_tools.types.arguments import object_in

__all__ = ["check_submission"]

J = TypeVar("J")
A = TypeVar("A")

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RUST_BACKTRACE": "0"}
"""Keeps numerical libraries from reserving memory for each processor, and pydantic's parser, which is written in Rust,
from printing a backtrace where it has run out of memory: that never ends."""


def run_limited(
    function: Callable[[J], A], jobs: Sequence[J], workers: int, limits: Limits
) -> Iterator[tuple[J, A | Lost]]:
    """Yield every job with its answer, in the order of completion; `function` is imported by the workers.

    With 0 workers the jobs are done here, without limits.
    """
    if workers == 0:
        yield from ((job, function(job)) for job in jobs)
        return
    waiting, deadline = list(reversed(jobs)), time.monotonic() + limits.total_seconds

    def take() -> J | None:
        return waiting.pop() if waiting and time.monotonic() < deadline else None

    begin = partial(_limit, limits.memory_bytes)
    with ProcessPool(partial(_guarded, function), workers, begin=begin, seconds=limits.seconds) as pool:
        yield from pool.run(take)
    late = Lost(f"all records together took more than {limits.total_seconds:g} seconds to check")
    yield from ((job, late) for job in reversed(waiting))


def _guarded(function: Callable[[J], A], job: J) -> A | Lost:
    try:
        return function(job)
    except MemoryError:
        return Lost("it needs more memory than is allowed to check")
    except Exception as error:
        return Lost(f"{type(error).__name__}: {in_one_line(error)[:200]}")


def _limit(memory: int) -> None:
    os.environ.update(ENVIRONMENT)
    if sys.platform == "win32":  # it has no such limit
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or hard > memory:
        resource.setrlimit(resource.RLIMIT_AS, (memory, hard))


NOT_PROVED = (
    "Who wrote the replies: that the named model did is the submitter's word.",
    "That the player knew nothing but its prompts, such as the game's program or an earlier play of the same seed.",
    "That this is the only play: several plays of one seed, of which the best was submitted, leave no trace, and "
    "neither do attempts that were left out.",
    "That a custom submission is all of its run: cells, and the last trials of a cell, can be left out.",
    "What a provider counted and charged: its usage, and the prices, are as the submitter recorded them.",
    "With which versions it was played: they are recorded ones, and the replay is played with those of the check.",
)
"""What the check cannot prove, whatever the bundle holds."""

MOST_OTHER_ROWS = 1_000
"""The most rows without a planned episode; after that many, no more results are read."""


@dataclass
class Checked:
    """The result of the check of a submission."""

    bundle: str
    """The name of the file."""
    sha256: str
    findings: list[Finding] = field(default_factory=list)
    submission: Submission | None = None
    """Its metadata; None if they cannot be read."""
    seed: int | None = None
    """The seed of the run."""
    issued: IssuedSeed | None = None
    """The board's line for the seed; None if it issued none, or was not asked."""
    rows: list[Row] = field(default_factory=list)
    """The rows of the records that replay, computed from them, in the order of the plan."""
    planned: int = 0
    replies: int = 0
    prompts: int = 0
    calls: int = 0
    attempts: Counter[str] = field(default_factory=Counter)
    """Attempts without a result, by why they have none."""

    @property
    def errors(self) -> list[Finding]:
        """What keeps the submission from being verified."""
        return [finding for finding in self.findings if finding.level == "error"]

    @property
    def verified(self) -> bool:
        """Whether everything that can be proved is."""
        return not self.errors

    @property
    def verdict(self) -> str:
        """Whether it is verified, in words."""
        count = len(self.errors)
        return f"NOT verified: {count:,} {'error' if count == 1 else 'errors'}" if count else "verified"


def check_submission(
    bundle: str | Path,
    *,
    seeds: str | Path | None = None,
    allowed: Allowed | None = None,
    workers: int = 1,
    limits: Limits | None = None,
) -> Checked:
    """Check a bundle and return what was found.

    Arguments:
        bundle: the zip file that `prepare_submission` wrote.
        seeds: the file of the seeds that the board has issued; the run's has to be among them.
        allowed: what a replay may use in addition to what is always safe.
        workers: processes that replay records; 0 replays them here, without limits of time and memory, which is for
            bundles of your own.
        limits: how much the bundle and its check may take.

    A file that is not there, or a file of seeds that cannot be read, is an `InvalidArgumentError`. Whatever is wrong
    with the bundle itself is a finding.
    """
    with checking(bundle, seeds=seeds, allowed=allowed, workers=workers, limits=limits) as (checked, _):
        return checked


@contextmanager
def checking(
    bundle: str | Path,
    *,
    seeds: str | Path | None = None,
    allowed: Allowed | None = None,
    workers: int = 1,
    limits: Limits | None = None,
) -> Iterator[tuple[Checked, Path | None]]:
    """Check a bundle like `check_submission`; yield what was found and the folder that it was unpacked to.

    The folder is None if the bundle cannot be unpacked. It is gone after the block.
    """
    path, limits = Path(bundle), limits or Limits()
    issued = None if seeds is None else read_seeds(seeds)
    with file_named(path), path.open("rb") as file:
        checked = Checked(path.name, hashlib.file_digest(file, "sha256").hexdigest())
    try:
        with unpacked(path, limits) as folder:
            for finding in _Check(checked, folder, issued, allowed or Allowed(), workers, limits).findings():
                checked.findings.append(finding)
            yield checked, folder
    except BundleError as refused:
        checked.findings.append(error("bundle", str(refused)))
        yield checked, None


def _number(text: str) -> float:
    """Read a number of a JSON file as a finite one."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is not a number of JSON")
    return number


def _key_of(line: bytes) -> str:
    """Return the key in a line of the results; empty if there is none."""
    key = (object_in(line) or {}).get("key")
    return key if isinstance(key, str) else ""


@dataclass
class _Check:
    """The check of an unpacked bundle, step by step."""

    checked: Checked
    folder: Path
    issued: Sequence[IssuedSeed] | None
    allowed: Allowed
    workers: int
    limits: Limits

    def findings(self) -> Iterator[Finding]:
        """Yield what is found; the other facts are written into the report."""
        yield from self._read_metadata()
        try:
            plan = read_plan(self._json("manifest.json"))
        except InvalidArgumentError as fault:
            yield error("plan", str(fault))
            return
        planned = check_plan(plan, self.allowed)
        yield from planned.findings
        self.checked.seed, self.checked.planned = plan.seed, len(plan.episodes)
        yield from self._check_seed(plan)
        submission = self.checked.submission
        if submission is not None:
            yield from check_suite(plan, submission.suite, submission.submission_type)
        yield from self._check_coverage(plan)
        rows: dict[str, bytes] = {}
        yield from self._check_rows(plan, rows)
        yield from self._check_records(plan, planned.replayable, rows)
        if submission is not None:
            yield from self._check_results(plan, submission)

    def _json(self, name: str) -> Any:
        try:
            return json.loads((self.folder / name).read_bytes(), parse_constant=_number, parse_float=_number)
        except (ValueError, RecursionError):
            raise InvalidArgumentError(f"{name} in the bundle is not JSON, or holds a number beyond all.") from None

    def _read_metadata(self) -> Iterator[Finding]:
        try:
            self.checked.submission = read_submission(self._json("submission.json"))
            if (self.folder / "environment.json").exists():
                self._json("environment.json")
            if (self.folder / ROLLOUT_CARD).exists():
                yield remark("metadata", f"{ROLLOUT_CARD}, of an older version, is not checked.")
        except InvalidArgumentError as fault:
            yield error("metadata", str(fault))

    def _check_seed(self, plan: SubmittedPlan) -> Iterator[Finding]:
        if self.issued is None:
            text = f"The run's seed is {plan.seed}; whether it was issued was not checked, so its worlds may be chosen."
            yield remark("seed", text)
            return
        submission = self.checked.submission
        ours = next((issued for issued in self.issued if issued.seed == plan.seed), None)
        if ours is None:
            yield error("seed", f"The run's seed, {plan.seed}, was not issued.")
        elif submission is not None and ours.name != submission.model_name:
            yield error("seed", f"The run's seed was issued to {ours.name!r}, not to {submission.model_name!r}.")
        elif submission is not None and ours.suite not in (None, submission.suite):
            yield error("seed", f"The run's seed was issued for the suite {ours.suite}.")
        else:
            self.checked.issued = ours

    def _check_coverage(self, plan: SubmittedPlan) -> Iterator[Finding]:
        """Compare the plan with the records."""
        planned = {episode.key for episode in plan.episodes}
        records = {path.stem for path in (self.folder / "episodes").iterdir()}
        if missing := sorted(planned - records):
            yield error("coverage", f"{len(missing)} planned episodes have no record: {some(missing)}.")
        if others := sorted(records - planned):
            yield error("coverage", f"{len(others)} records are of no planned episode: {some(others)}.")
        tried = {path.name.partition(".")[0] for path in (self.folder / "attempts").iterdir()}
        if others := sorted(tried - planned):
            yield error("coverage", f"{len(others)} attempts are at no planned episode: {some(others)}.")

    def _check_rows(self, plan: SubmittedPlan, rows: dict[str, bytes]) -> Iterator[Finding]:
        """Compare the plan with the rows; `rows` gets the lines of the planned episodes by their keys.

        There may be millions of other lines, so few of them are read.
        """
        planned = {episode.key for episode in plan.episodes}
        doubled, others = set(), []
        with (self.folder / "results.jsonl").open("rb") as lines:
            for number, line in enumerate(lines, start=1):
                key = _key_of(line)
                if key in rows:
                    doubled.add(key)
                elif key in planned:
                    rows[key] = line
                else:
                    others.append(f"line {number}")
                if len(others) == MOST_OTHER_ROWS:
                    break
        if doubled:
            yield error("coverage", f"{len(doubled)} episodes have several rows: {some(sorted(doubled))}.")
        if others:
            count = f"{len(others)} rows" if len(others) < MOST_OTHER_ROWS else f"{MOST_OTHER_ROWS} rows or more"
            yield error("coverage", f"{count} of results.jsonl are of no planned episode: {some(others)}.")

    def _check_records(self, plan: SubmittedPlan, replayable: set[int], rows: Mapping[str, bytes]) -> Iterator[Finding]:
        files = sorted((self.folder / "attempts").iterdir(), key=lambda path: int(path.name.split(".")[1]))
        attempts = grouped(files, lambda path: path.name.partition(".")[0])
        submission = self.checked.submission
        jobs = []
        for episode in plan.episodes:
            record = self.folder / "episodes" / f"{episode.key}.jsonl"
            if episode.cell in replayable and record.exists():
                config = plan.config(episode)
                jobs.append(
                    RecordJob(
                        record,
                        config,
                        episode.trial,
                        rows.get(episode.key),
                        plan.prices.get(config.player or ""),
                        tuple(attempts.get(episode.key, ())),
                        self._before(plan, episode.key),
                        self.allowed.tokenizer,
                        standard=submission is not None and submission.submission_type == "standard",
                    )
                )
        answers = {job.record: answer for job, answer in run_limited(check_record, jobs, self.workers, self.limits)}
        for job in jobs:
            yield from self._add(job, answers[job.record])
        yield from _about_records([answer for answer in answers.values() if isinstance(answer, CheckedRecord)])

    def _before(self, plan: SubmittedPlan, key: str) -> Path | None:
        before = plan.predecessors.get(key)
        return None if before is None else self.folder / "episodes" / f"{before}.jsonl"

    def _add(self, job: RecordJob, answer: CheckedRecord | Lost) -> Iterator[Finding]:
        checked = self.checked
        if isinstance(answer, Lost):
            yield error("record", f"The record was not checked: {answer.why}.", job.config.key)
            return
        yield from answer.findings
        if answer.row is not None:  # with the cell's options, which the rows of its episodes share
            checked.rows.append({**answer.row, "player_options": job.config.player_options})
        checked.replies += answer.replies
        checked.prompts += answer.prompts
        checked.calls += answer.calls
        checked.attempts.update(answer.attempts)

    def _check_results(self, plan: SubmittedPlan, submission: Submission) -> Iterator[Finding]:
        """Compare the results in the metadata with those of the records."""
        modified = any(finding.kind == "prompts" for finding in self.checked.findings)
        if modified and not submission.methodology.verification.modified_prompts:
            yield error("metadata", "submission.json says that no prompts were modified, but the records show it.")
        if len(self.checked.rows) < len(plan.episodes):
            return  # there is an error for every episode that is not here
        if submission.results != cell_results(self.checked.rows):
            yield error("results", "The results in submission.json are not those of the records.")


def _about_records(answers: Sequence[CheckedRecord]) -> Iterator[Finding]:
    """Yield remarks on the versions of all records, and on counts of tokens that they do not hold."""
    versions = {answer.versions.get("smartplay-tools", "unknown") for answer in answers}
    here = metadata.version("smartplay-tools")
    if versions - {here}:
        yield remark("record", f"Played with smartplay-tools {some(sorted(versions))}, and replayed with {here}.")
    if len(versions) > 1:
        yield remark("record", "The records were made with several versions.")
    if without := sum(not answer.provider for answer in answers):
        text = f"{without} of {len(answers)} records hold no count of tokens by a provider; ours is exact for both."
        yield remark("record", text)
