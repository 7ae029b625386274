"""Random conversations of agents that play no game, in three forms: as they are, and as broken as agents make them."""

from __future__ import annotations

import copy
import json
import random
from typing import Any

Messages = list[dict[str, Any]]

KINDS = ("task", "chat", "parallel", "big", "broken")
"""One request; many of them; up to 12 calls at once; results of thousands of tokens; lists that providers refuse."""

LINE = "the door opens north key lamp You see a wooden chest and coin score 0 step 日本 🙂 {}"
WORDS = [*LINE.split(" "), "\n"]


def text(rng: random.Random, size: int) -> str:
    """A text of about so many words."""
    return " ".join(rng.choices(WORDS, k=size))


def text_of_page(number: int) -> str:
    """The text of a page of a book that agents read, short or long."""
    rng = random.Random(number)
    return " ".join(rng.choices(["door", "key", "lamp", "north"], k=rng.choice([5, 40, 150, 400])))


def chat(rng: random.Random, kind: str) -> Messages:
    """A conversation of a kind, as chat completions have it."""
    messages: Messages = [{"role": "system", "content": text(rng, rng.choice([20, 60, 120]))}]
    messages.append({"role": "user", "content": text(rng, rng.choice([15, 40]))})
    most = {"chat": [0, 0, 1, 2], "parallel": [1, 3, 6, 12]}.get(kind, [1, 1, 1, 2])
    number = 0
    for _ in range(rng.randrange(2, 28)):
        calls = []
        for _ in range(rng.choice(most)):
            number += 1
            again = kind == "broken" and rng.random() < 0.1
            arguments = json.dumps({"action": text(rng, rng.choice([3, 3, 3, 3, 40, 200]))}, ensure_ascii=False)
            function = {"name": rng.choice(["act", "read", "write_file"]), "arguments": arguments}
            identity = f"c{rng.randrange(1, number + 1) if again else number}"
            calls.append({"id": identity, "type": "function", "function": function})
        reply: dict[str, Any] = {"role": "assistant", "content": text(rng, rng.choice([3, 10, 60]))}
        if calls:
            reply["tool_calls"] = calls
        if rng.random() < 0.2:
            reply["reasoning_content"] = text(rng, 5)
        messages.append(reply)
        for call in calls:
            size = rng.choice([5, 30, 100, 400] + [1500] * (kind == "big"))
            messages.append({"role": "tool", "tool_call_id": call["id"], "content": text(rng, size)})
        if rng.random() < (0.8 if kind == "chat" else 0.12):
            messages.append({"role": "user", "content": text(rng, rng.choice([5, 15, 60]))})
        if rng.random() < 0.03:
            messages.append({"role": "system", "content": text(rng, 15)})
    return broken(rng, messages) if kind == "broken" else messages


def broken(rng: random.Random, messages: Messages) -> Messages:
    """A list with messages removed, doubled, swapped and strayed, or cut at an end."""
    for _ in range(rng.randrange(1, 6)):
        if len(messages) < 5:
            break
        at = rng.randrange(2, len(messages))
        match rng.choice(["drop", "drop", "twice", "swap", "orphan", "front", "end"]):
            case "drop":
                del messages[at : at + rng.randrange(1, 3)]
            case "twice":
                messages.insert(at, copy.deepcopy(messages[at]))
            case "swap" if at + 1 < len(messages):
                messages[at], messages[at + 1] = messages[at + 1], messages[at]
            case "orphan":
                messages.insert(at, {"role": "tool", "tool_call_id": f"z{at}", "content": "nobody asked"})
            case "front":
                del messages[2:at]
            case "end":
                del messages[max(3, len(messages) - rng.randrange(1, 4)) :]
    return messages


def responses(messages: Messages) -> Messages:
    """A conversation as items of Responses."""
    items: Messages = []
    for message in messages:
        if message["role"] == "tool":
            call = {"call_id": message["tool_call_id"], "output": message["content"]}
            items.append({"type": "function_call_output", **call})
        elif message["role"] == "assistant":
            if "reasoning_content" in message:
                summary = [{"type": "summary_text", "text": message["reasoning_content"]}]
                items.append({"type": "reasoning", "id": "rs", "summary": summary, "encrypted_content": "opaque"})
            content = [{"type": "output_text", "text": message["content"], "annotations": []}]
            items.append({"type": "message", "role": "assistant", "content": content})
            for call in message.get("tool_calls") or ():
                items.append({"type": "function_call", "call_id": call["id"], **call["function"]})
        else:
            items.append({"type": "message", "role": message["role"], "content": message["content"]})
    return items


def anthropic(messages: Messages) -> Messages:
    """A conversation as Anthropic has it, with all results after a reply in one message, and words among them."""
    out: Messages = []
    for message in messages:
        if message["role"] == "tool":
            block = {"type": "tool_result", "tool_use_id": message["tool_call_id"], "content": message["content"]}
            if out and out[-1]["role"] == "user" and isinstance(out[-1]["content"], list):
                out[-1]["content"].append(block)
            else:
                out.append({"role": "user", "content": [block]})
        elif message["role"] == "assistant":
            blocks: list[dict[str, Any]] = []
            if "reasoning_content" in message:
                blocks.append({"type": "thinking", "thinking": message["reasoning_content"], "signature": "opaque"})
            blocks.append({"type": "text", "text": message["content"]})
            for call in message.get("tool_calls") or ():
                arguments = json.loads(call["function"]["arguments"])
                blocks.append(
                    {"type": "tool_use", "id": call["id"], "name": call["function"]["name"], "input": arguments}
                )
            out.append({"role": "assistant", "content": blocks})
        else:
            out.append({"role": message["role"], "content": message["content"]})
    return out


FORMS = {"chat": list, "responses": responses, "anthropic": anthropic}
"""How a conversation is written in each form."""


def history(rng: random.Random, kind: str, form: str) -> Messages:
    """A conversation of a kind in a form."""
    return FORMS[form](chat(rng, kind))
