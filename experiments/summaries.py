"""What a script and a model say of the same ways to forget, where the model writes the summaries that it reads.

    python experiments/summaries.py --qwen FILE    # plays, in rounds of worlds; continues where it stopped
    python experiments/summaries.py --publish      # what was played, with three records of every cell

It needs the extras `local`, `evaluation` and those of the compactors. A way whose packages are not in this environment
is left to another one with the same folder. The model plays in the format `legal`: in others it is offered `observe`
beside a compactor, and calls nothing else. So ways that need a call of a tool of their own, notes and recall, cannot be
played.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from compaction import FILES, acts
from entry import EIGHT, IN_VIEW, Cells, play_cell, player_of
from in_view import rank_correlation
from models import QWEN, rows_of, write_records
from page_tables import HERE, Experiment, arguments, interval, markdown_table, mean_score

from smartplay_tools.errors import InvalidArgumentError, MissingExtraError
from smartplay_tools.evaluation.analysis.pairs import paired_difference, score
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.rows import Row
from smartplay_tools.types.groups import grouped

SEED, ROUNDS, READER = 29_112_526, (4, 8, 12, 16), "reader"
CAP, SUMMARY = 740, 120
"""The cap on prompts, in tokens, and on a summary.

The cap was chosen before the model played any of the ways: the least of 560, 620, 680, 740 and so on under which, in
four other worlds, `reader` ends no episode early and is asked at most four times an episode, in each of the ways.
"""
WAYS: Mapping[str, Mapping[str, Any]] = {
    IN_VIEW: {"prompt_tokens": None},
    "dropping": {},
    "masking": {"history": 4, "beyond_history": "mask"},
    "our summary": {"summary_tokens": SUMMARY, "slack": 0.5},
    "LangChain, summary": {"strategy": "langchain-summary"},
    "deepagents, summary": {"strategy": "deepagents-summary"},
    "Inspect, summary": {"strategy": "inspect-summary"},
    "Pydantic AI, summary": {"strategy": "pydantic-ai-summary"},
    "Agent Framework, summary": {"strategy": "agent-framework-summary"},
    "LlamaIndex, summary": {"strategy": f"llama-index-summary:tokens={4 * CAP // 15}"},
    "Google ADK, summary": {"strategy": f"{FILES / 'adk_summary.py'}:Summary"},
    "OpenHands, summary": {"strategy": f"{FILES / 'openhands_summary.py'}:Summary"},
    "Anthropic, compaction": {"strategy": f"compact_20260112:trigger={4 * CAP // 5}"},
    "OpenAI, compaction": {"strategy": f"compaction:compact_threshold={4 * CAP // 5}"},
}
"""Fields of the budget. What a compactor asks may have as many tokens as four prompts."""
SHUFFLES = 2_000


def play(out: Path, file: str) -> None:
    """Play every way that this environment has the packages for, a round of worlds after the other."""
    players = PlayerConfig(name=READER), player_of(QWEN, file, "legal")
    for worlds, way, player in product(ROUNDS, WAYS, players):
        fields = {"prompt_tokens": CAP, "reply_tokens": SUMMARY, **WAYS[way]}
        fields |= {"question_tokens": 4 * CAP} if "strategy" in fields else {}
        try:
            play_cell(out / "ways" / player.name / EIGHT / way, player, EIGHT, worlds, SEED, **fields)
        except (MissingExtraError, InvalidArgumentError) as error:
            print(f"{way} is left to another environment: {error}", flush=True)


def ways_table(cells: Cells) -> str:
    """The score of both players in every way, each with its difference to dropping in the same worlds."""
    lines = []
    for way in WAYS:
        both = [cells.get((player, way), []) for player in (QWEN, READER)]
        if not all(both):
            continue
        asked = fmean(row.get("questions") or row.get("summaries") or 0 for row in both[0])
        early = sum(row["end_reason"] not in ("terminated", "rollout") for row in both[0])
        lines.append([way, f"{len(both[0])}", *_cells(cells, QWEN, way), *_cells(cells, READER, way)])
        lines[-1] += [f"{asked:.1f}", f"{early}"]
    players = (QWEN, f"{QWEN} less dropping", READER, f"{READER} less dropping")
    return markdown_table(("way", "worlds", *players, "questions", "ended early"), lines)


def _cells(cells: Cells, player: str, way: str) -> tuple[str, str]:
    rows = cells[player, way]
    less = paired_difference(rows, cells.get((player, "dropping"), []), score)
    return interval(mean_score(rows)), "" if less is None or way == "dropping" else interval(less, "+")


def agreement(cells: Cells) -> tuple[float, float, float, int]:
    """The rank correlation of the ways' means between the two players, its interval, and the number of ways that act.

    The interval is that of percentiles over resampled worlds, the same worlds for all ways and both players.
    """
    acting = [way for way in WAYS if way != IN_VIEW and acts(way, cells.get((READER, way), ()))]
    both = {way: [_scores(cells, player, way) for player in (QWEN, READER)] for way in acting}
    both = {way: sides for way, sides in both.items() if all(sides)}
    shared = sorted(set.intersection(*({*side} for sides in both.values() for side in sides)))
    scores = np.array([[[side[world] for world in shared] for side in sides] for sides in both.values()])
    drawn = np.random.default_rng(0).integers(len(shared), size=(SHUFFLES, len(shared)))
    found = [rank_correlation(scores[..., worlds].mean(-1)) for worlds in drawn]
    low, high = np.quantile([rho for rho in found if not math.isnan(rho)], (0.025, 0.975))
    return rank_correlation(scores.mean(-1)), low, high, len(both)


def _scores(cells: Cells, player: str, way: str) -> Mapping[int, float]:
    return {row["trial"]: score(row) for row in cells.get((player, way), ())}


def tables(rows: Iterable[Row]) -> dict[str, str]:
    """Return the tables of the page by their names."""
    cells = grouped(rows, lambda row: (row["player"], row["way"]))
    rho, low, high, count = agreement(cells)
    line = [f"{count}", f"{rho:.2f} [{low:.2f}, {high:.2f}]"]
    return {
        "summaries": ways_table(cells),
        "summaries-agreement": markdown_table(("ways", "rank correlation of the two players [95 %]"), [line]),
    }


EXPERIMENT = Experiment("summaries", tables)


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/summaries")
    parser.add_argument("--qwen", help="the file of Qwen2.5-Coder-1.5B-Instruct in four bits")
    asked = parser.parse_args()
    if asked.qwen:
        play(asked.out, asked.qwen)
    if asked.publish:
        write_records(asked.out, HERE / EXPERIMENT.name / "records.tar.xz")
    EXPERIMENT.conclude(rows_of(asked.out), publishes=asked.publish)


if __name__ == "__main__":
    main()
