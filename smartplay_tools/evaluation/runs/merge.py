"""Merging the shards of a run, which were played on independent machines.

Every shard's manifest contains the whole plan, which shows that the parts belong together. A merged folder is a run
like any other: the same command, without the shard, plays the episodes that no part has played.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.records.damage import damage_left_out
from smartplay_tools.records.record import Record
from smartplay_tools.records.resumption import chain_fault
from smartplay_tools.records.rows import Row

SHARED = ("seed", "cells", "episodes")
"""The fields that are equal in the manifests of a run's parts."""


def merge(parts: Sequence[str | Path], out: str | Path) -> RunFolder:
    """Merge the parts of a run into a new folder, and return it.

    Parts of different runs or with different prices, with different results of the same episode, or with a part of a
    chain of trials only, raise an `InvalidArgumentError`.
    """
    folders, whole = [RunFolder(part) for part in parts], RunWriter(out)
    if not folders:
        raise InvalidArgumentError("Name at least one folder to merge.")
    if (whole.path / "manifest.json").exists():
        raise InvalidArgumentError(f"{whole.path} already contains a run; name a new folder.")
    if len({folder.path.resolve() for folder in folders}) < len(folders):
        raise InvalidArgumentError("The same folder is named twice; name every part once.")
    manifests = [folder.manifest() for folder in folders]
    for folder, manifest in zip(folders, manifests, strict=True):
        if any(getattr(manifest, name) != getattr(manifests[0], name) for name in SHARED):
            raise InvalidArgumentError(f"{folder.path} and {folders[0].path} are not parts of the same run.")
        if manifest.prices != manifests[0].prices:
            raise InvalidArgumentError(
                f"{folder.path} and {folders[0].path} have costs at different prices; play one of them again with "
                "the prices of the other, which keeps its episodes and computes their costs anew."
            )
    rows = _all_rows(folders)
    for folder in folders:
        _check_chains(folder, manifests[0].predecessors)
    with whole.writing():
        whole.write_manifest(manifests[0].model_copy(update={"shard": None}))
        for folder in folders:
            _copy_records(folder, whole)
            for timing in folder.timings():
                whole.append_timing(timing)
        whole.write_rows(rows.values())
        whole.write_rows(whole.rows())  # reading sorts them as planned
    return whole


def _all_rows(folders: Sequence[RunFolder]) -> dict[str, Row]:
    rows: dict[str, Row] = {}
    for folder in folders:
        for row in folder.rows():
            if rows.setdefault(row["key"], row) != row:
                raise InvalidArgumentError(
                    f"Episode {row['key']} was played twice with different results, once in {folder.path}; "
                    "leave one of the folders out."
                )
    return rows


def _check_chains(folder: RunFolder, predecessors: Mapping[str, str]) -> None:
    """Refuse a part in which a trial did not begin with what the trial before it in its chain left."""
    for key in sorted(folder.finished() & predecessors.keys()):
        record = Record.head(folder.transcript(key))
        if fault := chain_fault(record, folder.transcript(predecessors[key])):
            raise InvalidArgumentError(f"Episode {key} of {folder.path} does not follow in its chain. {fault}")


def _copy_records(folder: RunFolder, whole: RunWriter) -> None:
    for record in (*map(folder.transcript, sorted(folder.finished())), *folder.attempts()):
        with damage_left_out(record):
            if record.parent.name == "attempts":
                whole.add_attempt(record)
            else:
                shutil.copyfile(record, whole.transcript(record.stem))
