"""The usage and the sampled tokens of an answer, from plain data.

The client does not validate what a server sends, and compatible servers deviate from the interface in many ways.
Everything here is therefore read from plain dictionaries, without assumptions about their contents.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools.players.attempts import count_in, reported_in
from smartplay_tools.types import SampledTokens, Usage

READ = ("cached_tokens", "prompt_cache_hit_tokens", "cache_read_input_tokens", "num_cached_tokens")
"""The names of the tokens read from a cache: OpenAI's and Kimi's, DeepSeek's, LiteLLM's, Mistral's."""

WRITTEN = ("cache_write_tokens", "cache_creation_tokens", "cache_creation_input_tokens")
"""The names of the tokens written to a cache: OpenAI's, and LiteLLM's two."""


def read_usage(usage: Any, prompt: str, reply: str) -> Usage | None:
    """Return the provider's usage; `prompt` and `reply` are the interface's names, such as `input` and `output`."""
    if not isinstance(usage, Mapping):
        return None
    parts, drawn = usage.get(f"{prompt}_tokens_details"), usage.get(f"{reply}_tokens_details")
    cached = [count for count in (reported_in(parts, *READ), reported_in(usage, *READ)) if count is not None]
    read = Usage(
        prompt=count_in(usage, f"{prompt}_tokens"),
        reply=count_in(usage, f"{reply}_tokens"),
        cached=max(cached, default=None),
        written=max(reported_in(parts, *WRITTEN) or 0, reported_in(usage, *WRITTEN) or 0),
        reasoning=max(count_in(drawn, "reasoning_tokens"), count_in(usage, "reasoning_tokens")),
    )
    return read.checked(reported_in(usage, "total_tokens"))


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
