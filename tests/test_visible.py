"""Text that is not ours: whatever shows it, its control characters are written out."""

from __future__ import annotations

import ast
import io
import json
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.errors import SmartPlayWarning, UnknownNameError
from smartplay_tools.evaluation.analysis.figures.capability_dots import capability_dots
from smartplay_tools.evaluation.analysis.figures.prompt_figures import prompt_rows
from smartplay_tools.evaluation.analysis.figures.run import write_figures
from smartplay_tools.evaluation.analysis.figures.style import save_figure
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, to_html, to_latex, to_markdown
from smartplay_tools.evaluation.pages import environment
from smartplay_tools.evaluation.pages.report.page import render_report
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.players.human.screen import Screen
from smartplay_tools.records import Record
from smartplay_tools.terminal import Console
from smartplay_tools.visible import logger, visible
from tests.data.foreign import HOSTILE
from tests.test_architecture import PACKAGE, ROOT, modules, tree

SHOWN = r"\x1b]0;owned\x07 \x00\x08\x0d\x7f\x9b2J \u202etxt\u2069 [/red] $x^$ \ud83d"
HIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
STYLE = re.compile(r"\x1b\[[\d;]*m")
"""A colour, the only sequence that a terminal gets from a command that prints."""

FILE = Path(__file__).parent / "data" / "foreign.py"
ODD = "\x1b]0;owned\x9b.jsonl"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (HOSTILE, SHOWN),
        ("two\nlines\tand \u2603 \U0001f600 stay", "two\nlines\tand \u2603 \U0001f600 stay"),
        ("\x1f \x20\x7e\x7f \x80\x9f\xa0", "\\x1f \x20\x7e\\x7f \\x80\\x9f\xa0"),
        ("\u200f\u061c", r"\u200f\u061c"),
    ],
)
def test_what_is_written_out(text: str, shown: str):
    assert visible(text) == shown
    assert visible(shown) == shown


def test_errors_warnings_and_logs(caplog: pytest.LogCaptureFixture):
    assert str(sp.InvalidArgumentError(HOSTILE)) == SHOWN
    assert str(UnknownNameError("game", "x", [], HOSTILE)).endswith(SHOWN)
    with pytest.warns(SmartPlayWarning) as caught:
        warnings.warn(HOSTILE, SmartPlayWarning, stacklevel=1)
    assert SHOWN in warnings.formatwarning(caught[0].message, caught[0].category, "f", 1)
    logger("smartplay_tools.evaluation").warning("%s failed: %d", HOSTILE, 3)
    assert caplog.messages == [f"{SHOWN} failed: 3"]


def test_tables_and_pages():
    table = TextTable(HOSTILE, (Column(HOSTILE, words=True),), ((HOSTILE,),), (HOSTILE,))
    template = environment("smartplay_tools.web.site", "A page").from_string("{{ a }}{{ a ~ '<b>'|safe }}")
    shown = [to_markdown(table), to_latex(table), to_html([table]), template.render(a=HOSTILE)]
    for text in shown:
        assert "owned" in text
        assert not HIDDEN.search(text)


@pytest.fixture(scope="module")
def hostile_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stranger's folder, whose player and game have the worst names."""
    folder = tmp_path_factory.mktemp("hostile")
    sp.evaluate(
        ["Hanoi3Disk-v0", "BanditTwoArmedDeterministicFixed-v0"],
        ["rule", "random"],
        out=folder / "run",
        budgets=[sp.Budget(prompt_tokens=cap, slack=slack) for cap, slack in ((500, 0), (500, 0.5), (900, 0))],
        trials=2,
        executor="inline",
    )
    name = json.dumps(HOSTILE)[1:-1]
    for file in (folder / "run").rglob("*.json*"):
        file.write_text(file.read_text("ascii").replace('"rule"', f'"ru{name}"'), "ascii")
    return folder / "run"


@pytest.mark.parametrize(
    "command", ["results", "results --all", "results --format markdown", "results --format latex", "cost"]
)
@pytest.mark.filterwarnings("ignore::smartplay_tools.errors.SmartPlayWarning")
def test_a_strangers_folder_on_a_terminal(command: str, hostile_run: Path, monkeypatch: pytest.MonkeyPatch):
    assert_shown(f"{command} {hostile_run}", monkeypatch)


@pytest.mark.parametrize(
    "command",
    [
        f"play {FILE}:SPEC --player {FILE}:Speaking",
        f"play {FILE}:SPEC --player {FILE}:Failing",
        f"replay {ODD}",
        f"eval --games {FILE}:SPEC --players {FILE}:Failing --executor inline --out run",
    ],
)
def test_what_models_servers_and_games_say_on_a_terminal(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with sp.Episode("Hanoi3Disk-v0", seed=1, transcript=ODD) as episode:
        sp.play(episode, sp.get_player("rule"))
    assert_shown(command, monkeypatch)


def assert_shown(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if not command.startswith("eval"):  # it moves the cursor, as other commands do not
        monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    done = CliRunner().invoke(app, command.split())
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    printed = STYLE.sub("", done.output)
    assert "owned" in printed
    assert not HIDDEN.search(printed)


def test_what_a_person_sees():
    printed = io.StringIO()
    console = Console(file=printed, force_terminal=True, width=200)
    screen = Screen(console, is_answered_by_a_terminal=False)
    episode = sp.Episode("Hanoi3Disk-v0", seed=1)
    prompt = sp.Conversation(episode, head=[{"role": "user", "content": HOSTILE}]).prompt()
    assert prompt is not None
    with screen.showing(prompt, [HOSTILE], None):
        screen.tell(HOSTILE)
    assert printed.getvalue().count("\\x07") >= 3
    assert not HIDDEN.search(STYLE.sub("", printed.getvalue()))


@pytest.mark.filterwarnings("ignore::smartplay_tools.errors.SmartPlayWarning")
def test_figures_of_a_strangers_folder(hostile_run: Path, tmp_path: Path):
    rows = RunFolder(hostile_run).rows()
    written = write_figures(rows, tmp_path, formats=["svg"], svg_text=True)
    drawn = {path.stem: path.read_text("utf-8") for path in written}
    assert drawn.keys() == {"score-against-prompt-tokens", "frontier"}
    name = "\x1bowned\ud83d$"
    dots = capability_dots({HOSTILE: {game: [0.5] for game in sp.GAMES}})
    record = Record.read(next((hostile_run / "episodes").rglob("*.jsonl")))
    for stem, figure in {"capabilities": dots, "rows": prompt_rows([(name, record, 2)])}.items():
        drawn[stem] = save_figure(figure, tmp_path / stem, formats=["svg"], svg_text=True)[0].read_text("utf-8")
    for stem, text in drawn.items():
        assert "owned" in text, stem
        assert not HIDDEN.search(text), stem


@pytest.mark.filterwarnings("ignore::smartplay_tools.errors.SmartPlayWarning")
def test_the_page_of_a_strangers_folder(hostile_run: Path):
    page = render_report(hostile_run)
    assert "owned" in page
    assert not HIDDEN.search(page)


PASSING_BY = {
    "rich.console": {"Console"},
    "rich.text": {"Text"},
    "rich": {"print", "get_console", "inspect", "print_json"},
    "html": {"escape"},
    "logging": {"getLogger", "basicConfig", "warning", "error", "info"},
    "typer": {"echo", "secho"},
    "click": {"echo", "secho"},
    "sys": {"__stdout__", "__stderr__"},
    "jinja2": {"Template"},
}
"""What shows text as it is. `visible.py` and `terminal.py` are there to be used in its place."""


def shown_unseen(parts: list[ast.AST], *, is_command: bool) -> Iterator[str]:
    """What in a module shows text that has not been made visible."""
    bytes_of = [node.value for node in parts if isinstance(node, ast.Attribute) and node.attr in ("buffer", "flush")]
    for node in parts:
        if isinstance(node, ast.ImportFrom):
            names = PASSING_BY.get(node.module or "", set()) & {alias.name for alias in node.names}
            yield from (f"{node.module}.{name}" for name in names)
        elif isinstance(node, ast.Attribute):
            if any(node.attr in names and ast.unparse(node.value) == of for of, names in PASSING_BY.items()):
                yield ast.unparse(node)
            elif node.attr in ("stdout", "stderr") and not is_command and node not in bytes_of:
                yield from {ast.unparse(node)} & {"sys.stdout", "sys.stderr"}
        elif isinstance(node, ast.Name) and node.id == "print" and not is_command:
            yield "print"


def test_nothing_passes_by():
    """Commands print to streams that `cli` has made visible, and programs of their own (`__main__`) to their caller."""
    for path in [*modules(), *sorted((ROOT / "adapters").rglob("*.py"))]:
        if path in (PACKAGE / "visible.py", PACKAGE / "terminal.py", PACKAGE / "streams.py"):
            continue
        conditions = [ast.unparse(node.test) for node in tree(path).body if isinstance(node, ast.If)]
        is_program = "__name__ == '__main__'" in conditions
        found = [*shown_unseen([*ast.walk(tree(path))], is_command=path.is_relative_to(PACKAGE / "cli") or is_program)]
        assert not found, f"{path.relative_to(ROOT)} shows text by {found}: use smartplay_tools.visible or .terminal"
