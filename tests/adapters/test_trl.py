"""TRL's `GRPOTrainer` with a game as its environment: `.ci/run` has an environment with it."""

from __future__ import annotations

import inspect
import json
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("trl", reason="needs smartplay-tools[trl]; `.ci/run` has an environment with it")

import torch
from datasets import Dataset
from smartplay_trl import GameEnvironment, environment, rows, tools_as_text
from transformers.utils.chat_template_utils import get_json_schema
from trl import GRPOConfig, GRPOTrainer

import smartplay_tools as sp
from smartplay_tools.evaluation.exports import export
from tests.adapters import conformance, tiny_model
from tests.adapters.conformance import GAME, HOST_BUDGET, WAY, Host, Send, move

pytestmark = pytest.mark.filterwarnings("ignore")

CLASS = environment(GAME)


def begun(seed: int = 1, **options: Any) -> Any:
    made = environment(GAME, **options)()
    made.reset(seed=seed, prompt="")
    return made


def tools_of(made: type[GameEnvironment]) -> list[str]:
    """The tools as the trainer finds them."""
    functions = [name for name, _ in inspect.getmembers(made, inspect.isfunction) if not name.startswith("_")]
    return [name for name in functions if name not in ("reset", "get_reward")]


def carries(name: str, arguments: dict[str, Any]) -> bool:
    """Whether TRL can make the call: it passes the arguments by name."""
    return name in tools_of(CLASS) and arguments.keys() == ({"action"} if name == "act" else set())


@asynccontextmanager
async def rollouts(seeds: Sequence[int], folder: Path) -> AsyncIterator[list[Send]]:
    made = environment(GAME, budget=HOST_BUDGET, records=folder)
    environments = {seed: made() for seed in seeds}

    def sender(seed: int) -> Send:
        async def send(name: str, arguments: Any) -> tuple[str, bool | None]:
            return getattr(environments[seed], name)(**arguments), None

        return send

    for seed, one in environments.items():
        one.reset(seed=seed, prompt=[])
    yield [sender(seed) for seed in seeds]
    for one in environments.values():
        one.get_reward()


ROW = Host(rollouts, "TRL `environment`", carries)


async def test_the_game_cannot_tell_it_apart(tmp_path):
    await conformance.judge_hosts(ROW, tmp_path)


def test_the_tools_are_described_as_everywhere():
    with sp.Episode(GAME, seed=1) as episode:
        expected = {tool.name: tool for tool in episode.tools}
    assert sorted(tools_of(CLASS)) == sorted(expected)
    for name, tool in expected.items():
        described = get_json_schema(getattr(CLASS(), name))["function"]
        assert described["description"] == tool.description
        arguments = {key: value["description"] for key, value in tool.parameters["properties"].items()}
        properties = described["parameters"]["properties"]
        assert {key: value["description"] for key, value in properties.items()} == arguments


def test_games_have_their_own_actions():
    environment("RockPaperScissorBasic-v0")
    assert "1. Move the top disk of rod A" in get_json_schema(CLASS().act)["function"]["description"]


@pytest.mark.parametrize(
    ("reward", "halfway", "at_the_end"), [("normalized", 2 / 3, 1.0), ("score", 2.0, 3.0), ("return", 0.0, 100.0)]
)
def test_the_reward_is_that_of_the_game_so_far(reward, halfway, at_the_end):
    one = begun(reward=reward)
    for short in WAY[:6]:
        one.act(move(short))
    assert one.get_reward() == pytest.approx(halfway)
    assert one.get_reward() == pytest.approx(halfway), "asking twice changes nothing"
    assert (one.episode.result.end_reason, one.episode.result.steps) == ("host", 6)
    one.reset(seed=1)
    for short in WAY:
        one.act(move(short))
    assert one.get_reward() == at_the_end
    assert one.episode.result.end_reason == "terminated"


def test_a_game_without_a_human_score_needs_another_reward():
    with pytest.raises(sp.InvalidArgumentError, match='reward="score"'):
        environment("Hanoi4Disk-v0")
    environment("Hanoi4Disk-v0", reward="score")
    with pytest.raises(sp.InvalidArgumentError, match="must be one of normalized, score, return"):
        environment(GAME, reward="best")


def test_a_dataset_without_seeds_is_refused():
    with pytest.raises(sp.InvalidArgumentError, match="column `seed`"):
        CLASS().reset(prompt="Play.")


def test_an_environment_is_used_again(tmp_path):
    one = begun(records=tmp_path)
    one.act(move(WAY[0]))
    one.reset(seed=2, prompt="")
    assert one.episode.progress.steps == 0
    one.get_reward()
    records = sorted(tmp_path.glob("*.jsonl"))
    assert [sp.read_transcript(record)[0]["config"]["seed"] for record in records] == [1, 2]
    assert all(sp.replay(record).identical for record in records)


class Scripted:
    """Generates for TRL: of the rollouts of a batch every second one plays, the others say nothing worth a reward."""

    def __init__(self, tokenizer: Any) -> None:
        self._tokenizer = tokenizer
        self.shown: list[str] = []

    def __call__(self, input_ids: torch.Tensor, **options: Any) -> torch.Tensor:
        texts = [self._tokenizer.decode(row) for row in input_ids]
        self.shown += texts
        replies = [self._tokenizer(self._reply(at, text) + "<|im_end|>")["input_ids"] for at, text in enumerate(texts)]
        longest = max(map(len, replies))
        padded = [reply + [self._tokenizer.pad_token_id] * (longest - len(reply)) for reply in replies]
        return torch.cat([input_ids, torch.tensor(padded)], dim=-1)

    def _reply(self, at: int, text: str) -> str:
        played = text.count("<|im_start|>assistant") - 1
        if played == len(WAY) or (played == 0 and at % 2):
            return "Done."
        call = {"name": "act", "arguments": {"action": move(WAY[played])}}
        return f"<tool_call>\n{json.dumps(call)}\n</tool_call>"


def taught(tokenizer: Any, folder: Path) -> str:
    """The first prompt of an exported row, as the model's template writes it."""
    with sp.Episode(GAME, seed=1, transcript=folder / "teacher.jsonl") as episode:
        sp.play(episode, sp.get_player("rule"))
    export(folder / "teacher.jsonl", folder / "taught", "sft-chains")
    row = json.loads((folder / "taught" / "data.jsonl").read_text(encoding="utf-8").splitlines()[0])
    tools = json.loads(tools_as_text(CLASS))
    return str(tokenizer.apply_chat_template(row["prompt"], tools=tools, add_generation_prompt=True, tokenize=False))


@pytest.mark.parametrize("manual", ["tool", "pinned"])
@pytest.mark.parametrize("context", ["window", "host"])
def test_the_rows_of_a_dataset_have_the_heads_own_messages(context, manual):
    game, seeds = "MessengerL1-v0", [3, 4]
    columns = rows(game, seeds, context=context, manual=manual, split="train")
    one = environment(game, manual=manual, split="train")()
    for seed, prompt in zip(columns["seed"], columns["prompt"], strict=True):
        with sp.Episode(game, seed=seed, context=context, manual=manual, split="train") as episode:
            assert prompt == episode.head
        assert one.reset(seed=seed, prompt=prompt) is None, "nothing is appended"
    assert columns["seed"] == seeds


def test_a_row_without_the_games_messages_gets_them_as_text():
    text = CLASS().reset(seed=1, prompt=[{"role": "user", "content": "Hello. "}])
    with sp.Episode(GAME, seed=1, context="host") as episode:
        assert text == "\n\n".join(message["content"] for message in episode.head)


def test_grpo_trainer_takes_two_steps(tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("TRL_EXPERIMENTAL_SILENCE", "1")
    torch.manual_seed(0)
    tokenizer = tiny_model.tokenizer()
    model = tiny_model.model(tokenizer)
    before = {name: value.detach().clone() for name, value in model.named_parameters()}
    trainer = GRPOTrainer(
        model=model,
        processing_class=tokenizer,
        train_dataset=Dataset.from_dict(rows(GAME, [1, 2])),
        environment_factory=environment(GAME, records=tmp_path / "records"),
        args=GRPOConfig(
            output_dir=str(tmp_path / "out"),
            max_steps=2,
            per_device_train_batch_size=2,
            num_generations=2,
            max_completion_length=6000,
            max_tool_calling_iterations=10,
            learning_rate=1e-3,
            report_to="none",
            use_cpu=True,
            bf16=False,
            gradient_checkpointing=False,
            logging_steps=1,
            save_strategy="no",
        ),
    )
    generate = Scripted(tokenizer)
    monkeypatch.setattr(trainer.model, "generate", generate)
    trainer.train()

    logs = [log for log in trainer.state.log_history if "reward" in log]
    assert [log["rewards/SmartPlayHanoi3Diskv0/mean"] for log in logs] == [0.5, 0.5]
    assert [log["tools/failure_frequency"] for log in logs] == [0, 0]
    assert any((value != before[name]).any() for name, value in trainer.model.named_parameters()), "it has learnt"
    assert generate.shown[0] == taught(tokenizer, tmp_path), "the prompt is the one that exported rows teach"
    records = list((tmp_path / "records").glob("*.jsonl"))
    assert sorted(sp.read_transcript(record)[-1]["result"]["score"] for record in records) == [0, 0, 3, 3]
    assert all(sp.replay(record).identical for record in records)
