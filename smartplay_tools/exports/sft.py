"""Rows for supervised fine-tuning, in the columns that TRL's `SFTTrainer` and most other trainers read.

`sft` has a row for every reply: the prompt exactly as the model saw it, and the reply. This is what a model is trained
on that will play under the same budget. `sft-episodes` has a row for every episode, the whole conversation: fewer and
shorter data, but of a conversation that no model saw whole if its window dropped turns.

Columns of one name have one type in every row (Arrow needs that): arguments and tool schemas are JSON text, which
`SFTTrainer` reads. What a provider wanted back (`provider_items`) is left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from smartplay_tools.messages import Message, text_of
from smartplay_tools.records.record import Record

FILE = "data.jsonl"


def write_replies(episodes: Iterable[Record], folder: Path) -> dict[str, int]:
    """Write a row for every reply; return the number of episodes and rows."""
    return _write(folder, ((episode, list(reply_rows(episode))) for episode in episodes))


def write_episodes(episodes: Iterable[Record], folder: Path) -> dict[str, int]:
    """Write a row for every episode; return the number of episodes and rows."""
    return _write(folder, ((episode, [episode_row(episode)]) for episode in episodes))


def reply_rows(episode: Record) -> Iterator[dict[str, Any]]:
    """Yield a row for every reply of an episode: `prompt`, `completion`, `tools`, and the facts of the episode."""
    tools = json.dumps(episode.tools)
    for sent in episode.prompts:
        prompt = [plain(message) for message in sent.prompt.messages]
        completion = [plain(episode.replies[sent.turn])]
        with_tools = {"tools": tools} if episode.tools else {}
        yield {"prompt": prompt, "completion": completion, **with_tools, **_facts(episode), "turn": sent.turn}


def episode_row(episode: Record) -> dict[str, Any]:
    """Return an episode as one row: `messages`, `tools`, and its facts."""
    return {"messages": list(map(plain, episode.conversation)), "tools": json.dumps(episode.tools), **_facts(episode)}


def plain(message: Message) -> dict[str, Any]:
    """Return a message with text as its content, and without a provider's own items."""
    kept = ("role", "name", "tool_calls", "tool_call_id", "reasoning_content")
    return {**{name: message[name] for name in kept if name in message}, "content": text_of(message)}  # type: ignore[literal-required]


def _facts(episode: Record) -> dict[str, Any]:
    result = episode.result
    return {
        "game": result.game,
        "seed": result.seed,
        "player": episode.player,
        "score": float(result.score),
        "normalized_score": result.normalized_score,
        "completed": result.completed,
    }


def _write(folder: Path, rows: Iterable[tuple[Record, list[dict[str, Any]]]]) -> dict[str, int]:
    counts = {"episodes": 0, "rows": 0}
    with (folder / FILE).open("x", encoding="utf-8", newline="\n") as file:
        for _, own in rows:
            counts["episodes"] += 1
            counts["rows"] += len(own)
            file.writelines(json.dumps(row, ensure_ascii=False) + "\n" for row in own)
    return counts
