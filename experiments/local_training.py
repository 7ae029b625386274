"""The training of the model in the box: a LoRA adapter of SmolLM2-135M, by a teacher's replies.

    pip install 'smartplay-tools[train,local]' accelerate gguf
    smartplay-tools model get
    python experiments/local_training.py teach --out runs/taught    # rule plays worlds that nobody is evaluated on
    python experiments/local_training.py tune --out runs/taught     # learns its replies; --rewritten 0.3, --seed 1
    smartplay-tools play RockPaperScissorBasic-v0 --player local --player-option adapter=runs/taught/adapter.gguf

The same commands run on CUDA where there is an accelerator, and on the processor, where `--tokens` has to be small.
`tune` begins with the adapter of the folder, if it has one, and saves it every few minutes in the form that llama.cpp
loads beside the model. A prompt is exactly the text that the player `local` sends. With `--rewritten` that share of the
earlier results in each row is masked, drawn by the seed, so that the model meets histories that were compacted.
`--lesson lockers` teaches the game of lockers, in `reader`'s replies.
"""

from __future__ import annotations

import argparse
import json
import random
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, count, repeat
from pathlib import Path
from statistics import fmean
from typing import Any

import gguf
import numpy as np
import torch
from smartplay_local.model_files import find_model
from smartplay_local.text import Format, as_text
from torch.nn.functional import cross_entropy
from transformers import AutoModelForCausalLM, AutoTokenizer

import smartplay_tools as sp
from smartplay_tools.evaluation.exports import export

MODEL = "smollm2-135m"
RANK, ALPHA = 16, 32
TEACHING_SEED = 1
"""The first seed of the worlds of teaching; the experiments play others."""


@dataclass(frozen=True)
class Lesson:
    """What is taught: the games and how many worlds of each under every budget, the teacher, the format of calls."""

    worlds: Mapping[str, int]
    teacher: str
    budgets: Sequence[sp.Budget]
    form: Format = "text"
    rules: Mapping[str, Any] = field(default_factory=dict)
    """Fields of `evaluate` that are not its defaults."""


LESSONS = {
    "games": Lesson(
        {
            "RockPaperScissorBasic-v0": 40,
            "RockPaperScissorDifferentScore-v0": 40,
            "BanditTwoArmedHighLowFixed-v0": 20,
            "BanditTwoArmedHighHighFixed-v0": 20,
            "BanditTwoArmedLowLowFixed-v0": 20,
            "BanditTwoArmedDeterministicFixed-v0": 20,
            "Hanoi3Disk-v0": 4,
            "MessengerL1-v0": 40,
            "MessengerL2-v0": 40,
        },
        "rule",
        [
            *(sp.Budget(prompt_tokens=cap, slack=0.5) for cap in (700, 1_000, 1_500)),
            sp.Budget(),
            sp.Budget(prompt_tokens=1_000, slack=0.5, notes_tokens=60),
        ],
    ),
    "lockers": Lesson(
        {"Lockers4-v0": 1_000, "Lockers8-v0": 1_000},
        "reader",
        [sp.Budget(history=None)],
        "legal",
        {"manual": "pinned", "first_observation": "prompt", "offered_tools": "useful"},
    ),
}
SAVED_EVERY = 240.0
"""Seconds between two saved adapters."""
MASKED = "This result was removed."
"""What a rewritten result says in training."""
MATRICES = {
    "self_attn.q_proj": "attn_q",
    "self_attn.k_proj": "attn_k",
    "self_attn.v_proj": "attn_v",
    "self_attn.o_proj": "attn_output",
    "mlp.gate_proj": "ffn_gate",
    "mlp.up_proj": "ffn_up",
    "mlp.down_proj": "ffn_down",
}
"""The trained matrices of a layer, in transformers and in llama.cpp."""

Sample = tuple[list[int], list[float]]
"""Tokens, and the weight of each in the loss: 0 where it is not the model's."""


def teach(lesson: Lesson, out: Path, most: int) -> None:
    """Let the teacher play at most so many worlds of each game under every budget, and export its records."""
    for game, worlds in lesson.worlds.items():
        given: Any = {"trials": min(worlds, most), "seed": TEACHING_SEED, "executor": "inline", **lesson.rules}
        sp.evaluate([game], [lesson.teacher], budgets=lesson.budgets, out=out / "played" / game, **given)
        if not (out / "data" / game).exists():
            export(out / "played" / game, out / "data" / game, "sft-chains")


class LowRank(torch.nn.Module):
    """The product of two small matrices, which is trained and added to a matrix of the model."""

    def __init__(self, like: torch.Tensor) -> None:
        super().__init__()
        self.a = torch.nn.Parameter(torch.randn(RANK, like.shape[1], device=like.device) / like.shape[1] ** 0.5)
        self.b = torch.nn.Parameter(torch.zeros(like.shape[0], RANK, device=like.device))

    def add(self, layer: torch.nn.Module, given: tuple[torch.Tensor], result: torch.Tensor) -> torch.Tensor:
        """Return the result of a layer with this one's share; a hook of the layer."""
        return result + ALPHA / RANK * given[0] @ self.a.to(result.dtype).T @ self.b.to(result.dtype).T


class Student:
    """The model with its adapter, on the device of this machine."""

    def __init__(self, seed: int, form: Format, dtype: str) -> None:
        torch.manual_seed(seed)
        self._form = form
        self.device = "cuda" if torch.cuda.is_available() else "cpu"
        source = find_model(MODEL)
        self._tokenizer = AutoTokenizer.from_pretrained(source.parent, gguf_file=source.name)
        self._model: Any = AutoModelForCausalLM.from_pretrained(source.parent, gguf_file=source.name, dtype=dtype)
        self._model.requires_grad_(False).to(self.device)
        self._end = self._tokenizer.convert_tokens_to_ids("<|im_end|>")
        self._ids_of: dict[str, list[int]] = {}
        self._parts: dict[str, LowRank] = {}
        for number, layer in enumerate(self._model.model.layers):
            for name, matrix in MATRICES.items():
                linear = layer.get_submodule(name)
                self._parts[f"blk.{number}.{matrix}"] = LowRank(linear.weight)
                linear.register_forward_hook(self._parts[f"blk.{number}.{matrix}"].add)
        weights = chain.from_iterable(part.parameters() for part in self._parts.values())
        self._weights = list(weights)
        self._optimizer = torch.optim.AdamW(self._weights, betas=(0.9, 0.98), weight_decay=0.0)

    def _ids(self, text: str) -> list[int]:
        if text not in self._ids_of:
            self._ids_of[text] = self._tokenizer.encode(text, add_special_tokens=False)
        return self._ids_of[text]

    def encode(self, messages: Iterable[Any], tools: Sequence[sp.ToolSpec], taught: int = 0) -> Sample:
        """Return the tokens of messages as the chat template writes them; the last `taught` replies are trained."""
        ids: list[int] = []
        weights: list[float] = []
        written = as_text(messages, tools, self._form)
        untaught = sum(message["role"] == "assistant" for message in written) - taught
        for message in written:
            is_reply = message["role"] == "assistant"
            head, body = self._ids(f"<|im_start|>{message['role']}\n"), self._ids(f"{message['content']}<|im_end|>")
            ids += [*head, *body, *self._ids("\n")]
            weights += [*[0.0] * len(head), *[float(is_reply and untaught <= 0)] * len(body), 0.0]
            untaught -= is_reply
        return ids, weights

    def learn(self, samples: Sequence[Sample], rate: float) -> float:
        """Take one step of the optimizer on some samples; return the loss."""
        longest = max(len(ids) for ids, _ in samples)
        ids = torch.tensor([[*ids, *[self._end] * (longest - len(ids))] for ids, _ in samples], device=self.device)
        padded = [[*weights, *[0.0] * (longest - len(weights))] for _, weights in samples]
        weights = torch.tensor(padded, device=self.device)[:, 1:]
        states = self._model.model(input_ids=ids, use_cache=False).last_hidden_state[:, :-1][weights != 0]
        losses = cross_entropy(self._model.lm_head(states).float(), ids[:, 1:][weights != 0], reduction="none")
        loss = (losses * weights[weights != 0]).sum() / max(1, int((weights != 0).sum()))
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        self._optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self._weights, 1.0)
        self._optimizer.step()
        return float(loss.item())

    def load(self, file: Path) -> None:
        """Take over the adapter in a file."""
        for tensor in gguf.GGUFReader(file).tensors:
            name, _, side = tensor.name.removesuffix(".weight").rpartition(".weight.lora_")
            values = torch.from_numpy(np.array(tensor.data, dtype=np.float32))
            matrix = getattr(self._parts[name], side)
            matrix.data = self._turned(name, side, values, back=True).to(matrix.device)

    def save(self, file: Path) -> None:
        """Write the adapter for llama.cpp, in 16 bits."""
        writer = gguf.GGUFWriter(part := file.with_suffix(".part"), "llama")
        about = {"general.type": "adapter", "adapter.type": "lora", "general.name": "smollm2-135m-player"}
        for name, text in {**about, "general.license": "apache-2.0"}.items():
            writer.add_string(name, text)
        writer.add_float32("adapter.lora.alpha", float(ALPHA))
        for name, low_rank in self._parts.items():
            for side in "ab":
                values = self._turned(name, side, getattr(low_rank, side).detach().float().cpu())
                writer.add_tensor(f"{name}.weight.lora_{side}", values.numpy().astype(np.float16))
        writer.write_header_to_file()
        writer.write_kv_data_to_file()
        writer.write_tensors_to_file()
        writer.close()
        part.replace(file)

    def _turned(self, name: str, side: str, values: torch.Tensor, *, back: bool = False) -> torch.Tensor:
        """Return the rows in llama.cpp's order: it rotates neighbouring numbers of a head, transformers two halves."""
        config = self._model.config
        heads = {"attn_q": config.num_attention_heads, "attn_k": config.num_key_value_heads}.get(name.split(".")[2])
        if side == "a" or heads is None:
            return values
        parts = (-1, 2) if back else (2, -1)
        return values.reshape(heads, *parts, values.shape[1]).transpose(1, 2).reshape(values.shape).contiguous()


def rows(out: Path) -> Iterator[Mapping[str, Any]]:
    """Yield the exported rows of all games."""
    for file in sorted((out / "data").glob("*/data.jsonl")):
        yield from map(json.loads, file.read_text(encoding="utf-8").splitlines())


def sample_of(student: Student, row: Mapping[str, Any], rewritten: float, draw: random.Random) -> Sample:
    """Return the tokens of a row, some of whose earlier results are masked."""
    tools = [sp.ToolSpec(**tool["function"]) for tool in json.loads(row["tools"])]
    prompt = [
        {**message, "content": MASKED} if message["role"] == "tool" and draw.random() < rewritten else message
        for message in row["prompt"]
    ]
    taught = sum(message["role"] == "assistant" for message in row["completion"])
    return student.encode([*prompt, *row["completion"]], tools, taught)


def tune(student: Student, out: Path, *, tokens: int, rate: float, rewritten: float, seed: int) -> None:
    """Learn the replies of the rows until `tokens` tokens were read."""
    draw = random.Random(seed)
    samples = [sample_of(student, row, rewritten, draw) for row in rows(out)]
    held = min(tokens, 32_768 if student.device == "cuda" else 2_048)
    read, losses, saved = 0, list[float](), time.monotonic()
    for step, batch in zip(
        count(1), chain.from_iterable(batches(samples, held, draw) for _ in repeat(None)), strict=False
    ):
        losses.append(student.learn(batch, rate * min(1.0, step / 30) * max(0.02, 1 - read / tokens)))
        read += sum(len(ids) for ids, _ in batch)
        if step % 20 == 0 or read >= tokens:
            print(f"{step} steps, {read:,} tokens, loss {fmean(losses[-20:]):.4f}", flush=True)
        if read >= tokens or time.monotonic() - saved > SAVED_EVERY:
            student.save(out / "adapter.gguf")
            saved = time.monotonic()
        if read >= tokens:
            return


def batches(samples: Sequence[Sample], tokens: int, draw: random.Random) -> list[list[Sample]]:
    """Return samples of like length in batches of some tokens, in an order that is drawn."""
    made: list[list[Sample]] = [[]]
    for sample in sorted(samples, key=lambda sample: (len(sample[0]) // 32, draw.random())):
        if made[-1] and (len(made[-1]) + 1) * len(sample[0]) > tokens:
            made.append([])
        made[-1].append(sample)
    draw.shuffle(made)
    return made


def main() -> None:
    """Teach or tune."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("teach", "tune"))
    parser.add_argument("--out", type=Path, default=Path("runs/taught"), help="the folder of data and adapter")
    parser.add_argument("--lesson", choices=LESSONS, default="games", help="what is taught")
    parser.add_argument("--worlds", type=int, default=1_000, help="the most worlds of each game and budget of `teach`")
    parser.add_argument("--tokens", type=int, default=18_000_000, help="tokens that `tune` reads")
    parser.add_argument("--rewritten", type=float, default=0.0, help="the share of earlier results that is masked")
    parser.add_argument("--rate", type=float, default=1e-3, help="the learning rate of `tune`")
    parser.add_argument("--dtype", default="float32", help="of the weights: bfloat16 on CUDA and newer processors")
    parser.add_argument("--seed", type=int, default=0, help="of the weights and of all that is drawn")
    asked = parser.parse_args()
    lesson = LESSONS[asked.lesson]
    if asked.what == "teach":
        teach(lesson, asked.out, asked.worlds)
        return
    student = Student(asked.seed, lesson.form, asked.dtype)
    if (adapter := asked.out / "adapter.gguf").exists():
        student.load(adapter)
    tune(student, asked.out, tokens=asked.tokens, rate=asked.rate, rewritten=asked.rewritten, seed=asked.seed)


if __name__ == "__main__":
    main()
