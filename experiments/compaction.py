"""The judge of compaction: other projects' compactors, unchanged, under a cap that cannot be exceeded.

    python experiments/compaction.py --out runs/compaction      # plays; continues where it stopped
    python experiments/compaction.py --pilot                    # another world, of which nothing is published
    python experiments/compaction.py --way my.py:MyCompactor    # plays yours alone, beside the published rows

Every compactor plays the same worlds under the same cap, beside dropping, masking and a summary of this library. What
this environment lacks the packages for is left to another one with the same folder. The players are scripted. `reader`
plays rightly where its prompt shows what is needed; as a summary it writes the observations that the question shows, the
newest of them if not all fit, and in the stages of a curve it loses some. `rule-notes`, told to say nothing, plays Rock
Paper Scissors from the rounds and the manual that it sees.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from page_tables import Experiment, arguments, complete, interval, markdown_table, mean_score, repeat_previous, table_row

import smartplay_tools as sp
from smartplay_tools.context.strategies.custom import load_strategy
from smartplay_tools.errors import InvalidArgumentError, MissingExtraError
from smartplay_tools.evaluation.analysis.beside import EARLY, ends_of
from smartplay_tools.evaluation.analysis.figures.style import (
    Series,
    draw_dots,
    draw_estimates,
    figure,
    legend_below,
    panels,
    sample_note,
    save_figure,
)
from smartplay_tools.evaluation.analysis.pairs import paired_difference, score
from smartplay_tools.evaluation.analysis.remembering import WORK
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.games.specs import lockers_setting
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import USUAL, MeanEstimate, Method
from smartplay_tools.types.groups import grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILES = Path(__file__).parent / "compactors"
SEED, TRIALS = 4712, 32
PILOT_SEED, PILOT_TRIALS = 11, 1
CAP, LONGER = 1500, 4000
"""The cap on prompts, in tokens, which is that on questions, and the higher one on questions."""
K32 = repeat_previous(32)
LOCKERS = sp.register(lockers_setting("Lockers16Distractors48-v0", facts=16, distractors=48)).id


@dataclass(frozen=True)
class Stage:
    """A game with its player; its manual is pinned, or the result of a call (`tool`) and can be lost."""

    name: str
    game: str
    keeps: float = 1.0
    """The share of the lines that stay whenever the player writes a summary."""
    manual: str = "pinned"

    @property
    def player(self) -> PlayerConfig:
        """The player, which is silent where the manual can be lost."""
        if self.manual == "tool":
            return PlayerConfig(name="rule-notes", options={"words": False})
        return PlayerConfig(name="reader", options={"keeps": self.keeps} if self.keeps < 1 else {})


STAGES = (
    Stage("k = 8", repeat_previous(8)),
    Stage("k = 32", K32),
    Stage("distractors", LOCKERS),
    Stage("all cards", "popgym-CountRecallEasy-v0"),
    Stage("a manual", "RockPaperScissorDifferentScore-v0", manual="tool"),
)
"""In the order of the tables' columns."""
CURVE = tuple(Stage(f"k = 32, keeps {keeps}", K32, keeps) for keeps in (0.9, 0.7, 0.5))
"""Played by those that ask alone, with the higher cap on their questions."""


@dataclass(frozen=True)
class Way:
    """A way to deal with what does not fit."""

    name: str
    strategy: str = ""
    """A compactor, with the cap's share of its options."""
    asks: bool = False
    fields: Mapping[str, Any] = field(default_factory=dict)
    """Of the budget, for a strategy of this library."""

    def budget(self, longest: int) -> sp.Budget:
        """Return the budget with this cap on questions."""
        fields = {"history": None, "prompt_tokens": CAP, "reply_tokens": 2 * CAP // 5, **self.fields}
        if self.strategy:
            fields["strategy"] = self.strategy.format(tokens=4 * CAP // 15, trigger=4 * CAP // 5)
        return sp.Budget(**fields, **({"question_tokens": longest} if longest > CAP else {}))


def _in_file(name: str) -> str:
    file, _, kind = name.partition(":")
    return f"{FILES / file}.py:{kind}"


WAYS = (
    Way("dropping"),
    Way("masking", fields={"history": 10, "beyond_history": "mask"}),
    Way("our summary", fields={"summary_tokens": 2 * CAP // 5, "slack": 0.5}),
    Way("LangChain, summary", "langchain-summary", asks=True),
    Way("deepagents, summary", "deepagents-summary", asks=True),
    Way("langmem, summary", "langmem-summary", asks=True),
    Way("Inspect, summary", "inspect-summary", asks=True),
    Way("Pydantic AI, summary", "pydantic-ai-summary", asks=True),
    Way("Agent Framework, summary", "agent-framework-summary", asks=True),
    Way("LlamaIndex, summary", "llama-index-summary:tokens={tokens}", asks=True),
    Way("Google ADK, summary", _in_file("adk_summary:Summary"), asks=True),
    Way("OpenHands, summary", _in_file("openhands_summary:Summary"), asks=True),
    Way("Haystack, summary", _in_file("haystack_compaction:Summary"), asks=True),
    Way("AG2, summary", _in_file("ag2_compact:Summary"), asks=True),
    Way("Agno, compression", _in_file("agno_compression:Compression"), asks=True),
    Way("Anthropic, compaction", "compact_20260112:trigger={trigger}", asks=True),
    Way("OpenAI, compaction", "compaction:compact_threshold={trigger}", asks=True),
    Way("LangChain, clearing", "langchain-clear"),
    Way("LangChain, trimming", _in_file("langchain_trim:Trim")),
    Way("Inspect, clearing", "inspect-edit"),
    Way("Inspect, trimming", "inspect-trim"),
    Way("Pydantic AI, newest", "pydantic-ai-newest"),
    Way("Pydantic AI, window", "pydantic-ai-window"),
    Way("Haystack, window", _in_file("haystack_compaction:Window")),
    Way("Haystack, pruning", _in_file("haystack_compaction:Pruning")),
    Way("AutoGen, newest", _in_file("autogen_contexts:Buffered")),
    Way("AutoGen, token limit", _in_file("autogen_contexts:TokenLimited")),
    Way("AG2, newest", _in_file("ag2_compact:Newest")),
    Way("Headroom", _in_file("headroom_compress:Compression")),
    Way("Anthropic, clearing", "clear_tool_uses_20250919:trigger={trigger}"),
    Way("memory, BM25", "memory-bm25"),
    Way("memory, WordLlama", "memory-wordllama"),
)
"""The first is what the others are compared with; the first three are of this library."""
DROPPING, *_ = CONTROLS = tuple(way.name for way in WAYS[:3])


def play(out: Path, seed: int, trials: int, ways: Sequence[Way] = WAYS, stages: Sequence[Stage] = ()) -> Iterator[Row]:
    """Play the stages in every way that this environment has the packages for; yield all rows of the folder."""
    here = [way for way in ways if _is_installed(way)]
    for stage in stages or (*STAGES, *CURVE):
        for way in here:
            if stage in STAGES or way.asks or "summary_tokens" in way.fields:
                _play(out, seed, trials, stage, way)
    yield from rows_of(out, ways)


def _play(out: Path, seed: int, trials: int, stage: Stage, way: Way) -> None:
    """Play a stage with both caps on questions; with the higher alone in a curve, or if no question was too long."""
    for longest in (CAP, LONGER) if stage in STAGES else (LONGER,):
        done = complete(
            [stage.game], [stage.player], budgets=[way.budget(longest if way.asks else CAP)], manual=stage.manual,
            trials=trials, seed=seed, out=_folder(out, stage, way, longest), executor="inline",
        )  # fmt: skip
        if not any(row.get("refused_questions") for row in done.rows):
            return


def rows_of(out: Path, ways: Iterable[Way] = WAYS) -> Iterator[Row]:
    """Yield the rows of everything that was played into a folder, with what their tables need."""
    for stage in (*STAGES, *CURVE):
        for way in ways:
            for longest in (CAP, LONGER):
                folder = RunFolder(_folder(out, stage, way, longest))
                for row in folder.rows() if folder.path.exists() else ():
                    yield {**row, "stage": stage.name, "way": way.name, "questions_up_to": longest}


def _is_installed(way: Way) -> bool:
    try:
        return not way.strategy or bool(load_strategy(way.strategy))
    except (MissingExtraError, InvalidArgumentError) as error:
        print(f"{way.name} is left to another environment: {error}", flush=True)
        return False


def _folder(out: Path, stage: Stage, way: Way, longest: int) -> Path:
    return out / stage.name / way.name.replace("/", " ") / f"{longest}"


@dataclass(frozen=True)
class Claim:
    """A sentence of the page: each of these ways scores more, or less, than another on the same worlds."""

    sentence: str
    stage: str
    ways: Sequence[str]
    is_better: bool
    than: str = DROPPING
    longest: int = CAP
    """The cap on questions."""


FILLED = ("our summary", "LangChain, summary", "deepagents, summary", "Agent Framework, summary", "Google ADK, summary")
CLAIMS = (
    Claim(
        "A summary or a search keeps a card of 31 steps before",
        "k = 32",
        (*FILLED, "OpenHands, summary", "Haystack, summary", "AG2, summary", "Anthropic, compaction",
         "OpenAI, compaction", "memory, BM25", "memory, WordLlama"),
        is_better=True,
    ),
    Claim(
        "What clears, or counts messages, loses a card of 7 steps before",
        "k = 8",
        ("LangChain, clearing", "Inspect, clearing", "LlamaIndex, summary", "Pydantic AI, newest", "AutoGen, newest"),
        is_better=False,
    ),
    Claim("A summary holds more of all cards", "all cards", FILLED, is_better=True),
    Claim(
        "The manual is lost",
        "a manual",
        ("LangChain, summary", "deepagents, summary", "Pydantic AI, summary", "Agent Framework, summary",
         "Google ADK, summary", "OpenHands, summary", "LangChain, clearing", "Inspect, trimming", "Pydantic AI, newest",
         "Pydantic AI, window", "memory, BM25", "memory, WordLlama"),
        is_better=False,
    ),
)  # fmt: skip
"""Written down after the pilot's worlds and before those of `SEED` were played."""
