"""The site of a board: one page with all tables, and for each submission its report and a page that replays episodes.

Every text of a submission is escaped where a page is made, and the pages' content security policy allows no script and
no source but themselves, so nothing that a stranger wrote can run. A submission's folder is named after the digest of
its bundle, never after what the bundle says.

The picture of a board: the mean of each submission against its tokens an episode, on a logarithmic scale.

It is made of numbers only, which the template writes into an SVG: no text of a stranger becomes markup.
"""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.board.submissions.bundle import Limits
from smartplay_tools.evaluation.board.submissions.check import NOT_PROVED, Checked, checking
from smartplay_tools.evaluation.board.submissions.check_report import report_json
from smartplay_tools.evaluation.board.submissions.submitted_plan import Allowed, by_cell
from smartplay_tools.evaluation.board.table import Board, Charges, make_board
from smartplay_tools.evaluation.costs.tariffs import charge_records, tariffs_of
from smartplay_tools.evaluation.pages import environment as template_environment
from smartplay_tools.evaluation.quantities import figure, short, typeset
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.records.rows import Row

WIDTH, HEIGHT = 520, 300
LEFT, RIGHT, TOP, BOTTOM = 48, 40, 14, 40
"""The edges of the plot; a point has a number, whose name is in the list below."""

STEPS, CLOSE_STEPS = (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7)
"""Ticks of a decade, and those of a picture that is narrower than one."""

COLOURS = 6
"""Colours of budgets; further ones begin again."""


@dataclass(frozen=True)
class Point:
    """A submission under one budget."""

    x: float
    y: float
    ends: tuple[float, float] | None
    """Where its interval begins and ends."""
    colour: int
    name: str
    words: str


@dataclass(frozen=True)
class Chart:
    """The places of points and ticks in an SVG of `WIDTH` times `HEIGHT`."""

    points: tuple[Point, ...]
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]


def make_chart(board: Board) -> Chart | None:
    """Return the picture of a board; None if fewer than two submissions have a mean."""
    entries = [(at, group, entry) for at, group in enumerate(board.classes) for entry in group.entries if entry.mean]
    if len(entries) < 2:
        return None
    low = math.log10(min(entry.tokens for _, _, entry in entries)) - 0.1
    high = math.log10(max(entry.tokens for _, _, entry in entries)) + 0.1

    def across(value: float) -> float:
        return round(LEFT + (math.log10(value) - low) / (high - low) * (WIDTH - LEFT - RIGHT), 1)

    tops = [entry.mean.mean if entry.mean.high is None else entry.mean.high for _, _, entry in entries if entry.mean]
    top = max(1.0, *tops)

    def up(value: float) -> float:
        return round(HEIGHT - BOTTOM - max(0.0, value) / top * (HEIGHT - TOP - BOTTOM), 1)

    points = []
    for at, group, entry in entries:
        mean = entry.mean
        assert mean is not None
        ends = None if mean.low is None or mean.high is None else (up(mean.low), up(mean.high))
        words = f"{mean.mean:.2f} with {entry.tokens:,.0f} tokens an episode, {group.name}"
        name = entry.submission.model_name
        points.append(Point(across(entry.tokens), up(mean.mean), ends, at % COLOURS, name, words))
    decades = range(math.floor(low), math.ceil(high) + 1)
    ticks = [step * 10.0**decade for decade in decades for step in (STEPS if high - low > 1 else CLOSE_STEPS)]
    return Chart(
        tuple(points),
        tuple((across(tick), short(tick)) for tick in ticks if low <= math.log10(tick) <= high),
        tuple((up(tick), f"{tick:.2g}") for tick in (0.0, 0.25, 0.5, 0.75, 1.0)),
    )


NAMES = (
    ("-v0", ""),
    ("BanditTwoArmed", "Bandit "),
    ("Fixed", ""),
    ("RockPaperScissor", "RPS "),
    ("Minedojo", "Minecraft "),
)


def short_name(game: str) -> str:
    """Return a game's id in fewer letters, for the head of a column."""
    for long, brief in NAMES:
        game = game.replace(long, brief)
    return game


REPLAYS = 1
"""Episodes of every game and budget that the replay page of a submission shows."""

CACHES = ("none", "openai-5-6", "anthropic-512", "vllm")
"""The rules of caches under which the table and the replay page say what episodes cost."""


def build_board(
    bundles: str | Path,
    out: str | Path,
    *,
    title: str = "Leaderboard",
    seeds: str | Path | None = None,
    allowed: Allowed | None = None,
    workers: int = 1,
    limits: Limits | None = None,
    replays: int = REPLAYS,
    on_checked: Callable[[Checked], None] | None = None,
) -> Board:
    """Check every bundle in a folder and write the site; return what it shows.

    Arguments:
        bundles: a folder with the zip files of submissions.
        out: the folder of the site; its page is `index.html`. Files of an earlier board are replaced.
        title: the page's title.
        seeds: the file of the seeds that the board has issued.
        allowed: what a replay may use in addition to what is always safe.
        workers: processes that replay records.
        limits: how much a bundle and its check may take.
        replays: episodes of every game and budget on a submission's replay page; 0 makes no such page.
        on_checked: called after each check.
    """
    folder, site = Path(bundles), Path(out)
    paths = sorted(folder.glob("*.zip"))
    if not paths:
        raise InvalidArgumentError(f"{folder} holds no bundle; submit prepare writes them as .zip files.")
    checked: dict[str, Checked] = {}
    charged: dict[str, Charges] = {}
    site.mkdir(parents=True, exist_ok=True)
    for path in paths:
        with checking(path, seeds=seeds, allowed=allowed, workers=workers, limits=limits) as (submitted, unpacked):
            place = submitted.sha256[:16]
            if place in checked:
                raise InvalidArgumentError(f"{path} is the same file as {checked[place].bundle}; remove one of them.")
            checked[place] = submitted
            charged[place] = _charges(submitted, unpacked, workers)
            _write_files(site / place, submitted, unpacked, replays)
        if on_checked is not None:
            on_checked(submitted)
    board = make_board(list(checked.items()), charged=charged, rules=CACHES)
    (site / "index.html").write_text(_page(board, title, replays), encoding="utf-8", newline="\n")
    (site / "board.css").write_bytes(resources.files(__package__).joinpath("static", "board.css").read_bytes())
    return board


def _charges(checked: Checked, unpacked: Path | None, workers: int) -> Charges:
    """What the episodes of a verified submission cost under the board's rules."""
    if not checked.verified or unpacked is None:
        return {}
    run = RunFolder(unpacked)
    records = {row["key"]: run.transcript(row["key"]) for row in checked.rows}
    return charge_records(records, tariffs_of(CACHES), run.manifest().prices, processes=max(1, workers))


def _write_files(place: Path, checked: Checked, unpacked: Path | None, replays: int) -> None:
    place.mkdir(parents=True, exist_ok=True)
    report = json.dumps(report_json(checked), indent=1) + "\n"
    (place / "report.json").write_text(report, encoding="ascii", newline="\n")
    if not (checked.verified and unpacked is not None and replays):
        return
    from smartplay_tools.evaluation.pages.report.page import write_report

    with tempfile.TemporaryDirectory() as folder:
        _pick(unpacked, Path(folder), checked.rows, replays)
        write_report(folder, place / "replays.html", title="Replays", episodes="1000", tariffs=tariffs_of(CACHES))


def _pick(unpacked: Path, folder: Path, rows: list[Row], replays: int) -> None:
    """Make the folder of a run with the first episodes of every cell, from records that were verified."""
    kept = [row for members in by_cell(rows).values() for row in members[:replays]]
    keys = {row["key"] for row in kept}
    manifest = RunFolder(unpacked).manifest()
    manifest = manifest.model_copy(update={"episodes": tuple(e for e in manifest.episodes if e.key in keys)})
    (folder / "episodes").mkdir()
    (folder / "manifest.json").write_text(json.dumps(manifest.to_json()), encoding="ascii", newline="\n")
    lines = "".join(json.dumps(row) + "\n" for row in kept)
    (folder / "results.jsonl").write_text(lines, encoding="ascii", newline="\n")
    for key in keys:
        shutil.copyfile(unpacked / "episodes" / f"{key}.jsonl", folder / "episodes" / f"{key}.jsonl")


def _page(board: Board, title: str, replays: int) -> str:
    environment = template_environment(__package__, "A board")
    environment.filters |= {
        "figure": figure,
        "short": short,
        "brief": short_name,
        "typeset": typeset,
    }
    return environment.get_template("board.html.j2").render(
        board=board,
        chart=make_chart(board),
        title=title,
        replays=replays,
        not_proved=NOT_PROVED,
        version=metadata.version("smartplay-tools"),
    )
