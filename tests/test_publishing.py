"""The files for installation, publishing and contributing exist, are valid, and name no invented addresses."""

from __future__ import annotations

import base64
import importlib.util
import json
import re
import sys
import tarfile
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import check_jsonschema
import pytest
from click.testing import CliRunner
from readme_renderer import markdown

from tests.processes import printed_by

ROOT = Path(__file__).parents[1]
if not (ROOT / ".ci").is_dir():
    pytest.skip("not in a checkout", allow_module_level=True)

PYPROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def script(name: str) -> ModuleType:
    """A script of `.ci` as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[^\w.-]", requirement)[0] for requirement in requirements}


# The demo's environment.

DEMO_WITHOUT = """
import sys
for name in sys.argv.pop().split(","):
    sys.modules[name] = None  # an import of it is now an ImportError
from smartplay_tools.cli import app
app()
"""


def test_the_demo_s_environment_holds_what_the_package_says_less_what_other_games_need():
    demo = script("demo_requirements")
    project = PYPROJECT["project"]
    wanted = names(demo.demo_requirements(ROOT / "pyproject.toml"))
    extras = (names(project["optional-dependencies"][extra]) for extra in demo.EXTRAS)
    needed = names(project["dependencies"]).union(*extras)
    assert wanted == names(PYPROJECT["build-system"]["requires"]) | (needed - set(demo.NOT_IN_THE_DEMO))
    assert set(demo.NOT_IN_THE_DEMO) <= needed


@pytest.mark.slow
def test_the_demo_plays_without_what_its_environment_leaves_out(tmp_path):
    left_out = [
        *(name.replace("-", "_") for name in script("demo_requirements").NOT_IN_THE_DEMO),
        "imageio",
        "opensimplex",
        "ruamel",
    ]
    command = [sys.executable, "-c", DEMO_WITHOUT, "demo", "--out", str(tmp_path), ",".join(left_out)]
    done = printed_by(*command)
    assert len(list(tmp_path.glob("*.jsonl"))) == 3
    assert (tmp_path / "demo.html").exists()
    assert "view --play any" in done


# A release.

CHANGELOG = """# Changelog

## {heading}

### Added

- Everything.

## 0.1.0 - 2026-01-31
"""

CITATION = "cff-version: 1.2.0\nversion: {version}\ndate-released: {date}\n"


def release(folder: Path, heading: str, *, cited: str = "0.2.0", date: str = "2026-03-01") -> list[str]:
    """The problems of releasing 0.2.0 with a changelog that begins with this heading."""
    (folder / "pyproject.toml").write_text('[project]\nversion = "0.2.0"\n')
    (folder / "CHANGELOG.md").write_text(CHANGELOG.format(heading=heading))
    (folder / "CITATION.cff").write_text(CITATION.format(version=cited, date=date))
    remedies: list[str] = script("changelog").problems(folder)
    return remedies


@pytest.mark.parametrize("heading", ["0.2.0 - 2026-03-01", "0.2.0: pictures - 2026-03-01"])
def test_a_release_with_one_date_in_both_files_may_go(tmp_path, heading):
    assert release(tmp_path, heading) == []


@pytest.mark.parametrize(
    ("heading", "settings", "remedy"),
    [
        ("Unreleased", {}, "make '## Unreleased' '## 0.2.0 - 20"),
        ("Unreleased - 2026-03-01", {}, "make '## Unreleased'"),
        ("0.2.0", {}, "does not say when 0.2.0 is released"),
        ("0.2.0 - soon", {}, "does not say when 0.2.0 is released"),
        ("0.2.0 - 2026-02-30", {}, "does not say when 0.2.0 is released"),
        ("0.3.0 - 2026-03-01", {}, "no section for 0.2.0"),
        ("0.2.0 - 2026-03-01", {"cited": "0.1.0"}, "CITATION.cff is of version 0.1.0"),
        ("0.2.0 - 2026-03-01", {"date": "2026-03-02"}, "write 'date-released: 2026-03-01'"),
    ],
)
def test_a_release_without_its_date_is_refused_with_the_remedy(tmp_path, heading, settings, remedy):
    assert remedy in " ".join(release(tmp_path, heading, **settings))


def test_the_citation_is_of_this_version():
    fields = dict(script("changelog").FIELD.findall((ROOT / "CITATION.cff").read_text(encoding="utf-8")))
    assert fields["version"] == PYPROJECT["project"]["version"]


def test_the_entry_of_the_mcp_registry_is_of_this_version_and_starts_the_server():
    entry = json.loads((ROOT / "hub" / "mcp" / "server.json").read_text(encoding="utf-8"))
    (package,) = entry["packages"]
    version = PYPROJECT["project"]["version"]
    assert (entry["version"], package["version"], package["identifier"]) == (version, version, "smartplay-tools")
    assert len(entry["description"]) <= 100  # as the registry's schema demands, and the next line too
    assert re.fullmatch(r"[a-zA-Z0-9.-]+/[a-zA-Z0-9._-]+", entry["name"])
    command = [argument.get("value") or argument["default"] for argument in package["packageArguments"]]
    assert command == ["serve", "mcp", "Hanoi3Disk-v0", "0"]
    assert package["packageArguments"][3]["name"] == "--seed"


def test_the_install_links_hold_the_configuration_of_their_page():
    page = (ROOT / "docs" / "mcp.md").read_text(encoding="utf-8")
    (shown,) = (json.loads(line) for line in page.splitlines() if line.startswith('{"mcpServers"'))
    (cursor,) = re.findall(r"^cursor:\S+", page, flags=re.MULTILINE)
    (code,) = re.findall(r"^vscode:mcp/install\?(\S+)", page, flags=re.MULTILINE)
    parameters = parse_qs(urlsplit(cursor).query)
    configuration = json.loads(base64.b64decode(parameters["config"][0]))
    assert {parameters["name"][0]: configuration} == shown["mcpServers"]
    assert json.loads(unquote(code)) == {"name": "smartplay", **configuration}


@pytest.mark.parametrize("hub", ["openenv", "verifiers"])
def test_the_packages_for_hubs_are_of_this_version_and_install_this_package(hub):
    package = tomllib.loads((ROOT / "hub" / hub / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert package["version"] == PYPROJECT["project"]["version"]
    assert f"smartplay-tools[{hub}]" in package["dependencies"]


# The page on the package index.


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution, built here without the network."""
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--sdist", "--no-isolation", "--outdir", str(out), str(ROOT)]
    printed_by(*command)
    (file,) = out.iterdir()
    return file


def described(sdist: Path) -> tuple[str, str]:
    """Its metadata: the fields, and the description."""
    with tarfile.open(sdist) as archive:
        file = archive.extractfile(f"{sdist.name.removesuffix('.tar.gz')}/PKG-INFO")
        assert file is not None
        fields, _, text = file.read().decode().partition("\n\n")
    return fields, text


def code_blocks(text: str) -> list[str]:
    return re.findall(r"^```.*?^```$", text, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_the_package_index_takes_what_is_built(sdist):
    command = [sys.executable, "-m", "twine", "check", "--strict", str(sdist)]
    printed_by(*command)
    fields, _ = described(sdist)
    assert "Description-Content-Type: text/markdown" in fields
    assert "License-Expression: MIT" in fields


@pytest.mark.slow
def test_the_readme_on_the_package_index_is_the_readme_with_no_link_that_leads_nowhere(sdist):
    _, text = described(sdist)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rendered = markdown.render(text)
    assert rendered is not None
    targets = re.findall(r'(?:href|src)="([^"]*)"', rendered)
    assert targets
    assert [target for target in targets if not target.startswith(("https://", "#"))] == []
    assert code_blocks(text) == code_blocks(readme)
    linked = re.findall(r"(?<!!)\[([^\]]+)\]\((?!https?:)", readme)
    assert [words for words in linked if words not in text] == []


# The files that other programs read.

SCHEMAS = {
    "CITATION.cff": "vendor.citation-file-format",
    ".readthedocs.yaml": "vendor.readthedocs",
    ".github/ISSUE_TEMPLATE/config.yml": "vendor.github-issue-config",
    ".github/ISSUE_TEMPLATE/bug.yml": "vendor.github-issue-forms",
    ".github/ISSUE_TEMPLATE/feature.yml": "vendor.github-issue-forms",
    ".github/ISSUE_TEMPLATE/fidelity.yml": "vendor.github-issue-forms",
    ".github/dependabot.yml": "vendor.dependabot",
    ".github/workflows/checks.yml": "vendor.github-workflows",
}


def is_valid(schema: str, file: Path) -> bool:
    """Validated with a schema from the package `check-jsonschema`, without a network."""
    checked = CliRunner().invoke(check_jsonschema.main, ["--builtin-schema", schema, str(file)])
    return checked.exit_code == 0


@pytest.mark.parametrize(("file", "schema"), SCHEMAS.items())
def test_each_file_is_what_its_schema_says(file, schema):
    assert is_valid(schema, ROOT / file)


def test_actions_are_named_by_their_commit():
    workflow = (ROOT / ".github/workflows/checks.yml").read_text(encoding="utf-8")
    used = re.findall(r"uses: (\S+)", workflow)
    assert used
    assert [action for action in used if not re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action)] == []


# Nothing is invented.

ALLOWED_ADDRESSES = (
    "https://arxiv.org/abs/2310.01557",
    "https://cosmic-ray.readthedocs.io",
    "https://keepachangelog.com",
    "https://semver.org",
)
"""Addresses that these files may name: the paper, and the two conventions that the changelog follows."""

PUBLIC = (
    "CHANGELOG.md",
    "CITATION.cff",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "README.md",
    "SECURITY.md",
    "docs/stability.md",
    "pyproject.toml",
    ".pre-commit-config.yaml",
    ".readthedocs.yaml",
    *(path.relative_to(ROOT).as_posix() for path in sorted((ROOT / ".github").rglob("*.*"))),
)


@pytest.mark.parametrize("file", PUBLIC)
def test_no_address_is_invented(file):
    text = (ROOT / file).read_text(encoding="utf-8")
    addresses = {address.rstrip(".,") for address in re.findall(r"https?://[\w./~%-]+", text)}
    assert addresses <= set(ALLOWED_ADDRESSES)
    assert re.findall(r"[\w.+-]+@[\w-]+\.[a-z]{2,}\b", text) == []
