"""What a record names outside of itself: nothing is opened, imported or asked for because a record says so."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.episode.config import EpisodeConfig, Setting
from smartplay_tools.errors import TranscriptError
from smartplay_tools.evaluation.pages.report.drawings import draw
from smartplay_tools.evaluation.run_folder.folder import Manifest
from smartplay_tools.records import Record
from smartplay_tools.records.accounts import Accounts
from smartplay_tools.records.replays import recorded_pictures
from smartplay_tools.records.requests import requests_of
from smartplay_tools.records.rows import row_of
from smartplay_tools.transcript.hashing import chained_lines
from smartplay_tools.types import Budget

PAGE = Path(__file__).parents[1] / "docs" / "records.md"
MESSENGER = "MessengerL1-v0"


def texts(model: type[BaseModel], within: str = "") -> Iterator[str]:
    """Every field of a model that can hold any text, or a mapping with any text."""
    for name, field in model.model_fields.items():
        for text in ("beacon", {"beacon": "beacon"}):
            try:
                TypeAdapter(field.annotation).validate_python(text)
            except ValidationError:
                continue
            yield f"{within}{name}"
            break


def named_in_the_code() -> set[str]:
    parts = [
        *texts(EpisodeConfig),
        *texts(Setting, "setting."),
        *texts(Budget, "budget."),
        *texts(Manifest, "manifest."),
    ]
    places = {place for spec in sp.GAMES.values() for place in spec.load().places}
    return {*parts, *(f"options.{place}" for place in places), "picture.sha256"}


def test_the_list_of_the_documentation_is_that_of_the_code() -> None:
    table = PAGE.read_text(encoding="utf-8").partition("| a value of a record |")[2].partition("\n\n")[0]
    listed = set(re.findall(r"`([\w.]+)`", " ".join(line.split("|")[1] for line in table.splitlines()[2:])))
    assert listed == named_in_the_code() | {"player_options.base_url", "player_options.compactor_player"}


@pytest.fixture(scope="module")
def played() -> list[Any]:
    events: list[Any] = []
    with sp.Episode(MESSENGER, seed=1, transcript=events) as episode:
        sp.play(episode, sp.get_player("rule"))
    return events


def changed(events: list[Any], field: str, value: Any) -> list[Any]:
    """A consistent record whose config has another value."""
    copies = [{k: v for k, v in event.items() if k != "chain"} for event in json.loads(json.dumps(events))]
    *path, last = field.split(".")
    for config in (copies[0]["config"], *([copies[0]] if path == ["budget"] else [])):
        for name in path:
            config = config.setdefault(name, {})
        config[last] = value
    return [json.loads(line) for line in chained_lines(copies, "")[0].splitlines()]


READERS: dict[str, Callable[[list[Any]], object]] = {
    "replay": sp.replay,
    "replay with its compactor": lambda events: sp.replay(events, calls_compactor=True),
    "resume": lambda events: sp.resume(events, transcript=[]),
    "fork": lambda events: sp.fork(events, 1),
    "pictures": recorded_pictures,
    "requests": lambda events: requests_of(Record(events)),
    "prompts": lambda events: Record(events).answered,
    "accounts": lambda events: Accounts.of(Record(events)),
    "row": lambda events: row_of(Record(events), 0),
    "drawing": lambda events: draw(Record(events)),
}

ASKED: list[str] = []
IS_WATCHED: list[bool] = []


def watch(event: str, given: tuple[Any, ...]) -> None:
    """What the interpreter opens, imports, starts or connects to, while a reader is watched."""
    outward = event.startswith(("socket.connect", "socket.getaddrinfo", "subprocess", "os.system"))
    if IS_WATCHED and (outward or (event in ("open", "import", "os.listdir", "os.scandir") and "beacon" in str(given))):
        ASKED.append(f"{event} {given[:1]}")


sys.addaudithook(watch)


@pytest.mark.parametrize("reader", READERS)
def test_no_reader_opens_what_a_record_names(reader: str, played: list[Any], tmp_path: Path) -> None:
    (tmp_path / "beacon.py").write_text("raise SystemExit('imported')\n")
    (tmp_path / "tokenizer.json").write_text("{}")
    (tmp_path / "text_test.json").write_text("{}")
    forms = (f"{tmp_path}/beacon.py:SPEC", f"hf:{tmp_path}", "hf:beacon/beacon", str(tmp_path), ["a"], {"beacon": 1})
    fields = {*texts(EpisodeConfig), *texts(Setting, "setting."), "budget.strategy", "options.texts", "options.history"}
    for field in sorted({*fields, "player_options.base_url", "player_options.compactor_player"}):
        for form in forms:
            record = changed(played, field, form)
            IS_WATCHED.append(True)
            try:
                READERS[reader](record)
            except sp.SmartPlayError:
                pass  # a sentence; anything else fails the test
            finally:
                IS_WATCHED.clear()
            assert ASKED == [], f"{field}={form!r}"


def test_a_picture_s_name_in_an_older_record_is_no_path(tmp_path: Path) -> None:
    events: list[Any] = []
    with sp.Episode("Crafter-v0", seed=1, observation="picture", transcript=events) as episode:
        sp.play(
            episode, sp.get_player("random"), on_prompt=lambda talk, _: talk.episode.stats.steps and episode.close()
        )
    older = changed(events, "player", "random")
    del older[0]["pictures"]  # its pictures keep their names, since they were of PNG files
    for event in older:
        if "picture" in event.get("data", ()):
            event["data"]["picture"]["sha256"] = "../../beacon"
    with pytest.raises(TranscriptError, match=r"whose name is not a sha256: '../../beacon'"):
        recorded_pictures(older)


def test_no_command_imports_the_game_that_a_run_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sp.evaluate(["Hanoi3Disk-v0"], ["rule", "random"], out="run", executor="inline", trials=2)
    Path("beacon.py").write_text("raise SystemExit('imported')\n")
    for path in (*Path("run").glob("*.json*"), *Path("run").glob("episodes/*.jsonl")):
        path.write_text(path.read_text().replace("Hanoi3Disk-v0", "beacon.py:SPEC"))
    for command in (
        "results run",
        "results run --all",
        "compare run --margin 0.1h",
        "replay run",
        "cost run --cache none",
    ):
        IS_WATCHED.append(True)
        done = CliRunner().invoke(app, command.split())
        IS_WATCHED.clear()
        assert (ASKED, done.exit_code in (0, 1, 2, 3)) == ([], True), f"{command}: {done.output}"
