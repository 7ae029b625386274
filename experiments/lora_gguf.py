"""A LoRA adapter of a Llama model as a GGUF file that llama.cpp loads beside the model's own.

    pip install gguf
    python experiments/lora_gguf.py FOLDER TARGET.gguf

FOLDER is what `peft` has saved: `adapter_config.json`, and `adapter_model.safetensors`, which holds two small matrices
A and B for each trained matrix of the model. llama.cpp adds `alpha / rank` times B A to that matrix. The numbers are
kept in 16 bits. The same folder gives the same file, byte for byte.
"""

from __future__ import annotations

import argparse
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gguf
import numpy as np

NAMES = {
    "self_attn.q_proj": "attn_q",
    "self_attn.k_proj": "attn_k",
    "self_attn.v_proj": "attn_v",
    "self_attn.o_proj": "attn_output",
    "mlp.gate_proj": "ffn_gate",
    "mlp.up_proj": "ffn_up",
    "mlp.down_proj": "ffn_down",
}
"""The matrices of a layer, in transformers and in llama.cpp."""

HEADS = {"attn_q": 9, "attn_k": 3}
"""The matrices whose rows are rotated by position, and how many heads SmolLM2-135M has in each."""

ABOUT = {
    "general.type": "adapter",
    "adapter.type": "lora",
    "general.name": "smollm2-135m-player",
    "general.license": "apache-2.0",
    "general.description": "Plays Rock Paper Scissors and bandits through the tools of smartplay-tools.",
}


def matrices(path: Path) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield the matrices of a safetensors file by name.

    The file is a length in 8 bytes, a JSON object of that length with the place of each matrix, and the numbers.
    """
    content = path.read_bytes()
    (length,) = struct.unpack("<Q", content[:8])
    head = json.loads(content[8 : 8 + length])
    for name, about in sorted(head.items()):
        if name != "__metadata__":
            kind = {"F16": np.float16, "F32": np.float32}[about["dtype"]]
            first, end = (8 + length + place for place in about["data_offsets"])
            yield name, np.frombuffer(content[first:end], kind).reshape(about["shape"])


def translated(name: str, values: np.ndarray[Any, Any]) -> tuple[str, np.ndarray[Any, Any]]:
    """Return llama.cpp's name of a matrix, and its numbers in llama.cpp's order.

    A name is such as `base_model.model.model.layers.7.self_attn.q_proj.lora_B.weight`.
    """
    layer, _, rest = name.partition("layers.")[2].partition(".")
    part, _, which = rest.partition(".lora_")
    matrix, side = NAMES[part], which[0].lower()
    if side == "b" and matrix in HEADS:
        # transformers rotates two halves of a head, llama.cpp neighbouring numbers.
        heads, (rows, rank) = HEADS[matrix], values.shape
        values = values.reshape(heads, 2, rows // heads // 2, rank).swapaxes(1, 2).reshape(rows, rank)
    return f"blk.{layer}.{matrix}.weight.lora_{side}", values.astype(np.float16)


def write(folder: Path, target: Path) -> None:
    """Write the adapter in a folder as a GGUF file."""
    config = json.loads((folder / "adapter_config.json").read_text(encoding="utf-8"))
    writer = gguf.GGUFWriter(target, "llama")
    for name, text in ABOUT.items():
        writer.add_string(name, text)
    writer.add_float32("adapter.lora.alpha", float(config["lora_alpha"]))
    for name, values in matrices(folder / "adapter_model.safetensors"):
        writer.add_tensor(*translated(name, values))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="what peft has saved")
    parser.add_argument("target", type=Path, help="the file to write")
    asked = parser.parse_args()
    write(asked.folder, asked.target)
