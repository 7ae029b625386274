"""The histories of the cap audit, and the judge of what is left of them.

The judge counts after the definition of budget tokens in `docs/budgets.md`, by tiktoken and separate code, and has
its own rule of pairs.
"""

from __future__ import annotations

import base64
import functools
import json
import random
from typing import Any

from smartplay_tools.context.tokens.o200k import o200k_base

Messages = list[dict[str, Any]]

WORDS = (  # noqa: SIM905
    "the door opens north key lamp you see a wooden chest and coin score step file line error test passes function "
    "returns value module import class reads writes table of rows which was not found again before after"
).split()
HAN = (
    "的一是在不了有和人这中大为上个国我以要他时来用们生到作地于出"
    "就分对成会可主发年动同工也能下过子说产种面而方后多定行学法所民得经"
)


@functools.cache
def encoding() -> Any:
    """The tokenizer of the judge: tiktoken's, with the vocabulary that comes with the library."""
    return o200k_base()


def calls(message: dict[str, Any]) -> list[tuple[str, str, str]]:
    """The calls of a message: id, name and arguments."""
    made = message.get("tool_calls") or ()
    return [(call["id"], call["function"]["name"], call["function"]["arguments"]) for call in made]


@functools.lru_cache(maxsize=200_000)
def count(text: str) -> int:
    """The tokens of a text."""
    return len(encoding().encode_ordinary(text))


def message_tokens(message: dict[str, Any]) -> int:
    """The budget tokens of a message."""
    total = 3 + count(message["role"]) + count(message["content"] or "") + 8 * (message["role"] == "tool")
    return total + sum(11 + count(name) + count(arguments) for _, name, arguments in calls(message))


def text_tokens(messages: Messages) -> int:
    """The tokens of contents, names and arguments alone: what no counter can leave out."""
    said = [message["content"] or "" for message in messages]
    return sum(map(count, [*said, *(part for message in messages for call in calls(message) for part in call[1:])]))


def prompt_tokens(messages: Messages) -> int:
    """The budget tokens of a prompt."""
    return 3 + sum(map(message_tokens, messages))


def is_broken(messages: Messages) -> bool:
    """Whether a provider refuses the pairs: a result is not right after the reply with its call, or a call has none."""
    waiting: list[str] = []
    for message in messages:
        if message["role"] == "tool":
            if message.get("tool_call_id") not in waiting:
                return True
            waiting.remove(message["tool_call_id"])
        elif waiting:
            return True
        waiting += [identity for identity, _, _ in calls(message)]
    return bool(waiting)


def text(rng: random.Random, kind: str, size: int) -> str:
    """A text of about so many tokens."""
    if kind == "chinese":
        return "".join(rng.choice(HAN) + "，。"[rng.random() < 0.5] * (rng.random() < 0.1) for _ in range(size))
    if kind == "json":
        return json.dumps(
            [{"id": rng.randrange(10**6), "score": round(rng.random(), 4)} for _ in range(size // 14 + 1)]
        )
    if kind == "base64":
        return base64.b64encode(rng.randbytes(size + 2)).decode()
    return " ".join(rng.choices(WORDS, k=size))


def history(rng: random.Random, kind: str, cap: int) -> Messages:
    """A history of a kind that is longer than a cap, up to the request of the next reply."""
    messages: Messages = [{"role": "system", "content": text(rng, "words", rng.choice([30, 80, 200]))}]
    words = "chinese" if kind == "chinese" else "words"
    messages.append({"role": "user", "content": text(rng, words, rng.choice([15, 60]))})
    length = cap * rng.choice([1.2, 2, 4])
    sizes, written = ([20, 100, cap // 2, 2 * cap], cap) if kind == "huge" else ([10, 40, 100, 300], 400)
    while True:
        number = rng.choice([2, 4, 8]) if kind == "parallel" else int(kind != "chat" or rng.random() < 0.4)
        say = {"role": "assistant", "content": text(rng, words, rng.choice([4, 20, 60]))}
        asked = []
        for _ in range(number):
            size = rng.choice([4] * 12 + [60, 60, written])
            arguments = json.dumps(
                {"path": f"{rng.choice(WORDS)}.md", "text": text(rng, words, size)}, ensure_ascii=False
            )
            function = {"name": rng.choice(["read", "search", "write"]), "arguments": arguments}
            asked.append({"id": f"call_{rng.getrandbits(48):012x}", "type": "function", "function": function})
        messages.append(say | ({"tool_calls": asked} if asked else {}))
        for call in asked:
            messages.append({"role": "tool", "tool_call_id": call["id"], "content": text(rng, kind, rng.choice(sizes))})
        if kind == "chat" and (not asked or rng.random() < 0.5):
            messages.append({"role": "user", "content": text(rng, words, rng.choice([10, 40, 120]))})
        if messages[-1]["role"] != "assistant" and prompt_tokens(messages) > length:
            return messages


def verdict(given: Messages, shown: Messages, cap: int) -> dict[str, Any]:
    """What is wrong with a prompt."""
    request = [message["content"] for message in given if message["role"] == "user"][-1]
    newest = given[-1].get("tool_call_id")
    used = prompt_tokens(shown)
    return {
        "used": used,
        "over": used > cap,
        "texts": text_tokens(shown) > cap,
        "broken": is_broken(shown),
        "empty": all(message["role"] in ("system", "user") for message in shown),
        "task": all(message["content"] != request for message in shown if message["role"] == "user"),
        "newest": newest is not None and all(message.get("tool_call_id") != newest for message in shown),
    }


def plain(messages: Messages) -> list[Any]:
    """What messages say, with arguments as objects, which some write with other escapes."""
    return [
        (
            message["role"],
            message["content"],
            message.get("tool_call_id"),
            [(identity, name, json.loads(said)) for identity, name, said in calls(message)],
        )
        for message in messages
    ]
