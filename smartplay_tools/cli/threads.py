"""What `results`, `cost` and `replay` do with the records of context managers, which play no game."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from smartplay_tools.cli.formats import print_tables
from smartplay_tools.cli.options import Format
from smartplay_tools.cli.show import print_json
from smartplay_tools.errors import TranscriptError
from smartplay_tools.evaluation.costs.tariffs import Tariff
from smartplay_tools.evaluation.run_folder.folder import read_each
from smartplay_tools.manager.record import read_thread
from smartplay_tools.records.threads import thread_files, thread_row

__all__ = ["print_thread_costs", "print_threads", "replayed_threads", "thread_files"]


def print_threads(files: Sequence[Path], form: Format) -> None:
    """Print a row for each thread."""
    from smartplay_tools.evaluation.analysis.threads import threads_tables

    rows = [thread_row(thread) for thread in read_each(files, read_thread)]
    print_tables(form, threads_tables(rows), rows, rows)


def print_thread_costs(files: Sequence[Path], tariffs: Sequence[Tariff], form: Format) -> None:
    """Print what the prompts of each thread would have cost."""
    from smartplay_tools.evaluation.analysis.threads import thread_costs, thread_costs_table

    rows = [*thread_costs(read_each(files, read_thread), tariffs)]
    print_tables(form, [thread_costs_table(rows, tariffs)], rows, rows)


def replayed_threads(path: Path, files: Sequence[Path], *, as_json: bool) -> tuple[list[str], list[str]]:
    """Rebuild every prompt and compare its digest; return what is identical and what differs, in sentences."""
    count, differences, found = 0, [], []
    for file in files:
        try:
            thread = read_thread(file)
            faults = [f"prompt {number} of {file} is not what its digest says" for number in thread.differing]
            count += len(thread.prompts)
        except TranscriptError as error:
            if len(files) == 1:
                raise
            faults = [str(error)]
        differences += faults
        found.append({"thread": file.stem, "identical": not faults, "differences": faults})
    if as_json:
        print_json(found)
    of = f" of {len(files)} threads" if len(files) > 1 else ""
    return ([] if differences else [f"{count} prompts{of} of {path}"]), differences
