"""What a chat model is sent for its provider's cache: marks in the messages, and the episode's key.

LangChain's packages for Anthropic and OpenAI pass both on unchanged. Other providers cache by themselves, or by means
that LangChain has no common name for, and are sent neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AnyMessage

from smartplay_langchain.messages import sendable, to_langchain
from smartplay_tools import Message, Prompt
from smartplay_tools.players.cache_marks import CacheMarks, last_markable, stable_end
from smartplay_tools.players.conversion import with_pictures_below
from smartplay_tools.providers.cache_fields import CacheFields, openai_cache_fields

ANTHROPIC = {"cache_control": {"type": "ephemeral"}}
OPENAI = {"prompt_cache_breakpoint": {"mode": "explicit"}}


def cache_key(prompt: Prompt, model: BaseChatModel, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the setting that tells OpenAI which prompts belong together; none where there is one, or another server.

    Arguments:
        prompt: the prompt.
        model: the chat model.
        settings: the settings of the request.
    """
    own = {**(getattr(model, "model_kwargs", None) or {}), **settings}
    wanted = _openai(model).key and "prompt_cache_key" not in own
    return {"prompt_cache_key": prompt.cache_key} if wanted else {}


def messages_for(
    prompt: Prompt, model: BaseChatModel, cache: CacheMarks, settings: Mapping[str, Any] | None = None
) -> list[AnyMessage]:
    """Return a prompt's messages, marked for the cache of the model's provider where `cache` asks for it.

    Settings with Anthropic's own `cache_control` say that the caller has taken care of the cache. Pictures are in the
    results, or in a user message after them where the model's package has no place for them there.
    """
    prompt = prompt if _takes_pictures_in_results(model) else with_pictures_below(prompt)
    tools = {tool.name for tool in prompt.tools}
    messages = [sendable(message, tools) for message in to_langchain(prompt.messages, prompt.pictures)]
    if not cache:
        return messages
    ends = {stable_end(prompt, one_system_text=True)}
    if _is_a(model, "ChatAnthropic") and "cache_control" not in (settings or {}):
        mark: Mapping[str, Any] = ANTHROPIC
        if cache is True:
            ends.add(last_markable(prompt.messages))
    elif _openai(model).marks:
        mark = OPENAI
    else:
        return messages
    for at in {_place(prompt.messages, at) for at in ends if at is not None}:
        messages[at] = _marked(messages[at], mark)
    return messages


def _openai(model: BaseChatModel) -> CacheFields:
    if not _is_a(model, "ChatOpenAI"):
        return CacheFields()
    client: Any = getattr(model, "root_async_client", None)
    return openai_cache_fields(getattr(model, "model_name", ""), str(getattr(client, "base_url", "")))


def _takes_pictures_in_results(model: BaseChatModel) -> bool:
    """Whether the package of a model sends the pictures of results there: Anthropic's does, OpenAI's with Responses."""
    return _is_a(model, "ChatAnthropic") or (
        _is_a(model, "ChatOpenAI") and getattr(model, "use_responses_api", None) is True
    )


def _is_a(model: BaseChatModel, name: str) -> bool:
    """Whether a model is of a class; by name, since the packages of providers need not be installed."""
    return any(kind.__name__ == name for kind in type(model).__mro__)


def _place(messages: Sequence[Message], at: int) -> int:
    """Where a message stands when all system messages are one at the beginning."""
    system = [message["role"] in ("system", "developer") for message in messages]
    return 0 if system[at] else any(system) + system[:at].count(False)


def _marked(message: AnyMessage, mark: Mapping[str, Any]) -> AnyMessage:
    whole = message.content
    first, *pictures = [whole] if isinstance(whole, str) else whole
    text = {"type": "text", "text": first} if isinstance(first, str) else first
    content = [{**text, **mark}, *pictures]
    marked: AnyMessage = message.model_copy(update={"content": content})
    return marked
