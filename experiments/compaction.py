"""The judge of compaction: other projects' compactors, unchanged, under a cap that cannot be exceeded.

    python experiments/compaction.py --out runs/compaction      # plays; continues where it stopped
    python experiments/compaction.py --pilot                    # another world, of which nothing is published
    python experiments/compaction.py --way my.py:MyCompactor    # plays yours alone, beside the published rows
    python experiments/compaction.py --replay FOLDER            # proves its records, without the compactor

Every compactor plays the same worlds under the same cap, beside dropping, masking and a summary of this library. What
this environment lacks the packages for is left to another one with the same folder. The players are scripted. `reader`
plays rightly where its prompt shows what is needed; as a summary it writes the observations that the question shows,
the newest of them if not all fit, and in the stages of a curve it loses some. `rule-notes`, told to say nothing, plays
Rock Paper Scissors from the rounds and the manual that it sees.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from page_tables import (
    Experiment,
    arguments,
    complete,
    interval,
    markdown_table,
    mean_score,
    repeat_previous,
    table_row,
    verdict,
)

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
    mark_notes,
    panels,
    sample_note,
    save_figure,
)
from smartplay_tools.evaluation.analysis.pairs import paired_difference, score, values, way_to
from smartplay_tools.evaluation.analysis.remembering import WORK
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.games.specs import lockers_setting
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import USUAL, MeanEstimate, Method, mean_estimate
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
    """A compactor, with its options."""
    asks: bool = False
    fields: Mapping[str, Any] = field(default_factory=dict)
    """Of the budget, for a strategy of this library."""

    def budget(self, longest: int) -> sp.Budget:
        """Return the budget with this cap on questions."""
        fields = {"history": None, "prompt_tokens": CAP, "reply_tokens": 2 * CAP // 5, **self.fields}
        if self.strategy:
            fields["strategy"] = self.strategy
        return sp.Budget(**fields, **({"question_tokens": longest} if longest > CAP else {}))


def _in_file(name: str) -> str:
    file, _, kind = name.partition(":")
    return f"{FILES / file}.py:{kind}"


WAYS = (
    Way("dropping"),
    Way("masking", fields={"history": 10, "beyond_history": "mask"}),
    Way("our summary", fields={"summary_tokens": 2 * CAP // 5, "slack": 0.5}),
    Way("blind, random", "keep-random"),
    Way("blind, spread", "keep-spread"),
    Way("blind, half newest", "keep-spread:newest=0.5"),
    Way("LangChain, summary", "langchain-summary", asks=True),
    Way("deepagents, summary", "deepagents-summary", asks=True),
    Way("langmem, summary", "langmem-summary", asks=True),
    Way("Inspect, summary", "inspect-summary", asks=True),
    Way("Pydantic AI, summary", "pydantic-ai-summary", asks=True),
    Way("Agent Framework, summary", "agent-framework-summary", asks=True),
    Way("LlamaIndex, summary", f"llama-index-summary:tokens={4 * CAP // 15}", asks=True),
    Way("Google ADK, summary", _in_file("adk_summary:Summary"), asks=True),
    Way("OpenHands, summary", _in_file("openhands_summary:Summary"), asks=True),
    Way("Haystack, summary", _in_file("haystack_compaction:Summary"), asks=True),
    Way("AG2, summary", _in_file("ag2_compact:Summary"), asks=True),
    Way("Agno, compression", _in_file("agno_compression:Compression"), asks=True),
    Way("Anthropic, compaction", f"compact_20260112:trigger={4 * CAP // 5}", asks=True),
    Way("OpenAI, compaction", f"compaction:compact_threshold={4 * CAP // 5}", asks=True),
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
    Way("Anthropic, clearing", f"clear_tool_uses_20250919:trigger={4 * CAP // 5}"),
    Way("memory, BM25", "memory-bm25"),
    Way("memory, WordLlama", "memory-wordllama"),
)
"""The first is what the others are compared with; the first six are of this library."""
DROPPING, *_ = CONTROLS = tuple(way.name for way in WAYS[:6])
BEST = {"best choice": "with_return"}
"""Rows of the best choice of whole turns, and the fields of `records.best_choices` that they show.

Under this cap the best choice without bringing turns back scores the same in every world.
"""


def play(out: Path, seed: int, trials: int, ways: Sequence[Way] = WAYS, stages: Sequence[Stage] = ()) -> Iterator[Row]:
    """Play the stages in every way that this environment has the packages for; yield all rows of the folder."""
    here = [way for way in ways if not way.strategy or _is_here(way.name, partial(load_strategy, way.strategy))]
    for stage in stages or (*STAGES, *CURVE):
        for way in here if _is_here(stage.name, sp.GAMES[stage.game].load) else ():
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
    """Yield the rows of everything that was played into a folder."""
    for stage in (*STAGES, *CURVE):
        for way in ways:
            for longest in (CAP, LONGER):
                folder = RunFolder(_folder(out, stage, way, longest))
                for row in folder.rows() if folder.path.exists() else ():
                    yield {**row, "stage": stage.name, "way": way.name, "questions_up_to": longest}


def _is_here(name: str, load: Callable[[], object]) -> bool:
    try:
        load()
    except (MissingExtraError, InvalidArgumentError) as error:
        print(f"{name} is left to another environment: {error}", flush=True)
        return False
    return True


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
    Claim(
        "A summary keeps more of what stands among distractors",
        "distractors",
        ("our summary", "LangChain, summary", "Agent Framework, summary", "Google ADK, summary"),
        is_better=True,
    ),
    Claim(
        "Who summarizes a summary more often than langmem loses more",
        "k = 32, keeps 0.7",
        ("LangChain, summary", "deepagents, summary", "Agent Framework, summary"),
        is_better=False,
        than="langmem, summary",
        longest=LONGER,
    ),
)  # fmt: skip
"""Written down after the pilot's worlds and before those of `SEED` were played."""


Cells = Mapping[tuple[str, int, str], list[Row]]
"""Rows by stage, cap on questions and way."""


def cells_of(rows: Iterable[Row]) -> Cells:
    """Group the rows of a folder; the best choices are those of the worlds."""
    cells = grouped(rows, lambda row: (row["stage"], row["questions_up_to"], row["way"]))
    for stage in STAGES:
        known = [row for row in cells.get((stage.name, CAP, DROPPING), ()) if row.get("best")]
        cells |= {
            (stage.name, CAP, name): [row | {"score": row["best"][its]} for row in known]
            for name, its in BEST.items()
            if known
        }
    return cells


def rows_in(cells: Cells, stage: str, way: str, longest: int) -> list[Row]:
    """Return the rows of a cell. Where no question was too long, both caps on them give the same episodes."""
    return cells.get((stage, longest, way)) or cells.get((stage, CAP, way), [])


def names_in(cells: Cells) -> list[str]:
    """Return the ways that were played, in the order of `WAYS`; a way of somebody else comes last."""
    played = {way for _, _, way in cells}
    known = [way for way in (*CONTROLS, *BEST, *(way.name for way in WAYS[len(CONTROLS) :])) if way in played]
    return [*known, *sorted(played - {*known})]


def less(
    cells: Cells, stage: str, way: str, longest: int, than: str = DROPPING, method: Method = USUAL
) -> MeanEstimate | None:
    """Estimate by how much a way scores more than another on the same worlds."""
    compared = rows_in(cells, stage, way, longest), rows_in(cells, stage, than, longest)
    return paired_difference(*compared, score, method)


def acts(way: str, rows: Iterable[Row]) -> bool:
    """Whether a way is of this library, or rewrote, asked or ended anything in these episodes."""
    did = (row.get("rewrites") or row.get("questions") or row["end_reason"] == "strategy_error" for row in rows)
    return way in (*CONTROLS, *BEST) or any(did)


def scores_table(cells: Cells, longest: int) -> str:
    """The score of dropping, and the difference of every other way to it; with the higher cap where that decides."""
    ways = [way for way in names_in(cells) if longest == CAP or any(each[1:] == (longest, way) for each in cells)]
    lines = (_line(cells, way, longest) for way in ways)
    columns = [*(stage.name for stage in STAGES), "way to best"]
    return markdown_table(["strategy", *columns], (line for line in lines if any(line[1:-1])))


def _line(cells: Cells, way: str, longest: int = CAP) -> list[str]:
    return [way, *(_score(cells, stage.name, way, longest) for stage in STAGES), _way_to_best(cells, way, longest)]


def _way_to_best(cells: Cells, way: str, longest: int) -> str:
    """The mean over the games in which the best choice wins something, if the way was played in all of them."""
    share, names = way_to("with_return"), [stage.name for stage in STAGES]
    winning = [name for name in names if values(cells.get((name, CAP, DROPPING), ()), share)]
    shares = [values(rows_in(cells, name, way, longest), share) for name in winning]
    return interval(mean_estimate([*chain(*shares)])) if winning and all(shares) else ""


def _score(cells: Cells, stage: str, way: str, longest: int) -> str:
    rows = cells.get((stage, longest, way), [])
    if not rows:
        return ""
    early = EARLY * bool(ends_of(rows))
    if way == DROPPING:
        return interval(mean_score(rows)) + early
    return difference(less(cells, stage, way, longest)) + early if acts(way, rows) else "never acts"


def difference(each: MeanEstimate | None) -> str:
    """Return a difference with its interval, or that all pairs are equal."""
    if each is None or each.low is None or each.high is None or each.is_zero:
        return "" if each is None else "equal" if each.is_zero else f"{each.mean:+.2f}"
    return f"{each.mean:+.2f} [{each.low:+.2f}, {each.high:+.2f}]"


def work_table(cells: Cells) -> str:
    """What every compactor did in an episode, over all of the table of scores with the lower cap on questions."""
    lines = []
    for way in names_in(cells):
        rows = [row for stage in STAGES for row in cells.get((stage.name, CAP, way), ())]
        if way not in (*CONTROLS, *BEST) and acts(way, rows):
            means = [fmean(float(measure(row) or 0) for row in rows) for measure in WORK.values()]
            lines.append([way, *(f"{mean:,.{0 if mean >= 100 else 1}f}" if mean else "" for mean in means)])
    return markdown_table(["strategy", *WORK], lines)


def curves(cells: Cells) -> dict[str, list[list[Row]]]:
    """Return the rows of every way that asks, by how much each summary keeps: all of it first."""
    stages = ("k = 32", *(stage.name for stage in CURVE))
    ways = [way for way in names_in(cells) if any((stage, LONGER, way) in cells for stage in stages[1:])]
    return {way: [rows_in(cells, stage, way, LONGER) for stage in stages] for way in ways}


def curve_table(cells: Cells) -> str:
    """The score of those that ask against what each summary keeps, by the summaries of an episode."""
    lines = sorted((fmean(_asked(row) for row in own[0]), way, own) for way, own in curves(cells).items())
    shown = (
        [way, f"{asked:.1f}", *(interval(mean_score(rows)) if rows else "" for rows in own)]
        for asked, way, own in lines
    )
    return markdown_table(["strategy", "questions", "keeps 1", *(f"{stage.keeps}" for stage in CURVE)], shown)


def _asked(row: Row) -> int:
    return int(WORK["sent"](row) or row.get("summaries") or 0)


def claims_table(cells: Cells) -> str:
    """Every sentence with its outcome; the intervals of all comparisons hold together."""
    method, lines = bonferroni(sum(len(claim.ways) for claim in CLAIMS)), []
    for claim in CLAIMS:
        sign = 1 if claim.is_better else -1
        ends: list[tuple[float, str, MeanEstimate]] = []
        for way in claim.ways:
            each = less(cells, claim.stage, way, claim.longest, claim.than, method)
            if each is not None and each.low is not None and each.high is not None:
                ends.append((min(sign * each.low, sign * each.high), way, each))
        missing = [way for way in claim.ways if way not in [name for _, name, _ in ends]]
        failed = [name for end, name, _ in ends if end <= 0] + [f"{way} (not played)" for way in missing]
        outcome = f"all but {', '.join(failed)}" if failed else "confirmed"
        least = f"{min(ends)[1]}: {difference(min(ends)[2])}" if ends else ""
        what = f"{'more' if claim.is_better else 'less'} than {claim.than}"
        lines.append([claim.sentence, claim.stage, f"{len(claim.ways)}, {what}", least, outcome])
    return markdown_table(["sentence", "game", "ways", "the least difference [95 %, all together]", "outcome"], lines)


def _groups(names: Iterable[str]) -> list[tuple[str, list[str]]]:
    ours, others = {*CONTROLS, *BEST}, {way.name for way in WAYS}
    of = grouped(names, lambda name: 0 if name in ours else 1 if name in others else 2)
    labels = ("of this library", "of others, and memories", "yours")
    return [(labels[group], own) for group, own in sorted(of.items())]


@figure
def dots(cells: Cells) -> Figure:
    """Draw the score of every way in three games, with the lower cap on questions."""
    stages = [STAGES[at] for at in (1, 2, 4)]
    drawn, axes = panels(len(stages), columns=len(stages), size=(3.6, 9.6))
    names = names_in(cells)[::-1]
    counts, marks = set(), [""]
    for panel, stage in zip(axes, stages, strict=True):
        for look, (whose, own) in enumerate(_groups(names)):
            played = [(name, cells[stage.name, CAP, name]) for name in own if (stage.name, CAP, name) in cells]
            means = [mean_score(rows) for _, rows in played]
            early = [EARLY * bool(ends_of(rows)) for _, rows in played]
            places = [names.index(name) for name, _ in played]
            draw_dots(panel, means, places, Series.number(look), whose, early)
            marks += early
            counts |= {each.episodes for each in means}
        others = {name for name in names if name not in (*CONTROLS, *BEST)}
        less_dropping = [each for name in others if (each := less(cells, stage.name, name, CAP))]
        more, worse = (sum(verdict(each) == said for each in less_dropping) for said in ("more", "less"))
        found = f"{stage.name}: of {len(less_dropping)} others,\n{more} above dropping, {worse} below"
        panel.set(title=found, xlabel="score", yticks=range(len(names)))
        panel.set_yticklabels(names if panel is axes[0] else [])
    legend_below(drawn, note="; ".join([sample_note(counts), *mark_notes(marks)]))
    return drawn


@figure
def curve(cells: Cells) -> Figure:
    """Draw the score of those that ask against the share of the lines that each summary keeps."""
    drawn, [panel] = panels(1, size=(8, 4.2))
    places = [1.0, *(stage.keeps for stage in CURVE)]
    for index, (way, own) in enumerate(curves(cells).items()):
        points = [(place, mean_score(rows)) for place, rows in zip(places, own, strict=True) if rows]
        draw_estimates(panel, [at for at, _ in points], [each for _, each in points], Series.number(index), way)
    panel.set(title="k = 32", xlabel="probability with which a summary keeps a line", ylabel="score")
    panel.invert_xaxis()
    legend_below(drawn, note="bars: 95 % intervals")
    return drawn


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page by their names."""
    cells = cells_of(rows)
    return {
        "compaction": scores_table(cells, CAP),
        "compaction-questions": scores_table(cells, LONGER),
        "compaction-work": work_table(cells),
        "compaction-curve": curve_table(cells),
        "compaction-claims": claims_table(cells),
    }


def figures(rows: Iterable[Row]) -> dict[str, Figure]:
    """Return the figures of the page by their names."""
    cells = cells_of(rows)
    return {"compaction": dots(cells), "compaction-curve": curve(cells)}


EXPERIMENT = Experiment("compaction", tables, figures)


def play_alone(way: Way, out: Path, trials: int = TRIALS) -> list[Row]:
    """Play a way in the published worlds; print the tables with it, and the row to send; return all rows."""
    played = [{**row, "way": way.name} for row in play(out, SEED, trials, [way], STAGES)]
    rows = [*(row for row in EXPERIMENT.rows() if row["way"] != way.name), *played]
    for name, written in tables(rows).items():
        print(f"{name}\n\n{written}\n", flush=True)
    for name, drawn in figures(rows).items():
        save_figure(drawn, out / name, formats=["svg"])
    print(f"The figures are in {out}, with the records, which --replay proves without your code.")
    print(f"The row to send in a pull request:\n{table_row(_line(cells_of(rows), way.name))}")
    return rows


def prove(folder: Path) -> None:
    """Play the records below a folder again, and print how many are identical; leave with 1 if one differs."""
    replayed = {record: sp.replay(record).identical for record in sorted(folder.rglob("episodes/*.jsonl"))}
    differing = [f"{record} differs." for record, is_identical in replayed.items() if not is_identical]
    print(*differing, f"{len(replayed) - len(differing)} of {len(replayed)} records are identical.", sep="\n")
    sys.exit(bool(differing) or not replayed)


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/compaction")
    parser.add_argument("--pilot", action="store_true", help="play another world, and publish nothing")
    parser.add_argument("--way", metavar="FILE.py:CLASS", help="play this compactor alone in the published worlds")
    parser.add_argument("--replay", type=Path, metavar="FOLDER", help="play the records of a folder again, and compare")
    parser.add_argument("--trials", type=int, default=TRIALS, help="the worlds of each game")
    asked = parser.parse_args()
    logging.disable(logging.WARNING)  # of frameworks, for every question that is refused
    if asked.replay:
        prove(asked.replay)
    if asked.way:
        rows = play_alone(Way(asked.way.rpartition("/")[2], asked.way, asks=True), asked.out / "alone", asked.trials)
        if asked.publish:
            EXPERIMENT.conclude(rows, publishes=True)
        return
    folder, seed, trials = ("pilot", PILOT_SEED, PILOT_TRIALS) if asked.pilot else ("fresh", SEED, asked.trials)
    EXPERIMENT.conclude(play(asked.out / folder, seed, trials), publishes=asked.publish and not asked.pilot)


if __name__ == "__main__":
    main()
