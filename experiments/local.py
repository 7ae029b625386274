"""A real model of 135 million parameters, as it is and fine-tuned on a teacher's records: the rows of `docs/local.md`.

    smartplay-tools model get
    python experiments/local.py tune  --out runs/local    # extra `train`, and gguf; minutes
    python experiments/local.py play  --out runs/local    # extra `local`; both models, a row for each episode
    python experiments/local.py table --publish           # the table of the page, from the published rows

`tune` lets `rule` play worlds that nobody is evaluated on, exports the records as `sft-chains`, and trains the last
layers of SmolLM2 on the replies, in exactly the text that `--player local` sends. The weights of the downloaded file
are read, and a file of the same format is written again, so that both models are played by the same engine.
"""

from __future__ import annotations

import argparse
import json
import random
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import smartplay_tools as sp
from smartplay_tools.evaluation import PlayerConfig
from smartplay_tools.evaluation.analysis import by_cell
from smartplay_tools.exports import export
from smartplay_tools.models import find_model
from smartplay_tools.records.rows import Row, read_rows
from smartplay_tools.types import MISTAKES

if TYPE_CHECKING:
    import torch

GAMES = ("RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0")
CAPS = (700, 1_000, 1_500)
MODEL, TUNED = "smollm2-135m", "smollm2-135m-taught.gguf"
TEACHING_SEED, SEED = 1, 0
"""The worlds of teaching and of playing are different ones."""
LAYERS = 8
"""How many of the 30 layers are trained, the last ones."""
HERE = Path(__file__).parent
PUBLISHED = HERE / "local"

Sample = tuple[list[int], list[bool]]
"""The tokens of a conversation, and which of them are trained."""


def budgets() -> list[sp.Budget]:
    """The three caps; half of a full window is dropped at once, so that the engine keeps what it has read."""
    return [sp.Budget(prompt_tokens=cap, slack=0.5) for cap in CAPS]


def teach(out: Path, worlds: int) -> list[dict[str, Any]]:
    """Let `rule` play, and return the rows of its records, shuffled."""
    data = out / "data"
    if not data.exists():
        sp.evaluate(GAMES, ["rule"], budgets=budgets(), trials=worlds, seed=TEACHING_SEED, out=out / "taught")
        export(out / "taught", data, "sft-chains")
    rows = [json.loads(line) for line in (data / "data.jsonl").read_text(encoding="utf-8").splitlines()]
    random.Random(0).shuffle(rows)
    return rows


def encode(tokenizer: Any, row: dict[str, Any]) -> Sample:
    """Return the tokens of a row as the engine's chat template writes it."""
    from smartplay_local.text import as_text

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


def tune(out: Path, *, worlds: int, tokens: int, rate: float) -> None:
    """Train the last layers until `tokens` tokens were read, and write the model's file."""
    import torch
    from transformers import AutoModelForCausalLM, AutoTokenizer

    torch.set_num_threads(1)
    torch.manual_seed(0)
    source = find_model(MODEL)
    tokenizer = AutoTokenizer.from_pretrained(source.parent, gguf_file=source.name)
    model = AutoModelForCausalLM.from_pretrained(source.parent, gguf_file=source.name, dtype=torch.float32)
    samples = [encode(tokenizer, row) for row in teach(out, worlds)]
    first = len(model.model.layers) - LAYERS
    for name, weights in model.named_parameters():
        weights.requires_grad = name.startswith("model.layers.") and int(name.split(".")[2]) >= first
    trained = [weights for weights in model.parameters() if weights.requires_grad]
    optimizer = torch.optim.AdamW(trained, lr=rate, weight_decay=0.0)
    read, replies, losses = 0, 0, []
    for step, batch in enumerate(_batches(samples), start=1):
        for group in optimizer.param_groups:
            group["lr"] = rate * min(1.0, step / 10) * max(0.05, 1 - read / tokens)
        optimizer.zero_grad()
        loss = _loss(model, batch)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(trained, 1.0)
        optimizer.step()
        losses.append(loss.item())
        read += sum(len(ids) for ids, _ in batch)
        replies += sum(sum(mask) for _, mask in batch)
        if step % 10 == 0 or read >= tokens:
            recent = losses[-10:]
            print(f"{step} steps, {read:,} tokens, {replies:,} trained, loss {fmean(recent):.3f}", flush=True)
        if read >= tokens:
            break
    write_gguf(source, out / TUNED, model, first)


def _batches(samples: Sequence[Sample]) -> Iterator[Sequence[Sample]]:
    draw = random.Random(0)
    while True:
        order = list(samples)
        draw.shuffle(order)
        for at in range(0, len(order) - 1, 2):
            yield order[at : at + 2]


def _loss(model: Any, batch: Sequence[Sample]) -> torch.Tensor:
    import torch

    longest = max(len(ids) for ids, _ in batch)
    ids = torch.tensor([ids + [0] * (longest - len(ids)) for ids, _ in batch])
    mask = torch.tensor([mask + [False] * (longest - len(mask)) for _, mask in batch])[:, 1:]
    with torch.autocast("cpu", dtype=torch.bfloat16):
        hidden = model.model(input_ids=ids).last_hidden_state[:, :-1][mask]
        logits = model.lm_head(hidden)
    return torch.nn.functional.cross_entropy(logits.float(), ids[:, 1:][mask])


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


def write_gguf(source: Path, target: Path, model: Any, first: int) -> None:
    """Write a copy of a model's file in which the layers from `first` on are those of `model`, in 16 bits."""
    import gguf
    import numpy as np

    heads = {"attn_q": model.config.num_attention_heads, "attn_k": model.config.num_key_value_heads}
    layers = {}
    for name, weights in model.model.layers.named_parameters():
        layer, part = int(name.split(".")[0]), NAMES[name.split(".", 1)[1].removesuffix(".weight")]
        values = weights.detach().float().numpy()
        if part in heads:  # llama.cpp rotates neighbouring dimensions, transformers the two halves of a head
            halves = values.reshape(heads[part], 2, values.shape[0] // heads[part] // 2, -1)
            values = halves.swapaxes(1, 2).reshape(values.shape)
        if layer >= first:
            layers[f"blk.{layer}.{part}.weight"] = values.astype(np.float16 if values.ndim == 2 else np.float32)
    reader = gguf.GGUFReader(source)
    writer = gguf.GGUFWriter(target, "llama")
    for field in reader.fields.values():
        if not field.name.startswith("GGUF.") and field.name != "general.architecture":
            kinds = field.types
            inner = kinds[-1] if kinds[0] == gguf.GGUFValueType.ARRAY else None
            writer.add_key_value(field.name, field.contents(), kinds[0], inner)
    for tensor in reader.tensors:
        if tensor.name in layers:
            writer.add_tensor(tensor.name, layers[tensor.name])
        else:
            writer.add_tensor(tensor.name, tensor.data, raw_dtype=tensor.tensor_type)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()


def play(out: Path, *, models: Sequence[str], trials: int, caps: Sequence[int]) -> None:
    """Play the worlds with models; what was played is not played again."""
    for model in models:
        player = PlayerConfig(name=f"local:{model}", options={"threads": 1})
        sp.evaluate(
            GAMES,
            [player],
            budgets=[sp.Budget(prompt_tokens=cap, slack=0.5) for cap in caps],
            trials=trials,
            seed=SEED,
            out=out / Path(model).stem,
            executor="inline",
        )


def table(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: what became of the episodes of every model, game and cap."""
    heads = ("model", "game", "cap", "worlds", "mean score", "steps", "calls", "illegal", "malformed", "ended as")
    lines = [f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}"]
    for cell, members in by_cell(rows):
        sums = [sum(row[name] for row in members) for name in ("steps", "tool_calls", *MISTAKES[:2])]
        ends = ", ".join(sorted({row["end_reason"] for row in members}))
        score = fmean(row["score"] for row in members)
        cap = f"{cell.budget['prompt_tokens']:,}"
        named = (cell.player.removeprefix("local:"), f"`{cell.game}`", cap, len(members), f"{score:g}", *sums, ends)
        lines.append(f"| {' | '.join(map(str, named))} |")
    return "\n".join(lines)


def publish(written: str) -> None:
    """Put the table between its marks in the page."""
    page = HERE.parent / "docs" / "local.md"
    marked = re.compile(r"(<!-- table: local -->\n)(.*?)(<!-- end -->)", flags=re.DOTALL)
    text = marked.sub(lambda match: f"{match[1]}\n{written}\n\n{match[3]}", page.read_text(encoding="utf-8"))
    page.write_text(text, encoding="utf-8")


def main() -> None:
    """Tune, play, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("tune", "play", "table"))
    parser.add_argument("--out", type=Path, default=Path("runs/local"))
    parser.add_argument("--worlds", type=int, default=40, help="worlds of each game and cap that the teacher plays")
    parser.add_argument("--tokens", type=int, default=80_000, help="tokens that are read in training")
    parser.add_argument("--rate", type=float, default=5e-4, help="the learning rate")
    parser.add_argument("--model", action="append", help="play with this model alone: a name, or a GGUF file")
    parser.add_argument("--trials", type=int, default=5, help="worlds of each game and cap that a model plays")
    parser.add_argument("--caps", type=int, nargs="+", default=CAPS, help="play under these caps alone")
    parser.add_argument("--publish", action="store_true", help="put the table into the page")
    asked = parser.parse_args()
    if asked.what == "table":
        files = sorted(PUBLISHED.glob("*/results.jsonl"))
        written = table([row for path in files for row in read_rows(path)])
        print(written)
        if asked.publish:
            publish(written)
    if asked.what == "play":
        models = asked.model or (MODEL, str(asked.out / TUNED))
        play(asked.out, models=models, trials=asked.trials, caps=asked.caps)
    if asked.what == "tune":
        tune(asked.out, worlds=asked.worlds, tokens=asked.tokens, rate=asked.rate)


if __name__ == "__main__":
    main()
