"""The assembly of the page from templates, styles, scripts and packed episodes.

A content security policy in the head of the file makes it safe: it allows only the styles and scripts of this package,
by their hashes, and pictures from the file itself; no network, no inline handlers and no forms.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import Any, Literal

from smartplay_tools.context.prompts.wording import known
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.comparison import compare
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.formats import TextTable
from smartplay_tools.evaluation.analysis.headline import headline
from smartplay_tools.evaluation.analysis.run_tables import further_tables
from smartplay_tools.evaluation.analysis.summary import RunSummary, summarize
from smartplay_tools.evaluation.analysis.window_tables import windows_table
from smartplay_tools.evaluation.analysis.windows import compare_windows
from smartplay_tools.evaluation.pages import environment as template_environment
from smartplay_tools.evaluation.pages.report.drawings import sheet
from smartplay_tools.evaluation.pages.report.episode_reading import ShownEpisode, json_text, pack, packs, read_episodes
from smartplay_tools.evaluation.pages.report.episodes import fixed_texts
from smartplay_tools.evaluation.pages.report.figures import figures
from smartplay_tools.evaluation.pages.report.sources import ShownRun, Source, Sources, find_runs, that_open_well
from smartplay_tools.evaluation.pages.report.threads import PARTS as THREAD_PARTS, shown_threads
from smartplay_tools.games.game_registry import importing_packages
from smartplay_tools.records.accounts import PARTS
from smartplay_tools.records.damage import DamageError, warn_damaged
from smartplay_tools.records.rows import Row, unplayed
from smartplay_tools.records.threads import thread_files
from smartplay_tools.types import MISTAKES
from smartplay_tools.types.arguments import well_formed
from smartplay_tools.types.quantities import figure, typeset

__all__ = ["render_report", "write_episode", "write_report"]

SCRIPTS = (
    *("basics.js", "prompts.js", "charts.js", "parts.js", "window.js", "thread.js", "worlds.js", "drawings.js"),
    *("live.js", "episode.js", "turn.js", "snapshot.js", "why.js", "search.js", "player.js", "page.js"),
)
"""The page's scripts, in the order of their dependencies."""

LISTED = ("key", "run", "game", "player", "seed", "status")
"""The facts about an episode that the page needs before it is unpacked."""

LISTED_AT_ONCE = 200
"""The most episodes that the list shows before a reader asks for all: a browser takes long to lay out a thousand."""


def write_report(
    run: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    title: str | None = None,
    plugins: bool = False,
) -> Path:
    """Write the replay page of a run folder, a folder of transcripts or one transcript; return its path.

    Several runs become one page that compares them. A page of a very large run holds the first trials, with a warning.
    An existing file is replaced: a page can be made again, a record cannot. Games of installed packages, which records
    name, are imported for the drawings and figures only with `plugins`.
    """
    file = _html_file(out)
    page = render_report(run, title=title, plugins=plugins)
    return _write(file, page)


def write_episode(record: str | Path, out: str | Path, *, title: str | None = None, plugins: bool = False) -> Path:
    """Write the page of one episode by itself; return the page's path.

    It has neither header nor lists, so that it is small and can be embedded. The other arguments are those of
    `write_report`.
    """
    file, record = _html_file(out), Path(record)
    if not record.is_file():
        raise InvalidArgumentError(f"{record} is not the record of an episode; name a file of a run's episodes.")
    run = ShownRun(record, "", Sources([Source(well_formed(record.stem), record)]))
    with importing_packages(plugins):
        return _write(file, render_runs([run], title, plugins=plugins, opened="alone"))


def _html_file(out: str | Path) -> Path:
    if Path(out).suffix != ".html":
        raise InvalidArgumentError(f"The page is an HTML file, so its name has to end in .html, unlike {out}.")
    return Path(out)


def _write(file: Path, page: str) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    # A lone surrogate that a model wrote cannot be encoded in UTF-8; the packed record contains it nevertheless.
    file.write_text(page, encoding="utf-8", errors="replace", newline="\n")
    return file


def render_report(
    run: str | Path | Sequence[str | Path],
    *,
    title: str | None = None,
    plugins: bool = False,
    open_first: bool = False,
) -> str:
    """Return the replay page; with `open_first` it begins with its first episode."""
    if files := thread_files([Path(run)] if isinstance(run, str | Path) else [*map(Path, run)]):
        return render_threads(files, title or Path(files[0]).parent.resolve().name)
    with importing_packages(plugins):
        runs = that_open_well(find_runs([run] if isinstance(run, str | Path) else run))
        opened: Literal["first", "run"] = "first" if open_first else "run"
        return render_runs(runs, title, plugins=plugins, opened=opened)


def render_threads(files: Sequence[Path], title: str, site: Mapping[str, Any] | None = None) -> str:
    """Return the page of records of context managers; one that a site serves opens with its first thread."""
    shown, table = shown_threads(files)
    contents = {"title": title, "threads": table, **_packed(shown, THREAD_PARTS)}
    return _rendered(contents, site, "run" if site is None else "first")


def render_runs(
    runs: Sequence[ShownRun],
    title: str | None,
    *,
    plugins: bool,
    opened: Literal["run", "first", "alone"],
    site: Mapping[str, Any] | None = None,
) -> str:
    """Return the page of runs, which opens with their tables, their first episode, or only that.

    `site` is what the page knows of the site that serves it (`served`).
    """
    pages = [
        # Figures are drawn once, for all runs.
        _page_of_run(run, runs if run is runs[0] else (), plugins=plugins)
        for run in runs
    ]
    return _rendered(_contents(pages, title), site, opened)


def _rendered(contents: Mapping[str, Any], site: Mapping[str, Any] | None, opened: str) -> str:
    """Return the page of what the templates need, as it opens."""
    environment = template_environment(__package__, "The replay page")
    environment.filters |= {
        "number": number,
        "typeset": typeset,
        "mistakes": lambda result: sum(result[name] for name in MISTAKES),
    }
    scripts, style = [_static(name) for name in SCRIPTS], _static("page.css")
    shown = {
        "scripts": scripts,
        "style": style,
        "policy": _policy(style, scripts, is_served=site is not None),
        "open": contents["episodes"][0]["key"] if opened in ("first", "alone") else None,
        "site": None if site is None else json.dumps(site),
        "follows": bool(site and site.get("updates")),
        "alone": opened == "alone",
        "at_once": LISTED_AT_ONCE,
        "version": metadata.version("smartplay-tools"),
    }
    return environment.get_template("page.html.j2").render({"threads": None, **contents, **shown})


def _contents(pages: Sequence[_RunPage], title: str | None) -> dict[str, Any]:
    """Return the variables of the templates."""
    runs = [page.run for page in pages]
    shown = [episode for page in pages for episode in page.shown]
    names = [run.path.resolve().name.removesuffix(".jsonl") for run in runs]
    return {
        "title": title or " and ".join(names),
        "runs": [{"letter": run.letter, "name": name} for run, name in zip(runs, names, strict=True)],
        "comparison": list(_comparison(pages)),
        "results": [(page.run.letter, headline(page.summary)) for page in pages if page.summary.cells],
        "tables": [(page.run.letter, table) for page in pages for table in _tables(page)],
        **_packed(shown, PARTS),
        "figures": [figure for page in pages for figure in page.figures],
        "manifests": [(run.letter, _manifest(run)) for run in runs if run.sources.manifest],
        "warnings": [warning for page in pages for warning in (*page.damaged, *unplayed(page.rows))],
        "chosen": _chosen(runs),
        "waiting": sum(run.sources.waiting for run in runs),
    }


def _packed(shown: Sequence[ShownEpisode], part_words: Mapping[str, str]) -> dict[str, Any]:
    """Return what a page holds of its episodes: the facts that it lists, and all else, packed."""
    episodes = [episode.facts for episode in shown]
    packed = packs(shown)
    pack_of = {key: number for number, (keys, _) in enumerate(packed) for key in keys}
    index = {
        "words": {version: fixed_texts(version) for version in known()},
        "mistakes": MISTAKES,
        "partWords": part_words,
        "episodes": [
            {name: episode[name] for name in LISTED} | {"pack": pack_of[episode["key"]]} for episode in episodes
        ],
    }
    if any(episode["family"] == "crafter" for episode in episodes):
        index["textures"] = sheet()
    return {"episodes": episodes, "index": pack(json_text(index)), "packs": [pack for _, pack in packed]}


def _manifest(run: ShownRun) -> dict[str, Any]:
    """The manifest of a run, of its planned episodes those that the page holds: its size is not that of the run."""
    held = {source.key.partition(".")[0] for source in run.sources.episodes}
    planned = [episode for episode in run.sources.manifest["episodes"] if episode["key"] in held]
    return {**run.sources.manifest, "episodes": planned}


def _chosen(runs: Sequence[ShownRun]) -> dict[str, int] | None:
    """The number of episodes on the page, and of all; None if it holds all."""
    held = sum(len(run.sources.episodes) for run in runs)
    left_out = sum(len(run.sources.left_out) for run in runs)
    return {"held": held, "all": held + left_out} if left_out else None


@dataclass(frozen=True)
class _RunPage:
    """What a page says of one run."""

    run: ShownRun
    shown: Sequence[ShownEpisode]
    rows: Sequence[Row]
    summary: RunSummary
    figures: Sequence[Mapping[str, str]]
    damaged: Sequence[str]
    """A sentence for each record that is left out."""


def _page_of_run(run: ShownRun, drawing: Sequence[ShownRun], *, plugins: bool) -> _RunPage:
    drawn = list(figures(drawing))
    shown, damaged = read_episodes(run.sources.episodes, run.letter, plugins=plugins)
    if damaged and not shown:
        raise DamageError(damaged[0])
    for sentence in damaged:
        warn_damaged(sentence)
    rows = [episode.row for episode in shown if episode.row is not None]
    rows += [source.row for source in run.sources.left_out if source.row is not None]
    failures: Sequence[Row] | None = run.sources.failures
    if failures is None:
        facts = [episode.facts for episode in shown]
        failures = [_failed_row(each) for each in facts if each["status"] == "failed"]
    return _RunPage(run, shown, rows, summarize(rows, failures), drawn, damaged)


def _failed_row(episode: Mapping[str, Any]) -> Row:
    """The row of a failed attempt that is not part of a run."""
    reason = "exception" if episode["result"] is None else episode["result"]["end_reason"]
    return {"end_reason": reason, **{name: episode[name] for name in ("key", "game", "player", "error")}}


def _comparison(pages: Sequence[_RunPage]) -> Iterator[TextTable]:
    """The tables of several runs against each other; none where no two of them have a game in common."""
    rows = {str(page.run.path): page.rows for page in pages}
    if len(rows) > 1:
        with contextlib.suppress(InvalidArgumentError):
            yield from comparison_tables(compare(rows))


def _tables(page: _RunPage) -> Iterator[TextTable]:
    """The tables below the results, as `results --all` has them, and what windows cost."""
    comparisons = compare_windows(page.rows)
    if any(not comparison.is_reference for comparison in comparisons):
        yield windows_table(comparisons)
    yield from further_tables(page.rows, page.summary)


def _static(name: str) -> str:
    return resources.files(__package__).joinpath("static", name).read_text(encoding="utf-8")


def _policy(style: str, scripts: list[str], *, is_served: bool) -> str:
    """The content security policy: these scripts, this style, pictures from the file itself, and its server if any."""
    allowed = {"script-src": " ".join(map(_hash, scripts)), "style-src": _hash(style), "img-src": "data:"}
    if is_served:
        allowed["connect-src"] = "'self'"
    rest = {"default-src": "'none'", "base-uri": "'none'", "form-action": "'none'"}
    return "; ".join(f"{what} {source}" for what, source in {**rest, **allowed}.items())


def _hash(text: str) -> str:
    # The template inserts the text between tags unchanged, because the browser computes the hash of exactly that.
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"


def number(value: float | None, digits: int = 2) -> str:
    """Format a number for people: with separated thousands, without trailing zeros, and a dash for None."""
    text = figure(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text else text
