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
