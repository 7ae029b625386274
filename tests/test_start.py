"""A fast start: only what is used is imported; `benchmarks/startup.py` measures it."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

import smartplay_tools as sp
from smartplay_tools import cli
from smartplay_tools.installation import install_command
from tests import core_alone
from tests.processes import printed_by

PACKAGE = Path(sp.__file__).parent
HEAVY = (
    "asyncio",
    "crafter",
    "gymnasium",
    "matplotlib",
    "numpy",
    "openai",
    "opensimplex",
    "PIL",
    "pydantic",
    "rich",
    "scipy",
    "smartplay_tools.evaluation",
    "tiktoken",
    "typer",
)
ROOTS = (PACKAGE.parent, PACKAGE.parent / "adapters")
LAZY = sorted(
    ".".join(path.parent.relative_to(root).parts)
    for root in ROOTS
    for path in root.glob("smartplay_*/**/__init__.py")
    if "lazy_exports(" in path.read_text(encoding="utf-8")
)
"""Packages that import their names when they are first used."""


def loaded(code: str) -> set[str]:
    """Which of the heavy modules a process has imported after running some code."""
    script = f"import sys\n{code}\nprint(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stderr.split())


def command(*arguments: str) -> str:
    return f"from smartplay_tools.cli import app\ntry: app({list(arguments)})\nexcept SystemExit: pass"


class TestWhatIsNotImported:
    def test_by_the_settings_and_a_budget(self):
        settings = (
            "import smartplay_tools as sp; sp.GAMES['Crafter-v0'].count_actions(); assert 'pydantic' not in sys.modules"
        )
        assert loaded(f"{settings}; sp.Budget(prompt_tokens=700)") == {"pydantic"}

    @pytest.mark.slow
    def test_by_an_episode_before_it_is_made(self):
        assert loaded("from smartplay_tools import Episode").isdisjoint({"numpy", "gymnasium", "typer", "tiktoken"})

    @pytest.mark.slow
    def test_by_the_help(self):
        assert loaded(command("--help")) <= {"typer", "rich"}

    @pytest.mark.slow
    def test_by_the_list_of_games(self):
        # typer itself takes pydantic for its options
        assert loaded(command("games")) <= {"typer", "rich", "pydantic"}

    def test_by_an_mcp_server_that_says_what_it_is(self):
        code = (
            "import asyncio\n"
            "from smartplay_tools.web import HostedEpisode\n"
            "from smartplay_tools.web.mcp import respond\n"
            "asked = {'jsonrpc': '2.0', 'id': 1, 'method': 'initialize', 'params': {'protocolVersion': '2025-11-25'}}\n"
            "assert 'result' in asyncio.run(respond(HostedEpisode(lambda: 1 / 0), asked))"
        )
        assert loaded(code) == {"asyncio"}


class TestGymnasium:
    @pytest.mark.parametrize(
        "code",
        [
            "import smartplay_tools, gymnasium",
            pytest.param("import gymnasium, smartplay_tools", marks=pytest.mark.slow),
        ],
    )
    def test_knows_the_settings_whichever_is_imported_first(self, code):
        show = "print(gymnasium.make('smartplay/Hanoi3Disk-v0').spec.max_episode_steps, gymnasium.__loader__)"
        done = printed_by(sys.executable, "-c", f"{code}\n{show}")
        assert done.startswith("30 <_frozen_importlib_external.SourceFileLoader")

    @pytest.mark.slow
    def test_that_was_looked_for_before_it_was_imported_knows_the_settings(self):
        """Programs ask `find_spec` whether an optional package is installed."""
        script = (
            "import importlib.util, sys, smartplay_tools\n"
            "finders = len(sys.meta_path)\n"
            "for _ in range(2): assert importlib.util.find_spec('gymnasium').name == 'gymnasium'\n"
            "import gymnasium; assert gymnasium.make('smartplay/Hanoi3Disk-v0').spec.max_episode_steps == 30\n"
            "assert len(sys.meta_path) == finders - 1"
        )
        printed_by(sys.executable, "-c", script)

    @pytest.mark.slow
    def test_whose_first_import_fails_knows_the_settings_after_the_second(self, tmp_path):
        (tmp_path / "numpy.py").write_text("raise ImportError('broken')", encoding="utf-8")
        script = (
            "import sys, smartplay_tools\n"
            f"sys.path.insert(0, {str(tmp_path)!r})\n"
            "try: import gymnasium\n"
            "except ImportError: sys.path.pop(0)\n"
            "import gymnasium; gymnasium.make('smartplay/Hanoi3Disk-v0')"
        )
        printed_by(sys.executable, "-c", script)

    def test_that_cannot_be_imported_is_reported_as_such(self):
        script = "import sys, smartplay_tools; sys.path[:] = []; import gymnasium"
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
        assert "ModuleNotFoundError: No module named 'gymnasium'" in done.stderr


class TestLateNames:
    @pytest.mark.parametrize("package", LAZY)
    def test_the_names_are_those_that_type_checkers_read(self, package):
        module = importlib.import_module(package)
        tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
        branches = (node for node in tree.body if isinstance(node, ast.If))
        (guarded,) = (node for node in branches if isinstance(node.test, ast.Name))
        imports = (node for node in guarded.body if isinstance(node, ast.ImportFrom))
        assert {alias.asname for node in imports for alias in node.names} == set(module.__all__)
        assert set(module.__all__) <= set(dir(module))


class TestCommands:
    def test_a_summary_is_the_first_line_of_the_command(self):
        commands = get_command(cli.app).commands
        for name, entry in cli.COMMANDS.items():
            assert commands[name].help.partition("\n")[0] == entry.summary, name

    @pytest.mark.slow
    def test_without_any_extra_a_command_works_or_says_which_extra_it_needs(self, tmp_path):
        done = printed_by(sys.executable, core_alone.__file__, tmp_path)
        ends = json.loads(done)
        assert {end["command"][0] for end in ends} == set(cli.COMMANDS)
        needs = {}
        for end in ends:
            name, _, hint = end["error"].partition("needs an optional dependency: ")
            assert end["code"] == (2 if hint else 0), end
            if hint:
                assert name.startswith("smartplay-tools: "), end
                needs[" ".join(end["command"][:2])] = extra = hint.partition("[")[2].partition("]")[0]
                assert hint.strip() == install_command(extra)
        assert needs == {
            "agent Hanoi3Disk-v0": "serve",
            "report run": "evaluation",
            "view --play": "view",
            "view run": "view",
            "serve openai": "serve",
            "serve mcp": "mcp",
            "serve window": "serve",
        }

    @pytest.mark.parametrize(
        ("origin", "receipt", "command"),
        [
            (None, None, '-m pip install "smartplay-tools[view]"'),
            ({"url": "file:///co", "dir_info": {}}, None, '-m pip install "/co[view]"'),
            ({"url": "file:///a%20b", "dir_info": {"editable": True}}, None, '-m pip install --editable "/a b[view]"'),
            (
                {"url": "https://host/co", "vcs_info": {"vcs": "git"}},
                None,
                '-m pip install "smartplay-tools[view] @ git+https://host/co"',
            ),
            (
                {"url": "file:///co", "dir_info": {}},
                '[tool]\nrequirements = [{ name = "smartplay-tools", extras = ["openai"] }]',
                'uv tool install --force "/co[openai,view]"',
            ),
        ],
        ids=["index", "folder", "editable", "git", "uv tool"],
    )
    def test_a_hint_installs_the_package_from_where_it_came(self, tmp_path, monkeypatch, origin, receipt, command):
        described = tmp_path / "smartplay_tools-1.dist-info"
        described.mkdir()
        (described / "METADATA").write_text("Name: smartplay-tools\n")
        if origin is not None:
            (described / "direct_url.json").write_text(json.dumps(origin))
        if receipt is not None:
            (tmp_path / "uv-receipt.toml").write_text(receipt)
            monkeypatch.setattr(sys, "prefix", str(tmp_path))
        monkeypatch.syspath_prepend(tmp_path)
        assert install_command("view").removeprefix(f"{sys.executable} ") == command
