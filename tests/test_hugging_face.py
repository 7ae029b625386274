"""Hugging Face tokenizers from a file or a folder: exact counts, regardless of the file's other settings."""

from __future__ import annotations

import hashlib
import pickle
import shutil
from pathlib import Path

import pytest
import tokenizers

import smartplay_tools as sp
from smartplay_tools.context.tokens import get_tokenizer, tokenizers as named
from smartplay_tools.records import Record
from tests.evaluation.command import refused, result_of, shown_by

TEXT = "The player chose Rock, and the opponent chose Paper. You lost and received score -1. "


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A tokenizer whose settings truncate, pad, add special tokens and drop out at random."""
    tokenizer = tokenizers.Tokenizer(tokenizers.models.BPE(dropout=0.5))
    tokenizer.pre_tokenizer = tokenizers.pre_tokenizers.ByteLevel(add_prefix_space=False)
    tokenizer.train_from_iterator(
        [TEXT],
        tokenizers.trainers.BpeTrainer(
            vocab_size=400,
            special_tokens=["<s>"],
            initial_alphabet=tokenizers.pre_tokenizers.ByteLevel.alphabet(),
            show_progress=False,
        ),
    )
    tokenizer.post_processor = tokenizers.processors.TemplateProcessing(single="<s> $A", special_tokens=[("<s>", 0)])
    tokenizer.enable_truncation(8)
    tokenizer.enable_padding(length=20)
    folder = tmp_path_factory.mktemp("tokenizer")
    tokenizer.save(str(folder / "tokenizer.json"))
    return folder


def test_a_file_and_its_folder_are_one_tokenizer(folder):
    file = folder / "tokenizer.json"
    by_file, by_folder = get_tokenizer(f"hf:{file}"), get_tokenizer(f"hf:{folder}")
    assert by_file.count(TEXT) == by_folder.count(TEXT)
    assert by_file.sha256 == by_folder.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    assert (by_file.name, by_folder.name) == (f"hf:{file}", f"hf:{folder}")


def test_it_counts_all_of_a_text_and_nothing_but_the_text(folder):
    plain = tokenizers.Tokenizer.from_file(str(folder / "tokenizer.json"))
    plain.no_truncation()
    plain.no_padding()
    plain.model.dropout = None
    tokenizer = get_tokenizer(f"hf:{folder}")
    assert tokenizer.count(TEXT * 9) == len(plain.encode(TEXT * 9, add_special_tokens=False)) > 20
    assert {tokenizer.count(TEXT) for _ in range(20)} == {tokenizer.count(TEXT)}
    assert tokenizer.count("") == 0
    assert tokenizer.count("<s>") == 3  # special tokens are text


def test_an_episode_is_played_recorded_and_replayed_with_it(folder, tmp_path):
    settings = {"tokenizer": f"hf:{folder}", "budget": sp.Budget(prompt_tokens=2500)}
    with sp.Episode("Hanoi3Disk-v0", seed=1, transcript=tmp_path / "t.jsonl", **settings) as episode:
        assert episode.call("act", '{"action": "\\ud800"}').is_error
    config = sp.read_transcript(tmp_path / "t.jsonl")[0]["config"]
    sha256 = hashlib.sha256((folder / "tokenizer.json").read_bytes()).hexdigest()
    assert (config["tokenizer"], config["tokenizer_sha256"]) == (f"hf:{folder}", sha256)
    assert sp.replay(tmp_path / "t.jsonl").identical


def test_a_record_does_not_open_it_and_its_reader_does(folder, tmp_path, monkeypatch):
    there, here = tmp_path / "there", tmp_path / "here"
    shutil.copytree(folder, there)
    asked = {
        "games": ["Hanoi3Disk-v0"],
        "players": ["random"],
        "trials": 2,
        "executor": "inline",
        "out": tmp_path / "run",
    }
    run = sp.evaluate(**asked, tokenizer=f"hf:{there}", budgets=sp.Budget(prompt_tokens=2500))
    record = run.transcript(run.rows[0]["key"])
    monkeypatch.setattr(named, "_NAMED", {})  # as another process
    for read in (sp.replay, lambda path: sp.resume(path, transcript=[]), lambda path: sp.fork(path, 1)):
        with pytest.raises(
            sp.InvalidArgumentError, match=r"which is not part of this package; name it with --tokenizer"
        ):
            read(record)
    there.rename(here)

    replayed = result_of("replay", run.folder.path)
    said = replayed.output
    assert (replayed.exit_code, "2 of 2 episodes were not replayed" in said, "differ" in said) == (3, True, False)
    assert result_of("replay", record).exit_code == 3
    assert "name it with --tokenizer" in refused("cost", run.folder.path, "--cache", "anthropic-512")
    assert "not with 'approximate'" in refused("replay", record, "--tokenizer", "approximate")
    shown_by("replay", run.folder.path, "--tokenizer", f"hf:{here}")
    shown_by("cost", run.folder.path, "--cache", "anthropic-512", "--tokenizer", f"hf:{here}")


def test_a_run_that_was_interrupted_is_continued_with_it(folder, tmp_path, monkeypatch):
    run = sp.evaluate(
        ["Hanoi3Disk-v0"], ["random"], out=tmp_path, trials=1, executor="inline", tokenizer=f"hf:{folder}"
    )
    (finished,) = map(Path, (tmp_path / "episodes").glob("*.jsonl"))
    (tmp_path / "attempts").mkdir(exist_ok=True)
    lines = finished.read_bytes().splitlines(keepends=True)
    (tmp_path / "attempts" / f"{finished.stem}.1.jsonl").write_bytes(b"".join(lines[: len(lines) // 2]))
    finished.unlink()
    (tmp_path / "results.jsonl").unlink()
    monkeypatch.setattr(named, "_NAMED", {})  # as another process
    again = sp.evaluate(
        ["Hanoi3Disk-v0"], ["random"], out=tmp_path, trials=1, executor="inline", tokenizer=f"hf:{folder}"
    )
    assert again.rows[0]["score"] == run.rows[0]["score"]
    assert again.status.began_again == 0
    assert Record.read(finished).resumes


def test_it_can_be_pickled(folder):
    tokenizer = get_tokenizer(f"hf:{folder}")
    assert pickle.loads(pickle.dumps(tokenizer)).count(TEXT) == tokenizer.count(TEXT)


@pytest.mark.parametrize("name", ["", "missing.json", "./a/b/c", "/nowhere/tokenizer.json"])
def test_a_file_that_is_not_there_is_one_sentence(name):
    with pytest.raises(sp.InvalidArgumentError, match="There is no file"):
        get_tokenizer(f"hf:{name}")


def test_a_file_that_is_no_tokenizer_is_one_sentence(tmp_path):
    (tmp_path / "tokenizer.json").write_text("{}")
    with pytest.raises(sp.InvalidArgumentError, match="is not a file of Hugging Face's tokenizers: "):
        get_tokenizer(f"hf:{tmp_path}")


def test_a_name_that_cannot_be_is_one_sentence():
    with pytest.raises(sp.InvalidArgumentError, match="HFValidationError"):
        get_tokenizer("hf:not a name")
