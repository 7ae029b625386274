"""The record of a context manager: every prompt is rebuilt from it, by its digest."""

from __future__ import annotations

import json
import stat
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.manager.record import read_thread
from tests.manager.histories import FORMS
from tests.manager.test_fit import HEAD, manager, steps


def only_file(folder: Path) -> Path:
    (file,) = folder.iterdir()
    return file


@pytest.mark.parametrize("form", FORMS)
def test_every_prompt_is_rebuilt_word_for_word(tmp_path: Path, form: str):
    messages = FORMS[form](steps(30))
    window = manager(300, record=tmp_path, slack=0.5, result_tokens=8)
    tool = sp.ToolSpec("read", "Read a page.", {"type": "object", "properties": {"page": {"type": "integer"}}})
    ends, beside = range(4, len(messages), 3), {"tools": [tool], "system": "Be brief.", "form": form}
    sent = [window.fit(messages[:end], **beside) for end in ends]
    thread = read_thread(only_file(tmp_path))
    prompts = thread.prompts
    assert not thread.differing
    assert [list(prompt.messages) for prompt in prompts] == [prompt.messages for prompt in sent]
    assert [prompt.facts["tokens"] for prompt in prompts] == [prompt.tokens for prompt in sent]
    assert prompts[-1].beside == {"tools": [tool.to_json()], "system": "Be brief."}
    assert list(prompts[-1].given) == messages[: max(ends)]
    kept = [later.facts["prefix_tokens"] for later in prompts[1:]]
    assert 50 < min(kept) < 100 < max(kept) < 300


def test_the_same_prompt_is_written_once_and_another_process_goes_on(tmp_path: Path):
    for pages in (3, 3, 4):
        window = manager(300, record=tmp_path)
        window.fit(steps(pages))
        window.fit(steps(pages))
    first, second = read_thread(only_file(tmp_path)).prompts
    assert [prompt.facts["number"] for prompt in (first, second)] == [0, 1]
    assert second.facts["prefix_tokens"] == first.facts["tokens"] - 3
    messages = [json.loads(line) for line in only_file(tmp_path).read_text().splitlines() if '"part"' in line]
    assert len(messages) == len({message["sha256"] for message in messages if "sha256" in message})


def test_threads_differ_by_their_heads_or_by_their_names(tmp_path: Path):
    window = manager(300, record=tmp_path)
    window.fit(steps(3))
    window.fit([{"role": "user", "content": "Another task."}])
    window.fit(steps(3), thread="mine")
    assert len([*tmp_path.iterdir()]) == 3
    assert (tmp_path / "mine.jsonl").exists()
    for name in ("../mine", ".hidden", "", "a/b"):
        with pytest.raises(sp.InvalidArgumentError, match="cannot name a thread"):
            window.fit(steps(3), thread=name)


def test_what_a_provider_counts_is_shown_and_marked_where_it_is_over_the_cap(tmp_path: Path):
    window = manager(300, record=tmp_path)
    for end, counted in ((4, 100), (6, 301)):
        window.reported(window.fit(steps(3)[:end]), counted)
    first, second = read_thread(only_file(tmp_path)).prompts
    assert (first.reported, first.is_over) == (100, False)
    assert (second.reported, second.is_over) == (301, True)


def test_refusals_are_recorded(tmp_path: Path):
    with pytest.raises(sp.PromptOverflowError):
        manager(5, record=tmp_path).fit(HEAD)
    thread = read_thread(only_file(tmp_path))
    assert not thread.prompts
    assert [[*refused] for refused in thread.refusals] == [["tools", "head"]]


def test_only_its_owner_reads_it(tmp_path: Path):
    manager(300, record=tmp_path / "new").fit(steps(3))
    assert stat.S_IMODE(only_file(tmp_path / "new").stat().st_mode) == 0o600


def test_two_programs_do_not_write_one_thread(tmp_path: Path):
    one, other = (manager(300, record=tmp_path) for _ in range(2))
    one.fit(steps(3))
    other.fit(steps(4))
    with pytest.raises(TranscriptError, match="written by another program"):
        one.fit(steps(5))


def test_a_changed_record_is_refused_and_an_incomplete_line_is_left_out(tmp_path: Path):
    manager(300, record=tmp_path).fit(steps(3))
    file = only_file(tmp_path)
    whole = file.read_text()
    file.write_text(whole.replace("Page 1", "Page 9"))
    with pytest.raises(TranscriptError, match="changed since"):
        read_thread(file)
    file.write_text(whole + '{"kind": "pro')
    assert len(read_thread(file).prompts) == 1
    manager(300, record=tmp_path).fit(steps(4))
    assert len(read_thread(file).prompts) == 2
    file.write_text("{}\n")
    with pytest.raises(TranscriptError, match="line 1: not the record"):
        read_thread(file)


@pytest.mark.parametrize("place", [1, 3])
def test_bytes_in_a_field_that_nobody_reads_are_refused_by_position(tmp_path: Path, place: int):
    window, messages = manager(600, record=tmp_path), steps(3)
    messages[place] = {**messages[place], "artifact": {"data": b"raw"}}
    with pytest.raises(InvalidArgumentError, match=f"Message {place} holds bytes, which is no JSON"):
        window.fit(messages, thread="one")
    window.fit(steps(3), thread="one")
    assert read_thread(only_file(tmp_path)).differing == []


def test_a_record_that_was_closed_among_many_threads_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("smartplay_tools.manager.threads.RECORDS", 2)
    window, messages = manager(600, record=tmp_path), steps(3)
    first = window.fit(messages[:4], thread="first")
    for thread in ("second", "third", "fourth"):
        window.fit(messages, thread=thread)
    window.reported(first, 77)
    window.fit(messages, thread="first")
    record = read_thread(tmp_path / "first.jsonl")
    assert [prompt.reported for prompt in record.prompts] == [77, None]
    assert record.differing == []
