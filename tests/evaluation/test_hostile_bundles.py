"""Bundles from strangers: whatever is in them, a check says in sentences what is wrong, in little time and memory."""

from __future__ import annotations

import json
import random
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.board.submissions.bundle import Limits
from smartplay_tools.evaluation.board.submissions.check import check_submission
from smartplay_tools.evaluation.board.submissions.check_report import report_json, report_text
from smartplay_tools.evaluation.run_folder.folder import trial_seed
from tests.evaluation import bundles
from tests.evaluation.bundles import HANOI, Files, changed, edit_json, records


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return bundles.play_bundle(tmp_path_factory.mktemp("honest"))


def refused(path, limits=None) -> str:
    """Check a bundle, which has to be refused before anything is replayed, and return the sentence."""
    checked = check_submission(path, limits=limits)
    assert [finding.kind for finding in checked.errors] == ["bundle"]
    assert checked.rows == []
    return checked.errors[0].text


def entry(name: str, data: bytes = b"", **facts) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    for fact, value in facts.items():
        setattr(info, fact, value)
    return info


def with_entry(bundle, path, info: zipfile.ZipInfo, data: bytes = b"x"):
    path.write_bytes(bundle.read_bytes())
    with zipfile.ZipFile(path, "a") as files:
        files.writestr(info, data)
    return path


BAD_NAMES = (
    *("../../etc/cron.d/x", "/etc/passwd", "episodes/../../x.jsonl", "C:\\x", "episodes\\x.jsonl", "run.py", "\x1b[2J"),
    *("episodes/0123456789abcdef.jsonl/..", "episodes/0123456789ABCDEF.jsonl", "attempts/0123456789abcdef.0.jsonl"),
)


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_name_that_is_none_of_a_bundle_s_is_refused(bundle, tmp_path, name):
    sentence = refused(with_entry(bundle, tmp_path / "x.zip", entry(name)))
    assert sentence.endswith("which does not belong in a bundle.")
    assert sentence.isprintable()


def test_links_and_doubled_files_are_refused(bundle, tmp_path):
    key = "episodes/0123456789abcdef.jsonl"
    link = with_entry(bundle, tmp_path / "link.zip", entry(key, external_attr=0o120777 << 16), b"/etc/passwd")
    assert "is a link or a device" in refused(link)
    with pytest.warns(UserWarning, match="Duplicate name"):
        double = with_entry(bundle, tmp_path / "double.zip", entry("manifest.json"))
    assert "twice" in refused(double)


def test_bombs_are_refused(bundle, tmp_path):
    limits = Limits(record_bytes=1 << 18, unpacked_bytes=4 << 20, line_bytes=1 << 16)
    key = "episodes/0123456789abcdef.jsonl"

    def bomb(size: int):
        def add(files: Files) -> None:
            files[key] = bytes(size) if size < 1 << 18 else b"x\n" * (size // 2)

        return changed(bundle, tmp_path / "bomb.zip", add)

    assert "unpacks to" in refused(bomb(16 << 20), limits)
    assert "has more than the 262,144 bytes" in refused(bomb(1 << 19), limits)
    assert "has a line of more than 65,536 bytes" in refused(bomb(1 << 17), limits)
    # A file can say that it is small and unpack to more.
    lying = bytearray(bomb(1 << 17).read_bytes())
    at = lying.rfind(key.encode()) - 46
    struct.pack_into("<L", lying, at + 24, 10)
    (tmp_path / "lying.zip").write_bytes(lying)
    assert refused(tmp_path / "lying.zip", limits)


def test_what_is_no_zip_file_is_refused(bundle, tmp_path):
    whole = bundle.read_bytes()
    at = whole.rfind(b"PK\x05\x06")
    cases = {
        "empty": b"",
        "text": b"not a bundle",
        "torn": whole[: len(whole) // 2],
        "headless": whole[at:],
        "list": whole[: at + 12] + struct.pack("<L", 1 << 28) + whole[at + 16 :],
        "zip64": whole[: at + 12] + b"\xff" * 4 + whole[at + 16 :],
        "garbled": bytes(byte ^ 0x55 if 200 < place < 2_000 else byte for place, byte in enumerate(whole)),
    }
    for name, data in cases.items():
        path = tmp_path / f"{name}.zip"
        path.write_bytes(data)
        assert refused(path).startswith("The bundle"), name
    encrypted = bytearray(whole)
    at = whole.rfind(b"PK\x01\x02")
    encrypted[at + 8] |= 1
    (tmp_path / "encrypted.zip").write_bytes(encrypted)
    assert "is encrypted" in refused(tmp_path / "encrypted.zip")


def test_a_zip64_file_is_refused_behind_the_longest_comment(bundle, tmp_path):
    """Its list of files could have any length, whatever its ordinary end says."""
    whole = bundle.read_bytes()
    at = whole.rfind(b"PK\x05\x06")
    count, size, offset = struct.unpack_from("<HLL", whole, at + 10)
    end = struct.pack("<4sQHHLLQQQQ", b"PK\x06\x06", 44, 45, 45, 0, 0, count, count, size, offset)
    locator = struct.pack("<4sLQL", b"PK\x06\x07", 0, at, 1)
    path = tmp_path / "zip64.zip"
    path.write_bytes(whole[:at] + end + locator + whole[at : at + 20] + struct.pack("<H", 0xFFFF) + b" " * 0xFFFF)
    with zipfile.ZipFile(path) as readable:
        assert len(readable.infolist()) == count
    assert refused(path) == "The bundle is a zip64 file, which a bundle never needs to be."


def many_episodes(plan: dict[str, Any], count: int = 60_000) -> None:
    game = plan["cells"][0]["game"]
    plan["episodes"] = [
        {"key": f"{trial:016x}", "cell": 0, "trial": trial, "seed": trial_seed(0, game, trial)}
        for trial in range(count)
    ]


def large_options(plan: dict[str, Any]) -> None:
    plan["cells"][0]["player_options"] = {"prompt": "a" * (30 << 10)}
    plan["cells"] = plan["cells"][:1]
    many_episodes(plan)


def many_cells(plan: dict[str, Any]) -> None:
    plan["cells"] = [{}] * 4_000_000


def a_large_price(plan: dict[str, Any]) -> None:
    plan["prices"] = {"rule": {"input": [[start, 1.0] for start in range(500_000)], "output": [], "cached": []}}
    many_episodes(plan)


def many_rows(files: Files) -> None:
    files["results.jsonl"] = b"".join(b'{"key":"%x"}\n' % number for number in range(5_000_000))


def in_plan(change: Callable[[Any], None]) -> Callable[[Files], None]:
    return lambda files: edit_json(files, "manifest.json", change)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the kernel tells what a process took")
@pytest.mark.parametrize(
    "change",
    [*map(in_plan, [large_options, many_cells, a_large_price]), many_rows],
    ids=["options", "cells", "price", "rows"],
)
def test_what_comes_before_the_records_takes_little_time_and_memory(bundle, tmp_path, change):
    path = changed(bundle, tmp_path / "x.zip", change)
    program = (
        "import sys, time; from smartplay_tools.evaluation.board.submissions.check import check_submission;"
        "assert not check_submission(sys.argv[1]).verified;"
        "peak = next(line for line in open('/proc/self/status') if 'VmHWM' in line).split()[1];"
        "print(time.process_time(), int(peak) / 1024)"
    )
    done = subprocess.run([sys.executable, "-c", program, path], capture_output=True, text=True, check=True)
    seconds, megabytes = map(float, done.stdout.split())
    assert seconds < 30
    assert megabytes < 600


def test_a_cell_and_its_player_s_options_are_small(bundle, tmp_path):
    def grow(files: Files) -> None:
        edit_json(files, "manifest.json", lambda plan: plan["cells"][0].update(player_options={"x": "a" * 40_000}))

    (finding,) = check_submission(changed(bundle, tmp_path / "x.zip", grow), workers=0).errors
    assert "a cell, with its player's options, has 40," in finding.text
    assert finding.text.endswith("bytes; 32,768 are allowed.")


def test_a_record_has_few_findings_however_many_there_are(bundle, tmp_path):
    def repeat(files: Files) -> None:
        name = records(files, HANOI)[0]
        key = name.removeprefix("episodes/").removesuffix(".jsonl")
        for number in range(1, 40):
            files[f"attempts/{key}.{number}.jsonl"] = files[name]

    checked = check_submission(changed(bundle, tmp_path / "x.zip", repeat), workers=0)
    assert len(checked.errors) == 21
    assert checked.errors[-1].text == "There are 19 more of these in this record."


def test_configs_that_reach_for_more_are_not_replayed(bundle, tmp_path, monkeypatch):
    """Neither a package is imported nor a program started nor a file read because a manifest names it."""
    (tmp_path / "evil.py").write_text("raise SystemExit('imported')\n")
    about = tmp_path / "evil-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[smartplay_tools.games]\nEvil-v0 = evil:spec\n")
    monkeypatch.syspath_prepend(tmp_path)

    def config(**facts):
        def edit(files: Files) -> None:
            def reach(manifest):
                manifest["cells"][0].update(facts)

            edit_json(files, "manifest.json", reach)

        return check_submission(changed(bundle, tmp_path / "x.zip", edit), workers=0)

    for facts, sentence in [
        ({"game": "Evil-v0"}, "not a setting of the benchmark"),
        ({"engine": "luanti"}, "a program that --engine NAME allows to start"),
        ({"tokenizer": "hf:/etc/passwd"}, "name it with --tokenizer"),
        ({"options": {"texts": "/etc"}}, "which are not replayed"),
        (
            {"setting": {"history": 1, "rollout": 10**9, "kwargs": {"disks": 10**9}}},
            "other numbers than the benchmark's",
        ),
        ({"prompts": "../../x"}, "this version knows 'v1', 'v2'"),
    ]:
        checked = config(**facts)
        assert any(sentence in finding.text for finding in checked.errors), facts
        assert len(checked.rows) == 2, "the other cell is replayed"
    assert "evil" not in sys.modules


@pytest.mark.slow
def test_scripts_and_terminal_codes_in_texts_stay_text(bundle, tmp_path):
    def checked(change: Callable[[Files], None]) -> Any:
        return check_submission(changed(bundle, tmp_path / "x.zip", change), workers=0)

    def saying(**texts: object) -> Callable[[Files], None]:
        return lambda files: edit_json(files, "submission.json", lambda facts: facts.update(texts))

    assert "<script>alert(1)</script> (Its makers)" in report_text(
        checked(saying(model_name="<script>alert(1)</script>"))
    )
    assert [finding.text for finding in checked(saying(model_name="\x1b[2Jgone")).errors] == [
        "submission.json, model_name: Value error, control characters are not allowed."
    ]

    def row(files: Files) -> None:
        files["results.jsonl"] = files["results.jsonl"].replace(b'"completed": ', b'"\\u001b[2J": 1, "completed": ', 1)

    assert "\x1b" not in report_text(checked(row))
    reference = {"title": "a", "url": "javascript:alert(1)"}
    assert "url" in report_text(checked(saying(references=[reference])))


HOSTILE = [None, True, -1, 10**30, 1e308, float("nan"), "", "\ud800", "x" * 10_000, [], {}, [[[]]], {"a": {}}, "../x"]
"""Values that are put where others belong."""


def damage(chance: random.Random, value: object) -> object:
    """Return plain data with a hostile value somewhere in it."""
    if isinstance(value, dict) and value and chance.random() < 0.9:
        name = chance.choice(sorted(value))
        if chance.random() < 0.15:
            return {other: kept for other, kept in value.items() if other != name}
        return {**value, name: damage(chance, value[name])}
    if isinstance(value, list) and value and chance.random() < 0.9:
        at = chance.randrange(len(value))
        return [*value[:at], damage(chance, value[at]), *value[at + 1 :]]
    return chance.choice(HOSTILE)


def damaged(chance: random.Random, files: Files) -> None:
    """Damage one file of a bundle: a value, a line, some bytes; half of the time with a chain that is right."""
    name = chance.choice(sorted(files))
    data = files[name]
    match chance.randrange(4):
        case 0:
            at = chance.randrange(len(data))
            files[name] = data[:at] + bytes(chance.randrange(256) for _ in range(8)) + data[at + chance.randrange(20) :]
        case 1:
            lines = data.splitlines(keepends=True)
            at = chance.randrange(len(lines))
            files[name] = b"".join([*lines[:at], *lines[at + chance.randrange(3) :]])
        case _ if name.endswith(".json"):
            files[name] = json.dumps(damage(chance, json.loads(data))).encode()
        case _:
            events = [json.loads(line) for line in data.splitlines()]
            at = chance.randrange(len(events))
            event = damage(chance, events[at])
            lines = [*events[:at], event, *events[at + 1 :]]
            fit = name.startswith("episodes") and isinstance(event, dict) and chance.random() < 0.7
            files[name] = bundles.chained(lines) if fit else "".join(json.dumps(one) + "\n" for one in lines).encode()


@pytest.mark.parametrize("count", [5, pytest.param(50, marks=pytest.mark.slow)])
def test_damaged_bundles_never_raise(bundle, tmp_path, count):
    chance = random.Random(count)
    for number in range(count):
        path = changed(bundle, tmp_path / f"{number}.zip", lambda files: damaged(chance, files))
        checked = check_submission(path, workers=0)
        text = report_text(checked)
        assert json.dumps(report_json(checked), allow_nan=False)
        assert all(char.isprintable() or char == "\n" for char in text)
        assert all(0 < len(finding.text) <= 500 for finding in checked.findings)


@pytest.mark.slow
def test_the_command_prints_sentences(bundle, tmp_path):
    def damage_record(files: Files) -> None:
        name = records(files, HANOI)[0]
        files[name] = b'{"event": "start", "format": 1, "config": {}, "chain": ""}\n' + b"[" * 100_000

    path = changed(bundle, tmp_path / "x.zip", damage_record)
    done = subprocess.run(
        [sys.executable, "-m", "smartplay_tools", "submit", "check", path, "--workers", "1"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    assert "x.zip: NOT verified: 1 error" in done.stdout


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="memory is limited on Unix only")
def test_memory_is_bounded(bundle, tmp_path):
    """A record that unpacks to much more than its size is given up, and the rest is checked."""

    def large(files: Files) -> None:
        name = records(files, HANOI)[0]
        lines = files[name].splitlines(keepends=True)
        filler = b'{"event": "resume", "x": [' + b"[]," * 1_000_000 + b"0]}\n"
        files[name] = lines[0] + filler * 10

    path = changed(bundle, tmp_path / "x.zip", large)
    checked = check_submission(path, limits=Limits(memory_bytes=600 << 20))
    assert any("more memory" in finding.text or "ended with code" in finding.text for finding in checked.errors)
    assert len(checked.rows) == 3


def test_a_zip_is_read_as_bytes_not_as_a_folder(tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match="cannot be read"):
        check_submission(tmp_path)
