"""The judge of compaction: other projects' compactors, unchanged, under a cap that cannot be exceeded.

    python experiments/compaction.py --out runs/compaction     # plays; continues where it stopped
    python experiments/compaction.py --pilot                   # another world, of which nothing is published

Every compactor plays the same worlds under the same caps, beside dropping, masking, a summary and `recall` of this
library. What this environment lacks the packages for is left to another one with the same folder: OpenHands' SDK needs
Python 3.12. The players are scripted. `reader` plays games with cards, rightly where its prompt shows what is needed;
as a summary it writes the observations that the question shows, the newest of them if not all fit. `rule-notes`, told
to say nothing, plays SmartPlay's games from the rounds and the manual that it sees.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from page_tables import (
    Experiment,
    arguments,
    complete,
    in_steps,
    interval,
    markdown_table,
    outcome,
    repeat_previous,
    verdict,
)

import smartplay_tools as sp
from smartplay_tools.context.strategies.custom import load_strategy
from smartplay_tools.errors import InvalidArgumentError, MissingExtraError
from smartplay_tools.evaluation.analysis.beside import EARLY, ends_of
from smartplay_tools.evaluation.analysis.figures.style import (
    Series,
    draw_dots,
    figure,
    legend_below,
    mark_notes,
    panels,
    sample_note,
)
from smartplay_tools.evaluation.analysis.pairs import Measure, paired_difference, sample, score
from smartplay_tools.evaluation.analysis.remembering import ANSWERS, SURVIVED, tokens_of
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records import Record
from smartplay_tools.records.remembered import UNSEEN
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import USUAL, Bounds, MeanEstimate, Method, mean_estimate
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.messages import text_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILES = Path(__file__).parent / "compactors"
SEED, TRIALS = 4711, 8
PILOT_SEED, PILOT_TRIALS = 11, 1
SMALL, LARGE = 1500, 4000
"""The caps on prompts, in tokens."""
READER, RULE = PlayerConfig(name="reader"), PlayerConfig(name="rule-notes", options={"words": False})
SHARE = Bounds(0, 1)


@dataclass(frozen=True)
class Stage:
    """A game under a cap, with a manual that is pinned, or that is the result of a call (`tool`) and can be lost."""

    name: str
    game: str
    player: PlayerConfig
    cap: int
    manual: str = "pinned"


HANDS, MESSENGER = "RockPaperScissorDifferentScore-v0", "MessengerL2-v0"
STAGES = (
    Stage("k = 8", repeat_previous(8), READER, SMALL),
    Stage("k = 32", repeat_previous(32), READER, SMALL),
    Stage("CountRecall", "popgym-CountRecallEasy-v0", READER, SMALL),
    Stage("RPS", HANDS, RULE, SMALL),
    Stage("RPS, manual can be lost", HANDS, RULE, SMALL, "tool"),
    Stage("MESSENGER", MESSENGER, RULE, SMALL),
    Stage("MESSENGER, manual can be lost", MESSENGER, RULE, SMALL, "tool"),
    Stage("k = 80", repeat_previous(80, decks=2), READER, LARGE),
    Stage("CountRecall, two decks", "popgym-CountRecallMedium-v0", READER, LARGE),
    Stage("RPS", HANDS, RULE, LARGE),
    Stage("RPS, manual can be lost", HANDS, RULE, LARGE, "tool"),
    Stage("MESSENGER", MESSENGER, RULE, LARGE),
    Stage("MESSENGER, manual can be lost", MESSENGER, RULE, LARGE, "tool"),
)
"""In the order of the tables' columns. One deck of cards fits into the larger cap."""


@dataclass(frozen=True)
class Way:
    """A way to deal with what does not fit."""

    name: str
    strategy: str = ""
    """A compactor, with the cap's share of its options."""
    asks: bool = False
    fields: Mapping[str, Any] = field(default_factory=dict)
    """Of the budget, for a strategy of this library."""

    def budgets(self, stage: Stage) -> Iterator[sp.Budget]:
        """Yield the budgets with which it plays a stage."""
        reply = 2 * stage.cap // 5
        fields = {"history": None, "prompt_tokens": stage.cap, "reply_tokens": reply, **self.fields}
        if self.strategy:
            fields["strategy"] = self.strategy.format(tokens=4 * stage.cap // 15, trigger=4 * stage.cap // 5)
        if "summary_tokens" in fields:
            fields["summary_tokens"] = reply
        yield sp.Budget(**fields)
        if self.asks and stage.cap < LARGE:
            yield sp.Budget(**fields, question_tokens=LARGE)


WAYS = (
    Way("dropping"),
    Way("masking", fields={"history": 10, "beyond_history": "mask"}),
    Way("our summary", fields={"summary_tokens": None, "slack": 0.5}),
    Way("recall", fields={"recall_tokens": 200}),
    Way("LangChain, summary", "langchain-summary", asks=True),
    Way("deepagents, summary", "deepagents-summary", asks=True),
    Way("langmem, summary", "langmem-summary", asks=True),
    Way("Inspect, summary", "inspect-summary", asks=True),
    Way("Pydantic AI, summary", "pydantic-ai-summary", asks=True),
    Way("Agent Framework, summary", "agent-framework-summary", asks=True),
    Way("LlamaIndex, summary", "llama-index-summary:tokens={tokens}", asks=True),
    Way("Google ADK, summary", f"{FILES / 'adk_summary.py'}:Summary", asks=True),
    Way("OpenHands, summary", f"{FILES / 'openhands_summary.py'}:Summary", asks=True),
    Way("LangChain, clearing", "langchain-clear"),
    Way("Inspect, clearing", "inspect-edit"),
    Way("Inspect, trimming", "inspect-trim"),
    Way("Pydantic AI, newest", "pydantic-ai-newest"),
    Way("Pydantic AI, window", "pydantic-ai-window"),
    Way("Anthropic, clearing", "clear_tool_uses_20250919:trigger={trigger}"),
    Way("Anthropic, compaction", "compact_20260112:trigger={trigger}", asks=True),
    Way("OpenAI, compaction", "compaction:compact_threshold={trigger}", asks=True),
    Way("memory, BM25", "memory-bm25"),
    Way("memory, WordLlama", "memory-wordllama"),
)
"""The first is what the others are compared with; the first four are of this library."""
DROPPING, *_ = CONTROLS = tuple(way.name for way in WAYS[:4])
CAN_BE_LOST = ", manual can be lost"
ENDED = ("prompt_tokens", "strategy_error")
"""How an episode ends where a cap or a compactor ends it."""


def play(out: Path, seed: int, trials: int) -> Iterator[Row]:
    """Play every stage in every way that this environment has the packages for; yield all rows of the folder."""
    here = [way for way in WAYS if _is_installed(way)]
    for stage in STAGES:
        for way in here:
            if way.name != "recall" or stage.player == RULE:  # the reader does not search
                complete(
                    [stage.game], [stage.player], budgets=list(way.budgets(stage)), manual=stage.manual,
                    trials=trials, seed=seed, out=_folder(out, stage, way), executor="inline",
                )  # fmt: skip
    yield from rows_of(out)


def rows_of(out: Path) -> Iterator[Row]:
    """Yield the rows of everything that was played into a folder, with what their tables need."""
    for stage in STAGES:
        for way in WAYS:
            folder = RunFolder(_folder(out, stage, way))
            for row in folder.rows() if folder.path.exists() else ():
                facts: dict[str, Any] = {"stage": stage.name, "way": way.name, "cap": stage.cap}
                facts["questions_up_to"] = row["budget"].get("question_tokens") or stage.cap
                if stage.manual == "tool":
                    facts["manual_seen"] = manual_seen(Record.read(folder.transcript(row["key"])))
                yield {**row, **facts}


def _is_installed(way: Way) -> bool:
    try:
        return not way.strategy or bool(load_strategy(way.strategy))
    except (MissingExtraError, InvalidArgumentError) as error:
        print(f"{way.name} is left to another environment: {error}", flush=True)
        return False


def _folder(out: Path, stage: Stage, way: Way) -> Path:
    return out / f"{stage.name} {stage.cap}" / way.name


def manual_seen(record: Record) -> list[int]:
    """In how many prompts to play the manual was in view after it had been read, and of how many."""
    read = next((call for call in record.calls if call["data"].get("manual")), None)
    if read is None:
        return [0, 0]
    later = [each.prompt for each in record.sent_prompts() if each.turn > read["turn"]]
    shown = [read["text"] in "\n".join(map(text_of, each.messages)) for each in later if each.purpose == "play"]
    return [sum(shown), len(shown)]


Cells = Mapping[tuple[str, int, int, str], list[Row]]
"""Rows by stage, cap, cap on questions and way."""


def cells_of(rows: Iterable[Row]) -> Cells:
    """Group the rows of a folder."""
    return grouped(rows, lambda row: (row["stage"], row["cap"], row["questions_up_to"], row["way"]))


def lines_of(cells: Cells, cap: int) -> list[tuple[str, int]]:
    """Return the ways under a cap, in the order of `WAYS`, each with the cap on its questions."""
    shown = dict.fromkeys((way, longest) for _, under, longest, way in cells if under == cap)
    names = [way.name for way in WAYS]
    return sorted(shown, key=lambda line: (names.index(line[0]), line[1]))


def longest_of(cells: Cells, cap: int) -> list[tuple[str, int]]:
    """Return the same, each way once, with the higher cap on questions."""
    return list(dict(lines_of(cells, cap)).items())


def label(cells: Cells, cap: int, way: str, longest: int) -> str:
    """Return the name of a way with the cap on its questions, and whether it never did anything."""
    rows = [row for (_, *place), own in cells.items() if place == [cap, longest, way] for row in own]
    asks = any(each.asks for each in WAYS if each.name == way)
    return f"{way}{f' ({longest:,})' if asks else ''}{'' if acts(way, rows) else ' (never acts)'}"


def acts(way: str, rows: Iterable[Row]) -> bool:
    """Whether a way is of this library, or rewrote or asked anything in these episodes."""
    return way in CONTROLS or any(row.get("rewrites") or row.get("questions") for row in rows)


def estimate(rows: Sequence[Row], measure: Measure, bounds: Bounds | None = None) -> MeanEstimate | None:
    """Estimate the mean of a measure; None if no episode has it."""
    own = sample(rows, measure, bounds)
    return mean_estimate(own.values, own.bounds) if own.values else None


def less_dropping(cells: Cells, place: tuple[str, int, int, str], method: Method = USUAL) -> MeanEstimate | None:
    """Estimate by how much a way scores more than dropping on the same worlds."""
    stage, cap, _, _ = place
    return paired_difference(cells[place], cells[stage, cap, cap, DROPPING], score, method)


def scores_table(cells: Cells, cap: int) -> str:
    """The score of dropping, and the difference of every other way to it, game by game.

    A way that asks has a line for the lower cap on its questions only where that decides something.
    """
    stages = [stage.name for stage in STAGES if stage.cap == cap and stage.name in SHOWN[cap]]
    highest = dict(longest_of(cells, cap))
    lines = []
    for way, longest in lines_of(cells, cap):
        own, best = ([_score(cells, (stage, cap, each, way)) for stage in stages] for each in (longest, highest[way]))
        if any(own) and (longest == highest[way] or own != best) and set(own) != {"never acts"}:
            lines.append([label(cells, cap, way, longest), *own])
    return markdown_table(["strategy", *stages], lines)


def _score(cells: Cells, place: tuple[str, int, int, str]) -> str:
    way = place[-1]
    if place not in cells:
        return ""
    early = in_steps(cells[place])
    if way == DROPPING:
        return interval(estimate(cells[place], score)) + early
    return interval(less_dropping(cells, place), "+") + early if acts(way, cells[place]) else "never acts"


SHOWN = {
    SMALL: ("k = 8", "k = 32", "CountRecall", *(f"{game}{CAN_BE_LOST}" for game in ("RPS", "MESSENGER"))),
    LARGE: ("k = 80", "CountRecall, two decks"),
}
"""The games of the tables of scores: where a manual is pinned, or under the larger cap, little is decided in others."""

WORK: Mapping[str, tuple[Measure, Bounds | None]] = {
    "prompts over the cap (%)": (lambda row: row.get("over_prompts", 0) / row["turns"], SHARE),
    "rewritings": (lambda row: row.get("rewrites", 0), None),
    "questions": (lambda row: row.get("questions", 0), None),
    "refused": (lambda row: row.get("refused_questions", 0), None),
    "tokens of questions": (tokens_of("question_prompt", "question_reply"), None),
}
"""Columns, each with its measure of an episode."""


def work_table(cells: Cells, cap: int) -> str:
    """What every compactor did, over all games under a cap."""
    lines = []
    for way, longest in lines_of(cells, cap):
        if way in CONTROLS:
            continue
        rows = [row for (_, *place), own in cells.items() if place == [cap, longest, way] for row in own]
        ended = sum(row["end_reason"] in ENDED for row in rows)
        shown = [share(estimate(rows, *each)) if each[1] else _mean(estimate(rows, *each)) for each in WORK.values()]
        lines.append([label(cells, cap, way, longest), *shown, f"{ended}"])
    lines = [line for line, later in zip(lines, [*lines[1:], [""]], strict=True) if not _is_same(line, later)]
    return markdown_table(["strategy", *WORK, "ended early"], lines)


def _is_same(line: Sequence[str], later: Sequence[str]) -> bool:
    """Whether two lines are of one way, and its cap on questions decided nothing."""
    return line[0].partition(" (")[0] == later[0].partition(" (")[0] and line[1:] == later[1:]


def _mean(each: MeanEstimate | None) -> str:
    return "" if each is None else f"{each.mean:,.{0 if each.mean >= 100 else 1}f}"


def share(each: MeanEstimate | None) -> str:
    """Return a share in percent with its interval."""
    if each is None:
        return ""
    return f"{100 * each.mean:.0f} [{100 * (each.low or 0):.0f}, {100 * (each.high or 0):.0f}]"


def memory_table(cells: Cells, stages: Sequence[str]) -> str:
    """Of the games with cards: what was in view, and right answers out of view, and by evictions survived."""
    lines = []
    for way, longest in longest_of(cells, SMALL):
        rows = [row for stage in stages for row in cells.get((stage, SMALL, longest, way), ())]
        if rows:
            shown = share(estimate(rows, ANSWERS[UNSEEN], SHARE))
            survived = [percent(estimate(rows, measure, SHARE)) for measure in SURVIVED.values()]
            seen = percent(estimate(rows, ANSWERS["seen"], SHARE))
            lines.append([label(cells, SMALL, way, longest), seen, shown, *survived])
    return markdown_table(["strategy", "seen", UNSEEN, *SURVIVED], lines)


def percent(each: MeanEstimate | None) -> str:
    """Return a share in percent."""
    return "" if each is None else f"{100 * each.mean:.0f}"


def manual_table(cells: Cells) -> str:
    """What it costs that the manual can be lost: of the games that can be played with both, on the same worlds."""
    lines = []
    for way, longest in longest_of(cells, SMALL):
        if way in CONTROLS:
            continue  # under the window of this library a manual that was read stays
        line = [label(cells, SMALL, way, longest)]
        for game in ("RPS", "MESSENGER"):
            pinned, loose = (cells[f"{game}{suffix}", SMALL, longest, way] for suffix in ("", CAN_BE_LOST))
            less = paired_difference(loose, pinned, score)
            line += [percent(estimate(loose, manual_share, SHARE)), interval(less, "+") + in_steps(loose)]
        lines.append(line)
    headings = [f"{game}: {what}" for game in ("RPS", "MESSENGER") for what in ("manual in view (%)", "less pinned")]
    return markdown_table(["strategy", *headings], lines)


def manual_share(row: Row) -> float | None:
    """The share of the prompts after the manual was read that show it."""
    seen, prompts = row["manual_seen"]
    return seen / prompts if prompts else None


@dataclass(frozen=True)
class Claim:
    """That a way scores more, or less, than dropping on the same worlds, with questions up to 4,000 tokens."""

    stage: str
    cap: int
    way: str
    is_better: bool


LOSABLE_HANDS, LOSABLE_MESSENGER = f"RPS{CAN_BE_LOST}", f"MESSENGER{CAN_BE_LOST}"
CLAIMS = (
    Claim("k = 8", SMALL, "LangChain, clearing", is_better=False),
    Claim("k = 8", SMALL, "LlamaIndex, summary", is_better=False),
    Claim("k = 8", SMALL, "Pydantic AI, newest", is_better=False),
    Claim("k = 32", SMALL, "LangChain, summary", is_better=True),
    Claim("k = 32", SMALL, "Agent Framework, summary", is_better=True),
    Claim("k = 32", SMALL, "memory, BM25", is_better=True),
    Claim("k = 32", SMALL, "Inspect, clearing", is_better=False),
    Claim("CountRecall", SMALL, "LangChain, summary", is_better=True),
    Claim(LOSABLE_HANDS, SMALL, "LangChain, summary", is_better=False),
    Claim(LOSABLE_HANDS, SMALL, "Inspect, summary", is_better=True),
    Claim(LOSABLE_MESSENGER, SMALL, "LangChain, clearing", is_better=False),
    Claim("k = 80", LARGE, "Google ADK, summary", is_better=True),
)
"""Written down after the pilot world and before the worlds of `SEED` were played."""


def claims_table(cells: Cells) -> str:
    """Every claim with its outcome; the intervals hold together."""
    lines = []
    for claim in CLAIMS:
        place = claim.stage, claim.cap, dict(lines_of(cells, claim.cap)).get(claim.way, 0), claim.way
        each = less_dropping(cells, place, bonferroni(len(CLAIMS))) if place in cells else None
        said = "undecided" if each is None else outcome(each, better=claim.is_better)  # one world has no interval
        facts = [f"{claim.stage}, cap {claim.cap:,}", claim.way, "more" if claim.is_better else "less"]
        lines.append([*facts, interval(each, "+") + in_steps(cells.get(place, [])), said])
    headings = ("game", "strategy", "claim: scores", "less dropping [95 %, all together]", "outcome")
    return markdown_table(headings, lines)


@figure
def dots(cells: Cells) -> Figure:
    """Draw the score of every way, a panel for each game with cards; questions may have 4,000 tokens."""
    stages = [stage for stage in STAGES if stage.player == READER]
    drawn, axes = panels(len(stages), columns=len(stages), size=(2.9, 5.2))
    played = set.intersection(*({way for way, _ in lines_of(cells, stage.cap)} for stage in stages))
    names = [way.name for way in reversed(WAYS) if way.name != "recall" and way.name in played]
    counts, marks = set(), [""]
    for panel, stage in zip(axes, stages, strict=True):
        gains = 0
        for row, name in enumerate(names):
            longest = dict(lines_of(cells, stage.cap))[name]
            rows = cells[stage.name, stage.cap, longest, name]
            each, mark = estimate(rows, score), EARLY * bool(ends_of(rows))
            assert each is not None
            look, whose = (0, "of this library") if name in CONTROLS else (1, "of others, and memories")
            draw_dots(panel, [each], [row], Series.number(look), whose, [mark])
            marks.append(mark)
            less = less_dropping(cells, (stage.name, stage.cap, longest, name))
            gains += name not in CONTROLS and less is not None and verdict(less) == "more"
            counts.add(each.episodes)
        title = f"{stage.name}, cap {stage.cap:,}\n{gains} of {len(set(names) - set(CONTROLS))} keep more"
        panel.set(title=title, xlabel="score", xlim=(-1.1, 1.1), xticks=(-1, 0, 1), yticks=range(len(names)))
        panel.set_yticklabels(names if panel is axes[0] else [])
    legend_below(drawn, note="; ".join([sample_note(counts), *mark_notes(marks)]))
    return drawn


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page by their names."""
    cells = cells_of(rows)
    return {
        "compaction-1500": scores_table(cells, SMALL),
        "compaction-4000": scores_table(cells, LARGE),
        "compaction-work-1500": work_table(cells, SMALL),
        "compaction-memory": memory_table(cells, ("k = 8", "k = 32")),
        "compaction-manual": manual_table(cells),
        "compaction-claims": claims_table(cells),
    }


EXPERIMENT = Experiment("compaction", tables, lambda rows: {"compaction": dots(cells_of(rows))})


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/compaction")
    parser.add_argument("--pilot", action="store_true", help="play another world, and publish nothing")
    asked = parser.parse_args()
    logging.disable(logging.WARNING)  # of frameworks, for every question that is refused
    folder, seed, trials = ("pilot", PILOT_SEED, PILOT_TRIALS) if asked.pilot else ("fresh", SEED, TRIALS)
    EXPERIMENT.conclude(play(asked.out / folder, seed, trials), publishes=asked.publish and not asked.pilot)


if __name__ == "__main__":
    main()
