"""What commit 4e66544b wrote is read, replayed, continued, reported and verified by every later version.

`tests/data/first_layout` holds the files and says how they were made. The tests use public names and commands alone, so
that they hold wherever a module moves.
"""

from __future__ import annotations

import json
import re
import shutil
import tarfile
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.records import Record, recorded_pictures, sent_prompts

DATA = Path(__file__).parent / "data" / "first_layout"
TABLES = Path(__file__).parent / "data" / "tables.txt"
PUBLISHED = Path(__file__).parents[1] / "experiments" / "tools-v1"
BANDIT = "BanditTwoArmedHighLowFixed-v0"
PLAYED = ("tools", "paper", "host-chat", "host-context", "oracle", "messenger", "continued")
STRATEGIES = ("masking", "summaries", "notes", "recall", "offload", "memory")
PICTURES = ("pictures", "only-pictures", "asked-picture")
NOT_COMPARED = "Pictures are not compared, because the record has digests of PNG files and not of pixels."
STRATEGY = "newest_two.py:NewestTwo"


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    """The files; no test changes them."""
    folder = tmp_path_factory.mktemp("first_layout")
    with tarfile.open(DATA / "first_layout.tar.xz") as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.4 and later
        archive.extractall(folder)
    return folder


@pytest.fixture
def files(unpacked, monkeypatch) -> Path:
    """The folder with the files, as the current one: records name the strategy and the agent by relative paths."""
    monkeypatch.chdir(unpacked)
    return unpacked


@pytest.fixture
def copied(unpacked, tmp_path, monkeypatch) -> Path:
    """A copy for tests that write, as the current folder."""
    folder = tmp_path / "first_layout"
    shutil.copytree(unpacked, folder)
    monkeypatch.chdir(folder)
    return folder


def run(*words: str | Path, code: int = 0) -> Result:
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == code, result.output
    return result


def test_every_table_says_what_it_said(files):
    """Each command in the file prints what is below it: every number and every word.

    After a change that is meant, what a command prints is put into the file.
    """
    _, *tables = re.split(r"^\$ smartplay-tools (.*)\n", TABLES.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for command, printed in zip(tables[::2], tables[1::2], strict=True):
        shown = run(*command.replace("tools-v1", str(PUBLISHED)).split()).output.replace(str(PUBLISHED), "tools-v1")
        assert re.sub(r"\d+\.\d{6,}", lambda number: f"{float(number[0]):.6g}", shown) == printed, command


@pytest.mark.parametrize("name", [*PLAYED, *STRATEGIES])
def test_a_record_is_replayed_bit_for_bit(files, name):
    replayed = sp.replay(files / "records" / f"{name}.jsonl")
    assert replayed.differences == []
    assert replayed.identical
    assert len(replayed.resumed) == (name == "continued")


@pytest.mark.parametrize("name", PICTURES)
def test_a_record_with_pictures_is_replayed(files, name):
    """Its digests are of files, which are no longer made to the byte: replay says so, and finds no difference."""
    path = files / "records" / f"{name}.jsonl"
    replayed = sp.replay(path)
    assert replayed.identical
    sentence = None if name == "asked-picture" else NOT_COMPARED
    assert replayed.not_compared == sentence
    printed = run("replay", path).output.splitlines()[1:]
    assert printed == [sentence] * (sentence is not None)


@pytest.mark.parametrize("name", ["pictures", "only-pictures"])
def test_prompts_have_their_pictures_under_the_recorded_digests(files, name):
    events = sp.read_transcript(files / "records" / f"{name}.jsonl")
    shown = recorded_pictures(events)
    named = [event["data"]["picture"] for event in events if "picture" in event.get("data", ())]
    assert [shown[facts["sha256"]].facts for facts in named] == named != []
    assert all(shown[facts["sha256"]].png.startswith(b"\x89PNG") for facts in named)
    for sent in sent_prompts(events, pictures=shown):
        assert sent.sha256 == sent.recorded_sha256
    assert sent.prompt.pictures


def test_a_record_with_pictures_is_continued(files, tmp_path):
    """Pictures of before keep their digests, so that the prompts stay what they were."""
    with sp.fork(files / "records" / "pictures.jsonl", 2, transcript=tmp_path / "further.jsonl") as forked:
        sp.play(forked.conversation, sp.get_player("random"))
    replayed = sp.replay(tmp_path / "further.jsonl")
    assert replayed.identical
    assert replayed.not_compared == NOT_COMPARED


def test_a_record_of_a_strategy_in_a_file_is_replayed_if_the_file_is_named(files):
    record = "records/strategy-file.jsonl"
    assert "--strategy" in run("replay", record, code=3).stderr
    run("replay", record, "--strategy", STRATEGY)
    run("replay", "strategy-file", "--strategy", STRATEGY)


@pytest.mark.parametrize("name", [*STRATEGIES, "tools", "paper", "pictures", "strategy-file", "host-chat"])
def test_every_prompt_is_rebuilt(files, name):
    path = files / "records" / f"{name}.jsonl"
    views = [event["sha256"] for event in sp.read_transcript(path) if event["event"] == "view"]
    assert [sent.sha256 for sent in sent_prompts(sp.read_transcript(path))] == views


def test_an_interrupted_record_is_continued(copied):
    path = copied / "records" / "interrupted.jsonl"
    assert not sp.replay(path).complete
    with sp.resume(path, transcript=copied / "further.jsonl") as resumed:
        result = sp.play(resumed.conversation, sp.get_player("rule"))
    assert result.tokens == Record.read(copied / "records" / "continued.jsonl").result.tokens
    assert sp.replay(copied / "further.jsonl").identical


def test_a_killed_run_is_continued_from_its_unfinished_record(copied):
    (unfinished,) = copied.glob("killed/running/*.jsonl")
    written = sum(event["event"] == "message" for event in sp.read_transcript(unfinished))
    (kept,) = copied.glob("killed/episodes/*.jsonl")
    before = kept.read_bytes()
    assert json.loads((copied / "killed" / "status.json").read_bytes())["planned"] == 3
    played = sp.evaluate([BANDIT], ["rule"], out="killed", trials=3, budgets=sp.Budget(tool_calls=6), executor="inline")
    assert played.complete
    assert kept.read_bytes() == before
    ends = [sp.read_transcript(path) for path in copied.glob("killed/episodes/*.jsonl")]
    (continued,) = [events for events in ends if any(event["event"] == "resume" for event in events)]
    at = [event["event"] for event in continued].index("resume")
    assert sum(event["event"] == "message" for event in continued[:at]) == written
    run("replay", "killed")


RUN = [
    *("eval", "--games", f"{BANDIT},Hanoi3Disk-v0", "--players", "rule,random", "--price", "rule=0.1,0.3"),
    *("--seed", "3", "--trials", "2", "--prompt-tokens", "600", "--tool-calls", "6", "--executor", "inline", "--quiet"),
]
RUNS = {
    "run": RUN,
    "chain": [
        *("eval", "--games", BANDIT, "--players", "rule-notes", "--notes-tokens", "60", "--carry", "notes"),
        *("--chain", "2", "--trials", "3", "--tool-calls", "5", "--executor", "inline", "--quiet"),
    ],
    "strategy-file": [
        *("eval", "--games", "RockPaperScissorBasic-v0", "--strategy", STRATEGY, "--prompt-tokens", "700"),
        *("--tool-calls", "4", "--trials", "1", "--executor", "inline", "--quiet"),
    ],
    "agent-file": [
        *("eval", "--games", BANDIT, "--agent", "one_arm.py:one_arm", "--tool-calls", "4", "--trials", "1", "--quiet"),
    ],
}


@pytest.mark.parametrize("name", RUNS)
def test_the_same_command_finds_a_finished_run(copied, name):
    """The keys of its episodes are what they were, so nothing is played again."""
    played = {path.name: path.read_bytes() for path in copied.glob(f"{name}/episodes/*.jsonl")}
    rows = (copied / name / "results.jsonl").read_bytes()
    run(*RUNS[name], "--out", name)
    assert {path.name: path.read_bytes() for path in copied.glob(f"{name}/episodes/*.jsonl")} == played
    assert not list(copied.glob(f"{name}/attempts/*"))
    assert (copied / name / "results.jsonl").read_bytes() == rows


def test_more_trials_extend_a_finished_run(copied):
    run(*RUN, "--trials", "3", "--out", "run")
    assert len(RunFolder("run").rows()) == 12


@pytest.mark.parametrize("name", ["run", "chain", "sweep"])
def test_records_of_a_run_are_replayed(files, name):
    run("replay", name)


def test_tables_are_printed(files):
    for name in ("run", "killed", "chain", "strategy-file", "agent-file", "sweep"):
        assert "score" in run("results", name, "--all").output
    assert "The agent has lost its arm." in run("results", "failed").output
    assert "random" in run("compare", "run", "--reference", "rule").output
    run("cost", "run")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["run", "records"])
def test_a_page_is_written(files, tmp_path, name):
    run("report", name, "--out", tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size > 50_000


def test_a_run_is_exported(files, tmp_path):
    for form in ("sft", "sft-chains"):
        run("export", "run", "--format", form, "--out", tmp_path / form)
