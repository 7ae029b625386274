"""What an engine's cache finds of our prompts, beside what the definition of `docs/context-cost.md` predicts.

    llama-server -m MODEL.gguf --jinja --parallel 1 --cache-ram 0
    python benchmarks/cache.py [--base-url http://127.0.0.1:8080] [--calls 30]

Every strategy plays a bandit with the same free player, and each of its prompts is sent to the engine, for a reply of
one token; a prompt that has nothing in common with them is sent before. The prediction is made of the engine's own
tokens (its endpoints `/apply-template` and `/tokenize`), of which each is a unit, without replies. The last columns are
the tokens that a cache of blocks of 16 would compute, as vLLM's, and the seconds that this engine took to read prompts.
"""

from __future__ import annotations

import argparse
import json
import sys
import urllib.request
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.costs.cached import Unit
from smartplay_tools.evaluation.costs.charges import calls_under
from smartplay_tools.providers.caches import cache_rules
from smartplay_tools.records import sent_prompts
from smartplay_tools.records.requests import Request, RequestLog

GAME = "BanditTwoArmedHighLowFixed-v0"
STRATEGIES: dict[str, dict[str, Any]] = {
    "full history": {"history": None},
    "10 steps": {"history": 10},
    "10 steps, slack 0.5": {"history": 10, "slack": 0.5},
    "cap 1,000": {"history": None, "prompt_tokens": 1_000},
    "cap 1,000, slack 0.5": {"history": None, "prompt_tokens": 1_000, "slack": 0.5},
    "masking, slack 0.5": {"history": 5, "beyond_history": "mask", "slack": 0.5},
    "notes, slack 0.5": {"history": 5, "notes_tokens": 200, "slack": 0.5},
    "summaries, slack 0.5": {"history": None, "prompt_tokens": 1_000, "summary_tokens": 100, "slack": 0.5},
}

FORGET: dict[str, Any] = {"messages": [{"role": "user", "content": "Forget."}]}
"""A prompt that takes the place of the episode before it in a server's slot."""


class Engine:
    """A server of llama.cpp."""

    def __init__(self, url: str) -> None:
        self._url = url

    def ask(self, path: str, body: dict[str, Any]) -> dict[str, Any]:
        """Send a request, and return the answer."""
        headers = {"Content-Type": "application/json"}
        request = urllib.request.Request(self._url + path, json.dumps(body).encode(), headers)
        with urllib.request.urlopen(request, timeout=600) as answer:
            result: dict[str, Any] = json.load(answer)
        return result

    def tokens(self, body: dict[str, Any]) -> list[int]:
        """Return the tokens of a prompt."""
        text = self.ask("/apply-template", body)["prompt"]
        answer = self.ask("/tokenize", {"content": text, "add_special": True, "parse_special": True})
        tokens: list[int] = answer["tokens"]
        return tokens

    def send(self, body: dict[str, Any]) -> tuple[int, float]:
        """Send a prompt; return how many of its tokens were cached, and the seconds that reading it took."""
        answer = self.ask("/v1/chat/completions", {**body, "max_tokens": 1, "cache_prompt": True})
        return answer["usage"]["prompt_tokens_details"]["cached_tokens"], answer["timings"]["prompt_ms"] / 1000


def prompts(budget: dict[str, Any], calls: int) -> list[dict[str, Any]]:
    """The prompts of an episode, as requests of chat completions."""
    events: list[dict[str, Any]] = []
    limits = sp.Budget(tool_calls=calls, **budget)
    with sp.Episode(GAME, seed=0, budget=limits, transcript=events) as episode:
        sp.play(episode, sp.get_player("rule-notes", words=False))
    bodies = []
    for sent in sent_prompts(events):
        tools = [sp.schema(tool, "openai") for tool in sent.prompt.tools]
        bodies.append({"messages": sent.prompt.messages, "tools": tools, "tool_choice": "none"})
    return bodies


def log_of(requests: Sequence[Sequence[int]]) -> RequestLog:
    """Requests whose units are tokens."""
    reply = Unit(-1, 1, 1, is_system=False)
    units = {token: Unit(token, 1, 1, is_system=False) for tokens in requests for token in tokens}
    sent = [[units[token] for token in tokens] for tokens in requests]
    return RequestLog([Request(each, 0, 0, "play", len(each), 1, reply, 0.0, None) for each in sent], None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base-url", default="http://127.0.0.1:8080")
    parser.add_argument("--calls", type=int, default=30)
    asked = parser.parse_args()
    engine = Engine(asked.base_url)
    try:
        engine.ask("/tokenize", {"content": ""})
    except OSError as error:
        sys.exit(f"No server of llama.cpp answers at {asked.base_url} ({error}); start one as this file says.")
    rules = {name: cache_rules()[name].model_copy(update={"replies": False}) for name in ("llama-cpp", "vllm")}
    table = Table("strategy", "calls", "tokens", "predicted", "reported", "equal", "blocks of 16 compute", "prefill, s")
    equal = calls = 0
    for name, budget in STRATEGIES.items():
        bodies = [FORGET, *prompts(budget, asked.calls)]
        requests = [engine.tokens(body) for body in bodies]
        _, *reported = [engine.send(body) for body in bodies]
        # A slot holds its latest request only.
        slot = [calls_under(log_of(pair), rules["llama-cpp"])[1] for pair in pairwise(requests)]
        _, *blocks = calls_under(log_of(requests), rules["vllm"])
        same = sum(call.hit == cached for call, (cached, _) in zip(slot, reported, strict=True))
        equal, calls = equal + same, calls + len(slot)
        figures = (
            sum(call.prompt for call in slot),
            sum(call.hit for call in slot),
            sum(cached for cached, _ in reported),
            same,
            sum(call.prompt - call.hit for call in blocks),
        )
        table.add_row(name, str(len(slot)), *map("{:,}".format, figures), f"{sum(took for _, took in reported):.2f}")
    console = Console(width=120)
    console.print(table)
    console.print(f"{equal} of {calls} calls have exactly the predicted number of cached tokens.")


if __name__ == "__main__":
    main()
