"""The conversion of a server's answers to plain data.

The client does not validate what a server sends, and compatible servers deviate from the interface in many ways.
Everything here is therefore read from plain dictionaries, without assumptions about their contents.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools import SampledTokens, Usage
from smartplay_tools.players import count_in


def read_usage(usage: Any, prompt: str, reply: str) -> Usage | None:
    """Return the provider's usage; `prompt` and `reply` are the interface's names, such as `input` and `output`."""
    if not isinstance(usage, Mapping):
        return None
    parts = usage.get(f"{prompt}_tokens_details")
    return Usage(
        prompt=count_in(usage, f"{prompt}_tokens"),
        reply=count_in(usage, f"{reply}_tokens"),
        cached=count_in(parts, "cached_tokens"),
        written=count_in(parts, "cache_write_tokens"),
        reasoning=count_in(usage.get(f"{reply}_tokens_details"), "reasoning_tokens"),
    )


def sampled_tokens(choice: Mapping[str, Any], prompt: Any) -> SampledTokens | None:
    """Return the tokens of a reply, which vLLM and LMDeploy send where `return_token_ids` asks for them.

    Their probabilities are there if `logprobs` asks for these, too; `prompt` are the prompt's tokens.
    """
    ids, logprobs = choice.get("token_ids"), choice.get("logprobs")
    if not isinstance(ids, list):
        return None
    content = logprobs.get("content") if isinstance(logprobs, Mapping) else None
    try:
        drawn = [each["logprob"] for each in content or ()]
        logprobs = tuple(drawn) if len(drawn) == len(ids) else None
        return SampledTokens(reply=tuple(ids), logprobs=logprobs, prompt=prompt)
    except (KeyError, TypeError, ValueError):
        return None
