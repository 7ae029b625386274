"""Published: the results of one model in the formats of those who collect results.

    eee         a file of Every Eval Ever (EvalEval), version 0.3.0 of its schema, at the path its datastore asks for
    hf-results  `.eval_results/*.yaml` of a model's repository on the Hugging Face Hub, a file for each condition

Both hold a mean for every game, with its interval as everywhere else, and the conditions under which it was played.
`Publication` holds what records cannot tell: whose model it is, and who evaluated it.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
import uuid
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis import pairs
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell, conditions
from smartplay_tools.evaluation.analysis.intervals import CONFIDENCE, MeanEstimate, mean_estimates
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row, row_of
from smartplay_tools.transcript.hashing import canonical_json

EEE_SCHEMA = "0.3.0"
LIBRARY = "smartplay-tools"
TOOLS = [{"name": name} for name in ("observe", "act", "read_manual")]
UNBOUNDED = {"min_score": "-Infinity", "max_score": "Infinity"}


class Publication(BaseModel):
    """The facts of a published result that no record holds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    model: str | None = Field(default=None, pattern=r"^[\w.-]+(/[\w.-]+)+$")
    """The evaluated model as DEVELOPER/NAME."""
    organization: str | None = None
    """Who evaluated it."""
    relationship: Literal["first_party", "third_party", "collaborative", "other"] = "other"
    """What the evaluator is to the model's developer."""
    dataset: str | None = Field(default=None, pattern=r"^[\w.-]+/[\w.-]+$")
    """The benchmark's dataset on the Hugging Face Hub, which has the leaderboard."""

    def needs(self, *names: str) -> None:
        """Raise if a required option is missing."""
        if missing := [name for name in names if getattr(self, name) is None]:
            raise InvalidArgumentError(f"This format says whose results these are; give --{' and --'.join(missing)}.")


def write_eee(records: Iterable[Record], folder: Path, about: Publication) -> dict[str, int]:
    """Write a file of Every Eval Ever; its name follows from what is in it."""
    about.needs("model", "organization")
    rows = _rows(records)
    results = [_eee_result(cell, members, estimate) for cell, members, estimate in _cells(rows)]
    evaluation = {
        "schema_version": EEE_SCHEMA,
        "source_metadata": {
            "source_name": LIBRARY,
            "source_type": "evaluation_run",
            "source_organization_name": about.organization,
            "evaluator_relationship": about.relationship,
        },
        "eval_library": {"name": LIBRARY, "version": _versions(rows)},
        "model_info": {
            "name": rows[0]["player"],
            "id": about.model,
            "additional_details": {"deployment_type": "unknown", "model_availability": "unknown"},
        },
        "evaluation_results": results,
    }
    created = str(int(time.time()))
    evaluation |= {"retrieved_timestamp": created, "evaluation_id": f"{LIBRARY}/{about.model}/{created}"}
    name = uuid.UUID(bytes=hashlib.sha256(canonical_json(results)).digest()[:16], version=4)
    developer, _, model = str(about.model).partition("/")
    path = folder / "data" / LIBRARY / developer / model.replace("/", "_") / f"{name}.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(evaluation, indent=2) + "\n", encoding="utf-8", newline="\n")
    return {"episodes": len(rows), "results": len(results)}


def write_hub_results(records: Iterable[Record], folder: Path, about: Publication) -> dict[str, int]:
    """Write `.eval_results/` of a model's repository: a file for each condition, with an entry for every game."""
    about.needs("dataset")
    rows = _rows(records)
    cells = _cells(rows)
    means = {canonical_json(asdict(cell)): (len(members), estimate) for cell, members, estimate in cells}
    target = folder / ".eval_results"
    target.mkdir()
    groups = conditions([cell for cell, _, _ in cells])
    names: Counter[str] = Counter()
    for condition in groups:
        label = condition.label_among(groups)
        notes = f"{LIBRARY} {_versions(rows)}; {label or 'default budget'}"
        entries = [
            _hub_entry(cell.game, *means[canonical_json(asdict(cell))], notes, about) for cell in condition.cells
        ]
        slug = re.sub(r"[^a-z0-9]+", "-", label.lower()).strip("-")
        names[slug] += 1
        number = "" if names[slug] == 1 else str(names[slug])  # labels that differ in other characters only
        path = target / f"{'_'.join(filter(None, ('smartplay', slug, number)))}.yaml"
        path.write_text("".join(entries), encoding="utf-8", newline="\n")
    return {"episodes": len(rows), "entries": len(cells), "files": len(groups)}


def _rows(records: Iterable[Record]) -> list[Row]:
    """The rows of episodes, which must be those of one player."""
    rows = list(_with_trials(records))
    if len(players := dict.fromkeys(row["player"] for row in rows)) > 1:
        raise InvalidArgumentError(f"These are the results of {', '.join(players)}; name one with --players.")
    return sorted(rows, key=lambda row: (row["game"], canonical_json(row["budget"]), row["seed"]))


def _with_trials(records: Iterable[Record]) -> Iterator[Row]:
    """Yield the rows of records. Which of them are a chain is known from the plan of their run alone."""
    planned: dict[Path, dict[str, int]] = {}
    for number, record in enumerate(records):
        if record.config.carry is None or record.path is None:
            yield row_of(record, number)
            continue
        run = record.path.parent.parent
        if not (run / "manifest.json").exists():
            raise InvalidArgumentError(
                f"{record.path} is of a trial that carries something over, and which trials are a chain is known from "
                "their run alone; name the run's folder."
            )
        if run not in planned:
            planned[run] = {episode.key: episode.trial for episode in RunFolder(run).manifest().episodes}
        yield row_of(record, planned[run][record.key])


def _versions(rows: Sequence[Row]) -> str:
    return ", ".join(sorted({row["versions"]["smartplay-tools"] for row in rows}))


def _cells(rows: Sequence[Row]) -> list[tuple[PlayedCell, list[Row], MeanEstimate]]:
    groups = by_cell(rows)
    estimates = mean_estimates([pairs.sample(members, pairs.score) for _, members in groups])
    return [(*group, estimate) for group, estimate in zip(groups, estimates, strict=True)]


def _eee_result(cell: PlayedCell, rows: Sequence[Row], estimate: MeanEstimate) -> dict[str, Any]:
    bounds = pairs.bounds_of(pairs.score, cell.game)
    ends = UNBOUNDED if bounds is None else {"min_score": bounds.low, "max_score": bounds.high}
    details = {"budget": cell.budget, **cell.rules, "options": cell.options, "player_options": cell.player_options}
    facts = {name: value if isinstance(value, str) else json.dumps(value) for name, value in details.items()}
    key = hashlib.sha256(canonical_json([cell.game, cell.engine, facts])).hexdigest()[:16]
    return {
        "evaluation_result_id": f"{cell.game}/{key}",
        "evaluation_name": cell.game,
        "source_data": {"dataset_name": cell.game, "source_type": "other"},
        "metric_config": {
            "evaluation_description": "The game's own score, a mean over episodes.",
            "metric_id": "smartplay.score",
            "metric_name": "score",
            "metric_unit": "points",
            "lower_is_better": False,
            "score_type": "continuous",
            **ends,
        },
        "score_details": {
            "score": estimate.mean,
            "details": {"completed": str(sum(row["completed"] for row in rows)), "episodes": str(len(rows))},
            "uncertainty": _uncertainty(estimate),
        },
        "generation_config": {"generation_args": _generation(cell), "additional_details": facts},
    }


def _uncertainty(estimate: MeanEstimate) -> dict[str, Any]:
    measures: dict[str, Any] = {"num_samples": estimate.episodes}
    if estimate.sd is not None:
        measures["standard_deviation"] = estimate.sd
    if estimate.low is not None:
        ends = {"lower": estimate.low, "upper": estimate.high, "confidence_level": CONFIDENCE}
        measures["confidence_interval"] = {**ends, "method": f"{LIBRARY}, docs/metrics.md: Intervals"}
    return measures


def _generation(cell: PlayedCell) -> dict[str, Any]:
    limits = {"message_limit": cell.budget["tool_calls"], "token_limit": cell.budget["episode_tokens"]}
    given = {name: limit for name, limit in limits.items() if limit is not None}
    arguments: dict[str, Any] = {"agentic_eval_config": {"available_tools": TOOLS}, "eval_limits": given}
    if (longest := cell.budget["reply_tokens"]) is not None:
        arguments["max_tokens"] = longest
    temperature = cell.player_options.get("temperature")
    return arguments | ({} if temperature is None else {"temperature": temperature})


def _hub_entry(game: str, episodes: int, estimate: MeanEstimate, notes: str, about: Publication) -> str:
    """An entry in YAML, of which JSON's texts and numbers are a part."""
    interval = "" if estimate.low is None else f", 95 % interval {estimate.low:.4g} to {estimate.high:.4g}"
    remark = f"{notes}; mean of {episodes} episodes{interval}"
    lines = [
        "- dataset:",
        f"    id: {json.dumps(about.dataset)}",
        f"    task_id: {json.dumps(game)}",
        f"  value: {json.dumps(round(estimate.mean, 6))}",
        f"  notes: {json.dumps(remark)}",
    ]
    return "".join(f"{line}\n" for line in lines)
