"""The records of an evaluation's episodes as files, which replay."""

from __future__ import annotations

import json
from pathlib import Path

from smartplay_tools.errors import TranscriptError
from smartplay_tools.transcript import write_records
from smartplay_verifiers.tasks import INFO


def save_records(traces: str | Path, folder: str | Path) -> list[Path]:
    """Write the record of every rollout in verifiers' `traces.jsonl` to a file of its own, and return the files.

    A file is named by its task and the number of its rollout. An existing file, or traces without records, is a
    `TranscriptError`.
    """
    texts: dict[str, str] = {}
    for line in Path(traces).read_text(encoding="utf-8").splitlines():
        for trace in json.loads(line)["traces"]:
            if INFO in trace["info"]:
                name = trace["task"]["data"]["name"]
                rollout = sum(other.startswith(f"{name}.") for other in texts)
                record = trace["info"][INFO]["record"]
                if not isinstance(record, str):  # traces of earlier versions have the events
                    record = "".join(json.dumps(event) + "\n" for event in record)
                texts[f"{name}.{rollout}.jsonl"] = record
    if not texts:
        raise TranscriptError(f"{traces} holds no record of an episode; it has to be of smartplay_verifiers' tasks.")
    return write_records(texts, folder)
