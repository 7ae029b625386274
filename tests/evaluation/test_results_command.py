"""`smartplay-tools results`: a run at any time, for people, for machines and for notebooks."""

from __future__ import annotations

import csv
import json
import re
import shlex
import sys

import pytest
from typer.testing import Result

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.runner import evaluate
from tests.evaluation.command import refused, result_of

GAMES = ["Hanoi3Disk-v0", "MessengerL1-v0"]


def run(*words: object) -> Result:
    return result_of("results", *words)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "first"
    evaluate(GAMES, ("random", "rule"), out=path, trials=2, executor="inline")
    return path


def test_it_shows_the_run(folder):
    shown = run(folder)
    assert shown.exit_code == 0
    assert "8 of 8 episodes finished" in shown.output
    assert "paused" not in shown.output
    assert all(game in shown.output for game in GAMES)
    assert "capabilities" not in shown.output
    assert f"smartplay-tools results {folder} --all --explain" in shown.output.replace("\n", "")


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are UTF-8 elsewhere")
def test_a_name_that_is_not_utf8_is_shown_and_a_damaged_run_does_not_hide_the_others(folder, tmp_path):
    odd, damaged = tmp_path / "r\udcff", tmp_path / "damaged"
    odd.symlink_to(folder)
    damaged.mkdir()
    (damaged / "manifest.json").write_text("{")
    shown = run(odd, damaged, folder, "--csv", tmp_path / "c\udcff.csv")
    assert shown.exit_code == 1
    assert shown.stderr == f"smartplay-tools: {damaged / 'manifest.json'} is not JSON.\n"
    assert shown.stdout.count("8 of 8 episodes finished") == 2
    assert f"{tmp_path}/r\\udcff: 8 of 8" in shown.stdout
    with (tmp_path / "c\udcff.csv").open(encoding="utf-8") as file:
        assert {row["run"] for row in csv.DictReader(file)} == {f"{tmp_path}/r\ufffd", str(folder)}


def test_what_is_next_can_be_entered_as_it_stands(folder, tmp_path):
    spaced = tmp_path / "a run"
    spaced.symlink_to(folder)
    *_, results, report = run(spaced).output.splitlines()
    assert shlex.split(results) == ["smartplay-tools", "results", str(spaced), "--all", "--explain"]
    assert shlex.split(report)[:3] == ["smartplay-tools", "report", str(spaced)]


def test_it_fits_eighty_columns_and_cuts_no_number(folder, tmp_path):
    """Also for a player whose name is longer than that, and with counts of millions."""
    rows = [json.loads(line) for line in (folder / "results.jsonl").read_text(encoding="utf-8").splitlines()]
    for row in rows:
        row |= {"player": f"langchain:{row['player']}-of-a-vendor-with-long-names", "score": 123456.789, "cost": 1234.5}
        row["tokens"] |= {"prompt": 222_333_444, "provider": {"prompt": 1, "reply": 2, "cached": 0, "requests": 1}}
    wide = tmp_path / "wide"
    wide.mkdir()
    (wide / "manifest.json").write_bytes((folder / "manifest.json").read_bytes())
    (wide / "results.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    for path in (folder, wide):
        tables, _, _ = run(path, "--all", "--explain").output.partition("Next:")
        lines = [line for line in tables.splitlines() if str(path) not in line]
        assert max(map(len, lines)) <= 80
        assert "…" not in tables
    assert "123,457 (all 2 equal)" in run(wide).output


def test_several_runs_are_shown_beneath_each_other(folder, tmp_path):
    other = tmp_path / "other"
    other.symlink_to(folder)
    shown = run(folder, other, "--format", "markdown").output
    assert [line for line in shown.splitlines() if line.startswith("**")] == [f"**{folder}**", f"**{other}**"]
    shown = run(folder, folder, "--csv", tmp_path / "both.csv").output
    assert shown.count("8 of 8 episodes finished") == 2
    assert f"smartplay-tools compare {folder} {folder}" in shown.replace("\n", "")
    assert [one["finished"] for one in json.loads(run(folder, folder, "--json").output)] == [8, 8]
    with (tmp_path / "both.csv").open(encoding="utf-8", newline="") as file:
        assert {line["run"] for line in csv.DictReader(file)} == {str(folder)}


def test_a_run_under_way_shows_what_there_is(folder, tmp_path):
    """The folder as it stands after three episodes, the fourth being written."""
    there = tmp_path / "half"
    there.mkdir()
    (there / "manifest.json").write_bytes((folder / "manifest.json").read_bytes())
    lines = (folder / "results.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    (there / "results.jsonl").write_text("".join(lines[:3]) + lines[3][:40], encoding="utf-8")
    shown = run(there)
    assert "3 of 8 episodes finished" in shown.output
    played = {(row["game"], row["player"]) for row in map(json.loads, lines[:3])}
    others = [f"{game}, {player}" for game in GAMES for player in ("random", "rule") if (game, player) not in played]
    assert f"Without a finished episode: {'; '.join(others)}." in shown.output.replace("\n", "")
    (there / "results.jsonl").unlink()
    assert "0 of 8 episodes finished" in run(there).output


def test_a_shard_is_as_long_as_its_part(tmp_path):
    part = evaluate(GAMES, ("random",), out=tmp_path, trials=3, executor="inline", shard=(2, 3))
    assert 0 < part.planned < 3 * len(GAMES)
    assert f"{part.planned} of {part.planned} episodes finished" in run(tmp_path).output


def test_cells_without_an_episode_are_named_up_to_ten_with_their_budgets(tmp_path):
    budgets = [sp.Budget(prompt_tokens=tokens) for tokens in range(700, 1900, 100)]
    evaluate([GAMES[0]], ["rule"], budgets=budgets, out=tmp_path, trials=1, executor="inline")
    (tmp_path / "results.jsonl").write_text("")
    shown = " ".join(run(tmp_path).output.split())
    assert "Without a finished episode: Hanoi3Disk-v0, rule, prompts <= 700; Hanoi3Disk-v0" in shown
    assert "prompts <= 1,600; and 2 more." in shown


def test_a_file_that_cannot_be_written_is_one_sentence(tmp_path):
    """Whichever command writes it: nothing can be written below a file."""
    whole = evaluate([GAMES[0]], ("random",), out=tmp_path / "run", trials=1, executor="inline")
    place = tmp_path / "file" / "x.out"
    place.parent.touch()
    record = whole.transcript(whole.rows[0]["key"])
    commands = (
        ("results", whole.folder.path, "--csv", place),
        ("export", whole.folder.path, "--format", "sft-chains", "--out", place),
        ("report", record, "--out", place.with_suffix(".html")),
    )
    for command in commands:
        said = refused(*command)
        assert re.fullmatch(r"smartplay-tools: \S+file\S* cannot be read or written: \w+ .*\.\n", said), said
