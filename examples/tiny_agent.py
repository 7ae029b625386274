"""A tiny transformer that plays by tool calls: its tokenizer, its training on exported rows, play, and rewards.

`20_train_a_tiny_agent.py` uses it in order. The model is Llama's architecture with a quarter of a million parameters,
trained from scratch, with CUDA where there is a graphics card and on the processor otherwise. Its tokenizer is made
from the rows: text that returns in every prompt becomes a single token, which keeps prompts short enough for a laptop.
It knows nothing but the games that it was shown.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any

import torch
from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
from torch.nn.functional import cross_entropy
from transformers import LlamaConfig, LlamaForCausalLM, PreTrainedTokenizerFast

import smartplay_tools as sp

Row = dict[str, Any]
Sample = tuple[list[int], list[bool]]
"""The tokens of a conversation, and which of them are trained."""

SPECIAL = ("<pad>", "<system>", "<user>", "<assistant>", "<tool>", "<tool_call>", "</tool_call>", "<end>")
# Names and descriptions of the tools are the same in every prompt, and a model of one set of tools does not need them.
TEMPLATE = """{%- for m in messages %}<{{ m.role }}>{% generation %}{{ m.content or '' }}
{%- for c in m.tool_calls or [] %}<tool_call>{"name": "{{ c.function.name }}", "arguments": {{ c.function.arguments }}}
{%- raw %}{% endraw %}</tool_call>{% endfor %}<end>{% endgeneration %}{% endfor %}
{%- if add_generation_prompt %}<assistant>{% endif %}"""
CALL = re.compile(r"<tool_call>(.*?)</tool_call>", re.DOTALL)


def read_rows(folder: Path) -> list[Row]:
    """Read the rows of an export."""
    return [json.loads(line) for line in (folder / "data.jsonl").read_text(encoding="utf-8").splitlines()]


def make_tokenizer(rows: Sequence[Row], size: int = 2048) -> PreTrainedTokenizerFast:
    """Learn the pieces of text that the rows are made of; a sentence can be one piece, a digit always is."""
    tokenizer = Tokenizer(models.BPE())
    digits = pre_tokenizers.Digits(individual_digits=True)
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence([digits, pre_tokenizers.ByteLevel(False, use_regex=False)])
    tokenizer.decoder = decoders.ByteLevel()
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    trainer = trainers.BpeTrainer(
        vocab_size=size, special_tokens=list(SPECIAL), initial_alphabet=alphabet, show_progress=False
    )
    tokenizer.train_from_iterator(_texts(rows), trainer)
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer, eos_token="<end>", pad_token="<pad>", chat_template=TEMPLATE
    )


def _texts(rows: Iterable[Row]) -> Iterator[str]:
    for row in rows:
        for message in [*row["prompt"], *row["completion"]]:
            yield message.get("content") or ""
            for function in (call["function"] for call in message.get("tool_calls") or []):
                yield f'{{"name": "{function["name"]}", "arguments": {function["arguments"]}}}'


def encode(tokenizer: PreTrainedTokenizerFast, row: Row) -> Sample:
    """Return the tokens of a row of `sft-chains`; its replies in `completion` are trained."""
    tokens: list[int] = []
    trained: list[bool] = []
    for at, message in enumerate([*row["prompt"], *row["completion"]]):
        ids = _message_tokens(tokenizer, json.dumps(message))
        is_trained = at >= len(row["prompt"]) and message["role"] == "assistant"
        tokens += ids
        trained += [False] + [is_trained] * (len(ids) - 1)  # the first token says whose message it is
    return tokens, trained


def prompt_tokens(tokenizer: PreTrainedTokenizerFast, messages: Iterable[Any]) -> list[int]:
    """Return the tokens of a prompt, which the first token of a reply ends."""
    parts = [_message_tokens(tokenizer, json.dumps(message)) for message in messages]
    return [*chain.from_iterable(parts), tokenizer.convert_tokens_to_ids("<assistant>")]


@lru_cache(maxsize=100_000)
def _message_tokens(tokenizer: PreTrainedTokenizerFast, message: str) -> list[int]:
    """The tokens of a message, given as JSON; the template writes a message the same way wherever it stands."""
    return tokenizer.apply_chat_template([json.loads(message)], tokenize=True, return_dict=False)


def new_model(tokenizer: PreTrainedTokenizerFast, seed: int = 0, width: int = 64, layers: int = 2) -> LlamaForCausalLM:
    """Make an untrained model, whose weights are drawn from the seed."""
    torch.manual_seed(seed)
    config = LlamaConfig(
        vocab_size=len(tokenizer),
        hidden_size=width,
        intermediate_size=3 * width,
        num_hidden_layers=layers,
        num_attention_heads=4,
        num_key_value_heads=4,
        max_position_embeddings=8192,
        tie_word_embeddings=True,
        bos_token_id=None,
        eos_token_id=tokenizer.eos_token_id,
        pad_token_id=tokenizer.pad_token_id,
    )
    return LlamaForCausalLM(config).to("cuda" if torch.cuda.is_available() else "cpu")


def train(
    model: LlamaForCausalLM,
    samples: Sequence[Sample],
    tokens: int,
    seed: int = 0,
    at_once: int = 4096,
    conversations: int = 32,
) -> float:
    """Train on batches of conversations of like length until `tokens` were read; return the last batches' mean loss.

    A batch is at most `at_once` tokens and `conversations`. With tokens alone, first replies of all episodes are one
    batch, since nothing is as short: a few steps of training for the reply that everything depends on.
    """
    optimizer = torch.optim.AdamW(model.parameters(), lr=3e-3, betas=(0.9, 0.98), weight_decay=0.01)
    read, losses = 0, []
    model.train()
    for batch in _batches(samples, at_once, conversations, random.Random(seed)):
        done = read / tokens
        for group in optimizer.param_groups:
            group["lr"] = 3e-3 * min(1.0, 0.02 + done / 0.03) * max(0.02, 1 - done)
        loss = _loss(model, batch)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        losses.append(loss.item())
        read += sum(len(ids) for ids, _ in batch)
        if read >= tokens:
            return sum(losses[-20:]) / len(losses[-20:])
    raise AssertionError("batches never end")


def _batches(
    samples: Sequence[Sample], at_once: int, conversations: int, draw: random.Random
) -> Iterator[list[Sample]]:
    """Yield batches without end, in an order and in groups that are drawn at random."""
    while True:
        by_length = sorted(samples, key=lambda sample: (len(sample[0]) // 16, draw.random()))
        batches: list[list[Sample]] = [[]]
        for sample in by_length:
            most = min(conversations, at_once // len(sample[0]))
            if batches[-1] and len(batches[-1]) >= most:
                batches.append([])
            batches[-1].append(sample)
        draw.shuffle(batches)
        yield from batches


def _padded(batch: Sequence[Sample], device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    longest = max(len(ids) for ids, _ in batch)
    ids = torch.tensor([ids + [0] * (longest - len(ids)) for ids, _ in batch], device=device)
    return ids, torch.tensor([mask + [False] * (longest - len(mask)) for _, mask in batch], device=device)


def _loss(model: LlamaForCausalLM, batch: Sequence[Sample]) -> torch.Tensor:
    ids, trained = _padded(batch, model.device)
    hidden = model.model(input_ids=ids).last_hidden_state[:, :-1][trained[:, 1:]]
    return cross_entropy(model.lm_head(hidden), ids[:, 1:][trained[:, 1:]])


def message_of(text: str) -> dict[str, Any]:
    """Return a reply's text as a message; a call that is not JSON stays text, and plays nothing."""
    calls = []
    for number, written in enumerate(CALL.findall(text)):
        try:
            call = json.loads(written)
            function = {"name": str(call["name"]), "arguments": json.dumps(call["arguments"])}
        except (ValueError, KeyError, TypeError):
            continue
        calls.append({"id": f"call{number}", "type": "function", "function": function})
    words = re.sub(r"<\w+>|</\w+>", "", CALL.sub("", text))
    return {"role": "assistant", "content": words or None, **({"tool_calls": calls} if calls else {})}


Turn = tuple[list[int], list[int]]
"""The tokens of a prompt, and those of its reply."""


@torch.no_grad()
def play(
    model: LlamaForCausalLM,
    tokenizer: PreTrainedTokenizerFast,
    episodes: Sequence[sp.Episode],
    *,
    temperature: float = 0.0,
    name: str = "tiny",
) -> list[list[Turn]]:
    """Play all episodes to their ends, with one forward pass of the model for all of them; return their turns."""
    model.eval()
    conversations = [sp.Conversation(episode, player=name) for episode in episodes]
    turns: list[list[Turn]] = [[] for _ in episodes]
    while asked := [(at, prompt) for at, each in enumerate(conversations) if (prompt := each.prompt()) is not None]:
        prompts = [prompt_tokens(tokenizer, prompt.messages) for _, prompt in asked]
        for (at, _), ids, reply in zip(asked, prompts, _generate(model, prompts, temperature), strict=True):
            conversations[at].receive(message_of(tokenizer.decode(reply)))
            turns[at].append((ids, reply))
    return turns


def _generate(
    model: LlamaForCausalLM, prompts: Sequence[list[int]], temperature: float, longest_reply: int = 48
) -> Iterator[list[int]]:
    longest = max(map(len, prompts))
    pad, end = model.config.pad_token_id, model.config.eos_token_id
    padded = [[pad] * (longest - len(prompt)) + prompt for prompt in prompts]
    ids = torch.tensor(padded, device=model.device)
    how = {"do_sample": True, "temperature": temperature, "top_k": 0} if temperature else {"do_sample": False}
    replies = model.generate(input_ids=ids, attention_mask=(ids != pad).long(), max_new_tokens=longest_reply, **how)
    for reply in replies[:, longest:].tolist():
        yield reply[: reply.index(end) + 1] if end in reply else reply


def reinforce(
    model: LlamaForCausalLM,
    tokenizer: PreTrainedTokenizerFast,
    groups: Iterable[Sequence[Sequence[sp.Episode]]],
    *,
    turns: int = 12,
    seed: int = 0,
) -> Iterator[float]:
    """Train on the scores of played episodes (GRPO without a reference model); yield the mean score of each update.

    Each item of `groups` is an update: groups of episodes of one world each. An episode is as good as its score is
    above its group's mean, in standard deviations. Of every episode some turns are trained, each in exactly the window
    in which its reply was made.
    """
    optimizer = torch.optim.AdamW(model.parameters(), lr=2e-4, weight_decay=0.0)
    draw = random.Random(seed)
    torch.manual_seed(seed)
    for worlds in groups:
        episodes = [episode for world in worlds for episode in world]
        played = play(model, tokenizer, episodes, temperature=1.0)
        scores = torch.tensor([float(episode.result.score) for episode in episodes]).view(len(worlds), -1)
        spread = scores.std(1, keepdim=True) + 1e-4
        advantages = ((scores - scores.mean(1, keepdim=True)) / spread).flatten().tolist()
        rows = [
            (turn, advantage)
            for own, advantage in zip(played, advantages, strict=True)
            for turn in draw.sample(own, min(turns, len(own)))
        ]
        rows.sort(key=lambda row: len(row[0][0]))
        model.train()
        optimizer.zero_grad()
        for start in range(0, len(rows), 64):
            (_weighted_loss(model, rows[start : start + 64]) / len(rows)).backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        yield scores.mean().item()


def _weighted_loss(model: LlamaForCausalLM, rows: Sequence[tuple[Turn, float]]) -> torch.Tensor:
    batch = [(prompt + reply, [False] * len(prompt) + [True] * len(reply)) for (prompt, reply), _ in rows]
    ids, trained = _padded(batch, model.device)
    hidden = model.model(input_ids=ids).last_hidden_state[:, :-1][trained[:, 1:]]
    losses = cross_entropy(model.lm_head(hidden), ids[:, 1:][trained[:, 1:]], reduction="none")
    advantages = torch.tensor([advantage for _, advantage in rows], device=model.device)[:, None].expand_as(ids)
    return (losses * advantages[:, 1:][trained[:, 1:]]).sum()
