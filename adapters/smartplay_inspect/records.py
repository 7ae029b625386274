"""The records of a log's episodes as files, which replay."""

from __future__ import annotations

from pathlib import Path

from inspect_ai.log import EvalLog, EvalSample, read_eval_log

from smartplay_inspect.solver import Played
from smartplay_tools.errors import TranscriptError
from smartplay_tools.transcript import write_records


def save_records(log: str | Path | EvalLog, folder: str | Path) -> list[Path]:
    """Write the record of every episode in a log to a file of its own, and return the files.

    A file is named by its sample and epoch. An existing file, or a log without records of this package's, is a
    `TranscriptError`.
    """
    whole = log if isinstance(log, EvalLog) else read_eval_log(str(log), resolve_attachments=True)
    texts = {f"{sample.id}.{sample.epoch}.jsonl": _record(sample) for sample in whole.samples or ()}
    if not any(texts.values()):
        raise TranscriptError("The log holds no record of an episode; it has to be a log of smartplay_inspect's tasks.")
    return write_records(texts, folder)


def _record(sample: EvalSample) -> str:
    record: str = sample.store_as(Played).record
    return record
