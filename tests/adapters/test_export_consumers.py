"""What reads the exports: `datasets` and TRL's `SFTTrainer` train on the rows.

`.ci/run` has an environment with them: torch as a build for processors, and a model that is too small to learn.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("trl", reason="needs trl and datasets; `.ci/run` has an environment with them")

from datasets import Dataset, load_dataset
from trl import SFTConfig, SFTTrainer

import smartplay_tools as sp
from smartplay_tools.evaluation.exports import export
from smartplay_tools.records import Record
from tests.adapters import tiny_model

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    games = ["Hanoi3Disk-v0", "MessengerL1-v0"]
    sp.evaluate(games, ["rule", "random"], budgets=[sp.Budget(prompt_tokens=900)], trials=2, out=folder, workers=1)
    return folder


def settings(folder: Path, **own: Any) -> SFTConfig:
    """Of a trainer on a processor, which tells nobody."""
    here = {"report_to": "none", "use_cpu": True, "bf16": False, "gradient_checkpointing": False}
    return SFTConfig(output_dir=str(folder / "out"), max_length=16384, **here, **own)


def read(folder: Path) -> Dataset:
    """Read the rows in a folder."""
    data = str(folder / "data" / "data.jsonl")
    return load_dataset("json", data_files=data, split="train", cache_dir=str(folder / "cache"))


@pytest.mark.parametrize("name", ["sft", "sft-chains"])
def test_sft_trainer_trains_on_the_replies_only(run, tmp_path, name, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    export(run, tmp_path / "data", name, players=("rule",))
    rows = read(tmp_path)
    tokenizer = tiny_model.tokenizer()
    which = {"completion_only_loss": True} if name == "sft" else {"assistant_only_loss": True}
    trainer = SFTTrainer(
        model=tiny_model.model(tokenizer),
        processing_class=tokenizer,
        train_dataset=rows.select(range(4)),
        args=settings(tmp_path, max_steps=2, per_device_train_batch_size=2, save_strategy="no", **which),
    )
    assert trainer.train().training_loss > 0
    batch = next(iter(trainer.get_train_dataloader()))
    for ids, labels in zip(batch["input_ids"].tolist(), batch["labels"].tolist(), strict=True):
        shown = tokenizer.decode([i for i, label in zip(ids, labels, strict=True) if label == -100])
        trained = tokenizer.decode([label for label in labels if label != -100])
        assert '"parameters": {"type": "object", "properties": {"action"' in shown, "the schemas reach the model whole"
        assert "You’re a player trying to play the game" in shown
        assert "<tool_call>" in trained
        assert "tool_response" not in trained


def test_what_is_trained_on_is_the_recorded_prompt(run, tmp_path):
    heads = map(Record.head, sorted((run / "episodes").glob("*.jsonl")))
    record = next(head.path for head in heads if (head.game, head.player) == ("Hanoi3Disk-v0", "rule"))
    assert record is not None
    export(record, tmp_path / "data", "sft")
    rows = read(tmp_path)
    tokenizer = tiny_model.tokenizer()
    for row, sent in zip(rows, Record.read(record).prompts, strict=True):
        exported = tokenizer.apply_chat_template(row["prompt"], tools=json.loads(row["tools"]), tokenize=False)
        tools = [
            {"type": "function", "function": {"name": t.name, "description": t.description, "parameters": t.parameters}}
            for t in sent.prompt.tools
        ]
        messages = [{**message, "content": message["content"] or ""} for message in sent.prompt.messages]
        assert exported == tokenizer.apply_chat_template(messages, tools=tools, tokenize=False)


def test_every_reply_of_a_chain_is_trained_once(run, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    export(run, tmp_path / "data", "sft-chains", players=("rule",), games=("Hanoi3Disk-v0",))
    rows = read(tmp_path)
    tokenizer = tiny_model.tokenizer()
    trainer = SFTTrainer(
        model=tiny_model.model(tokenizer),
        processing_class=tokenizer,
        train_dataset=rows,
        args=settings(tmp_path, assistant_only_loss=True),
    )
    trained = sum(
        tokenizer.decode([label for label in row["labels"] if label != -100]).count("<|im_end|>")
        for row in trainer.train_dataset
    )
    assert len(rows) > 1, "the window has moved"
    assert trained == sum(rows["replies"]) == sum(len(chain) for chain in replies_of(rows))


def replies_of(rows):
    return [[message for message in row["completion"] if message["role"] == "assistant"] for row in rows]
