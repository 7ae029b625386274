"""Rows for supervised fine-tuning, in the columns that TRL's `SFTTrainer` and most other trainers read.

`sft` has a row for every reply: the prompt exactly as the model saw it, and the reply. This is the data for a model
that will play under the same budget. `sft-chains` has the same prompts and replies with less repetition: a row
continues while each prompt extends the previous one by its reply and what followed.

Columns of one name have one type in every row (Arrow needs that): arguments and tool schemas are JSON text, which
`SFTTrainer` reads. What a provider wanted back (`provider_items`) is left out.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

from smartplay_tools.episode import schema
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.records.prompts import SentPrompt
from smartplay_tools.records.record import Record
from smartplay_tools.types import Purpose, SampledTokens
from smartplay_tools.types.messages import Message, text_of

Row = dict[str, Any]


def reply_rows(episode: Record, *, summaries: bool = False) -> Iterator[Row]:
    """Yield a row for every reply of an episode: `prompt`, `completion`, `tools`, and the facts of the episode.

    With `summaries`, the replies to prompts for a summary have rows, too; `purpose` tells them apart. If the record has
    the tokens of any reply, every row has `completion_ids`, `completion_logprobs` and `prompt_ids`, None where unknown.
    """
    drawn, asked = episode.sampled, Counter[tuple[int, Purpose]]()
    for sent, prompt, reply in _steps(episode, summaries=summaries):
        asking = sent.turn, sent.prompt.purpose
        tokens = _token_columns(drawn.get((*asking, asked[asking]))) if drawn else {}
        asked[asking] += 1
        about = {**_facts(episode), "turn": sent.turn, "purpose": sent.prompt.purpose}
        yield {"prompt": prompt, "completion": [reply], **_tools(sent), **tokens, **about}


def chain_rows(episode: Record, *, summaries: bool = False) -> Iterator[Row]:
    """Yield rows in which every reply is trained on once: `prompt`, `completion`, `tools`, and the episode's facts.

    The assistant messages of `completion` are the replies, each after exactly the prompt to which it was given: all
    messages before it. Assistant messages of `prompt` are replies that an earlier row has.
    """
    messages, first, tools, turn, replies = list[Row](), 0, Row(), 0, 0
    for sent, prompt, reply in _steps(episode, summaries=summaries):
        if messages and (tools != _tools(sent) or prompt[: len(messages)] != messages):
            yield _chain(episode, messages, first, tools, turn=turn, replies=replies)
            messages = []
        if not messages:
            first, tools, turn, replies = len(prompt), _tools(sent), sent.turn, 0
        messages, replies = [*prompt, reply], replies + 1
    if messages:
        yield _chain(episode, messages, first, tools, turn=turn, replies=replies)


def _chain(episode: Record, messages: list[Row], first: int, tools: Row, *, turn: int, replies: int) -> Row:
    about = {**_facts(episode), "turn": turn, "replies": replies}
    return {"prompt": messages[:first], "completion": messages[first:], **tools, **about}


def plain(message: Message) -> Row:
    """Return a message with text as its content, and without a provider's own items."""
    kept = ("role", "name", "tool_calls", "tool_call_id", "reasoning_content")
    return {**{name: message[name] for name in kept if name in message}, "content": text_of(message)}  # type: ignore[literal-required]


def _steps(episode: Record, *, summaries: bool) -> Iterator[tuple[SentPrompt, list[Row], Row]]:
    """Yield every prompt, and its messages and the reply as a row has them."""
    if episode.config.context == "host":
        raise InvalidArgumentError("The host managed the context of this record, so its prompts are not recorded.")
    for sent, reply in episode.answered:
        if summaries or sent.prompt.purpose == "play":
            yield sent, list(map(plain, sent.prompt.messages)), plain(reply)


def _token_columns(sampled: SampledTokens | None) -> Row:
    return {
        "prompt_ids": sampled and sampled.prompt,
        "completion_ids": sampled and sampled.reply,
        "completion_logprobs": sampled and sampled.logprobs,
    }


def _tools(sent: SentPrompt) -> Row:
    """The column with the schemas of the tools as JSON text; nothing where there are none."""
    tools = [{"type": "function", "function": schema(tool, "json")} for tool in sent.prompt.tools]
    return {"tools": json.dumps(tools)} if tools else {}


def _facts(episode: Record) -> Row:
    result = episode.result
    return {
        "game": result.game,
        "seed": result.seed,
        "player": episode.player,
        "score": float(result.score),
        "normalized_score": result.normalized_score,
        "completed": result.completed,
    }
