"""Training of the last layers of a model that llama.cpp plays, from its file to a file of the same format.

The weights are read from a GGUF file, the last layers learn the replies of exported rows, and a copy of the file is
written with those layers replaced. What the other layers make of a row is computed once and kept, so reading a row
again costs the last layers alone. Every few minutes the state of training and the file are saved; a training that was
stopped continues from there.
"""

from __future__ import annotations

import json
import random
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import count
from pathlib import Path
from statistics import fmean
from typing import Any

import gguf
import numpy as np
import torch
from smartplay_local.text import as_text
from transformers import AutoModelForCausalLM, AutoTokenizer

import smartplay_tools as sp

Sample = tuple[list[int], list[bool]]
"""The tokens of a conversation, and which of them are trained."""

SAVED_EVERY = 240.0
"""Seconds between two saved states."""


def encode(tokenizer: Any, row: Mapping[str, Any]) -> Sample:
    """Return the tokens of a row as the engine's chat template writes it; its last replies are trained."""
    tools = [sp.ToolSpec(**tool["function"]) for tool in json.loads(row["tools"])]
    earlier = sum(message["role"] == "assistant" for message in row["prompt"])
    ids: list[int] = []
    trained: list[bool] = []
    for message in as_text([*row["prompt"], *row["completion"]], tools):
        is_reply = message["role"] == "assistant"
        head = tokenizer.encode(f"<|im_start|>{message['role']}\n", add_special_tokens=False)
        body = tokenizer.encode(f"{message['content']}<|im_end|>", add_special_tokens=False)
        end = tokenizer.encode("\n", add_special_tokens=False)
        ids += head + body + end
        trained += [False] * len(head) + [is_reply and earlier <= 0] * len(body) + [False] * len(end)
        earlier -= is_reply
    return ids, trained


class Training:
    """The last layers of a model, and the rows that they learn from.

    Arguments:
        source: the GGUF file of the model.
        target: the file to write; the state of training is saved beside it.
        rows: rows of `sft-chains`.
        layers: how many layers are trained, the last ones.
    """

    def __init__(self, source: Path, target: Path, rows: Sequence[Mapping[str, Any]], layers: int) -> None:
        torch.manual_seed(0)
        self._source, self._target, self._state = source, target, target.with_suffix(".pt")
        self._tokenizer = AutoTokenizer.from_pretrained(source.parent, gguf_file=source.name)
        self._model: Any = AutoModelForCausalLM.from_pretrained(
            source.parent, gguf_file=source.name, dtype=torch.float32
        )
        self._model.requires_grad_(False)
        body = self._model.model
        self._first = len(body.layers) - layers
        self._parts = ((body.layers[: self._first], torch.nn.Identity()), (body.layers[self._first :], body.norm))
        self._trained = [weights.requires_grad_() for weights in self._parts[1][0].parameters()]
        self._samples = [encode(self._tokenizer, row) for row in rows]
        self._read_before: dict[int, torch.Tensor] = {}

    @cached_property
    def replies(self) -> int:
        """The number of trained tokens in all rows."""
        return sum(sum(trained) for _, trained in self._samples)

    def run(self, tokens: int, rate: float) -> None:
        """Train until `tokens` tokens were read, rows that are read again included, and write the file."""
        optimizer = torch.optim.AdamW(self._trained, lr=rate, weight_decay=0.0)
        done, read = self._resume(optimizer)
        losses: list[float] = []
        saved, began = time.monotonic(), time.process_time()
        print(f"{len(self._samples)} rows, {self.replies:,} tokens of replies", flush=True)
        for step, batch in zip(count(1), self._batches(), strict=False):
            if step <= done:
                continue
            for group in optimizer.param_groups:
                group["lr"] = rate * min(1.0, step / 10) * max(0.05, 1 - read / tokens)
            losses.append(self._learn(batch, optimizer))
            read += sum(len(self._samples[at][0]) for at in batch)
            is_last = read >= tokens
            if step % 5 == 0 or is_last:
                seconds = time.process_time() - began
                print(f"{step} steps, {read:,} tokens, {seconds:.0f} s, loss {fmean(losses[-20:]):.4f}", flush=True)
            if is_last or time.monotonic() - saved > SAVED_EVERY:
                saved = time.monotonic()
                self._save(optimizer, step, read)
            if is_last:
                return

    def _resume(self, optimizer: torch.optim.Optimizer) -> tuple[int, int]:
        """The steps and tokens of a training that was stopped, whose state is taken over."""
        if not self._state.exists():
            return 0, 0
        state = torch.load(self._state)
        optimizer.load_state_dict(state["optimizer"])
        self._parts[1][0].load_state_dict(state["layers"])
        return state["steps"], state["read"]

    def _save(self, optimizer: torch.optim.Optimizer, steps: int, read: int) -> None:
        layers = self._parts[1][0].state_dict()
        state = {"steps": steps, "read": read, "optimizer": optimizer.state_dict(), "layers": layers}
        torch.save(state, self._state.with_suffix(".part"))
        self._state.with_suffix(".part").replace(self._state)
        write_gguf(self._source, self._target, self._weights())

    def _batches(self, rows: int = 2) -> Iterator[Sequence[int]]:
        """Numbers of rows of like length, without end, in an order that is drawn."""
        draw = random.Random(0)
        while True:
            order = sorted(range(len(self._samples)), key=lambda at: (len(self._samples[at][0]) // 50, draw.random()))
            batches = [order[at : at + rows] for at in range(0, len(order), rows)]
            draw.shuffle(batches)
            yield from batches

    def _learn(self, batch: Sequence[int], optimizer: torch.optim.Optimizer) -> float:
        states = torch.nn.utils.rnn.pad_sequence([self._before(at) for at in batch], batch_first=True)
        samples = [self._samples[at] for at in batch]
        longest = states.shape[1]
        ids = torch.tensor([ids + [0] * (longest - len(ids)) for ids, _ in samples])
        trained = torch.tensor([mask + [False] * (longest - len(mask)) for _, mask in samples])[:, 1:]
        optimizer.zero_grad()
        hidden = self._through(1, inputs_embeds=states)[:, :-1][trained]
        loss = torch.nn.functional.cross_entropy(self._model.lm_head(hidden), ids[:, 1:][trained])
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self._trained, 1.0)
        optimizer.step()
        return loss.item()

    def _before(self, at: int) -> torch.Tensor:
        """What the layers that are not trained make of a row."""
        if at not in self._read_before:
            with torch.no_grad():
                ids = torch.tensor([self._samples[at][0]])
                self._read_before[at] = self._through(0, input_ids=ids)[0]
        return self._read_before[at]

    def _through(self, part: int, **inputs: torch.Tensor) -> torch.Tensor:
        body = self._model.model
        body.layers, body.norm = self._parts[part]
        states: torch.Tensor = body(**inputs, use_cache=False).last_hidden_state
        return states

    def _weights(self) -> dict[str, np.ndarray]:
        """The trained weights by their names in the file, in 16 bits where they are matrices."""
        config = self._model.config
        heads = {"attn_q": config.num_attention_heads, "attn_k": config.num_key_value_heads}
        weights = {}
        for name, trained in self._parts[1][0].named_parameters():
            layer, part = name.removesuffix(".weight").split(".", 1)
            values = trained.detach().numpy()
            if (named := NAMES[part]) in heads:  # llama.cpp rotates neighbouring dimensions, transformers two halves
                halves = values.reshape(heads[named], 2, values.shape[0] // heads[named] // 2, -1)
                values = halves.swapaxes(1, 2).reshape(values.shape)
            kind = np.float16 if values.ndim == 2 else np.float32
            weights[f"blk.{self._first + int(layer)}.{named}.weight"] = values.astype(kind)
        return weights


NAMES = {
    "self_attn.q_proj": "attn_q",
    "self_attn.k_proj": "attn_k",
    "self_attn.v_proj": "attn_v",
    "self_attn.o_proj": "attn_output",
    "mlp.gate_proj": "ffn_gate",
    "mlp.up_proj": "ffn_up",
    "mlp.down_proj": "ffn_down",
    "input_layernorm": "attn_norm",
    "post_attention_layernorm": "ffn_norm",
}
"""The parts of a layer, in transformers and in llama.cpp."""


def write_gguf(source: Path, target: Path, weights: Mapping[str, np.ndarray]) -> None:
    """Write a copy of a model's file in which some weights are others."""
    reader = gguf.GGUFReader(source)
    part = target.with_suffix(".gguf.part")
    writer = gguf.GGUFWriter(part, "llama")
    for field in reader.fields.values():
        if not field.name.startswith("GGUF.") and field.name != "general.architecture":
            kinds = field.types
            inner = kinds[-1] if kinds[0] == gguf.GGUFValueType.ARRAY else None
            writer.add_key_value(field.name, field.contents(), kinds[0], inner)
    for tensor in reader.tensors:
        if tensor.name in weights:
            writer.add_tensor(tensor.name, weights[tensor.name])
        else:
            writer.add_tensor(tensor.name, tensor.data, raw_dtype=tensor.tensor_type)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    part.replace(target)
