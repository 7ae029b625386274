"""What a Pydantic AI model is sent for its provider's cache: marks in the messages, and the episode's key.

Anthropic's and OpenAI's models have a place for them. Others do not: a mark would leave an empty message behind there.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from pydantic_ai.models import Model

from smartplay_tools import Prompt
from smartplay_tools.context.prompts import CacheMarks, last_markable, stable_end
from smartplay_tools.evaluation.costs import CacheFields, openai_cache_fields


def cache_key(prompt: Prompt, model: Model, cache: CacheMarks) -> dict[str, Any]:
    """Return the setting that tells OpenAI which prompts belong together; nothing for other providers."""
    return {"openai_prompt_cache_key": prompt.cache_key} if cache and _openai(model).key else {}


def marked_messages(prompt: Prompt, model: Model, cache: CacheMarks) -> Collection[int]:
    """Return which messages of a prompt are marked for the cache of the model's provider."""
    is_anthropic = model.system == "anthropic"
    if not cache or not (is_anthropic or _openai(model).marks):
        return ()
    stable = stable_end(prompt, one_system_text=True)
    end = last_markable(prompt.messages) if is_anthropic and cache is True else None  # OpenAI marks the end itself
    return {at for at in (stable, end) if at is not None}


def _openai(model: Model) -> CacheFields:
    if model.system != "openai":
        return CacheFields()
    return openai_cache_fields(model.model_name, model.base_url or "")
