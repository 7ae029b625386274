"""Submissions: a run in one file that proves itself, and the check that replays it.

metadata           who submits what: `submission.json`
bundle             the zip file, written deterministically and unpacked without trust
prepare            a bundle from a run
submitted_plan     cells, keys, seeds and means of a submitted run, and what of it is safe to replay
records            the check of one record
check              everything together, in processes under limits of time and memory
check_report       what was found, as text and JSON
issued_seeds       seeds that a board issues

Nothing here imports what plays a run.
"""

from smartplay_tools.evaluation.board.submissions.bundle import Limits
from smartplay_tools.evaluation.board.submissions.check import NOT_PROVED, Checked, check_submission
from smartplay_tools.evaluation.board.submissions.check_report import report_json, report_text
from smartplay_tools.evaluation.board.submissions.issued_seeds import issue_seed, read_seeds
from smartplay_tools.evaluation.board.submissions.metadata import Submission
from smartplay_tools.evaluation.board.submissions.prepare import prepare_submission
from smartplay_tools.evaluation.board.submissions.submitted_plan import Allowed

__all__ = [
    "NOT_PROVED",
    "Allowed",
    "Checked",
    "Limits",
    "Submission",
    "check_submission",
    "issue_seed",
    "prepare_submission",
    "read_seeds",
    "report_json",
    "report_text",
]
