"""The player `local:MODEL`: a model file on this machine, through the OpenAI player and llama.cpp's server."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

from smartplay_local.engine import check_memory, checked_context, checked_threads, shared_server
from smartplay_local.model_files import find_model, name_of, read_gguf
from smartplay_local.text import as_text, call_in, grammar_of
from smartplay_tools import InvalidArgumentError, Prompt, Reply
from smartplay_tools.errors import extra_named

with extra_named("smartplay_local", "local"):
    import openai
    from smartplay_openai import OpenAIPlayer

UNUSED = "http://127.0.0.1:9/v1"
"""A base URL at which nothing answers: the server's port is known once it runs."""


class LocalPlayer(OpenAIPlayer):
    """A player that asks a model file on this machine. The model is loaded when it is asked for the first time.

    All players of a process that name the same file, context and threads share one server, which answers one request
    after the other.

    Arguments:
        model: a known model's name, or the path of a GGUF file; by default the one of `smartplay-tools model get`.
        context: tokens of a prompt and its reply; by default 8,192, or the model's own limit where that is smaller.
        threads: how many threads compute; by default as many as there are processors, at most four.
        temperature: 0 is the most likely reply; above, replies are drawn with `seed`.
        options: those of `OpenAIPlayer`, such as `parameters`, for whatever else llama.cpp's server takes.
    """

    _registered = "local"

    def __init__(
        self,
        model: str = "",
        *,
        context: int | None = None,
        threads: int | None = None,
        temperature: float = 0.0,
        seed: int = 0,
        parameters: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        if refused := {"base_url", "api_key", "parse_calls", "stream", "tool_choice"} & options.keys():
            raise InvalidArgumentError(f"A local model takes no {min(refused)}; leave it out, or play openai:MODEL.")
        self._path = find_model(model)
        file = read_gguf(self._path)
        check_memory(file, checked_context(file, context))
        checked_threads(threads)
        self._loaded_with = context, threads
        own = {"temperature": temperature, "seed": seed % 2**32, "cache_prompt": True, **(parameters or {})}
        super().__init__(name_of(model), base_url=UNUSED, seed=seed, parameters=own, **options)
        self._numbers = itertools.count()

    def request(self, prompt: Prompt) -> dict[str, Any]:
        """Return the body of the request: the tools are in the text, and the reply is bound to their schemas."""
        may_call = bool(prompt.tools) and not prompt.asks_for_summary
        messages = as_text(prompt.messages, prompt.tools)
        body = super().request(replace(prompt, messages=messages, tools=()))
        body.pop("tool_choice", None)
        return {**body, "grammar": grammar_of(prompt.tools)} if may_call else body

    def new_client(self) -> openai.OpenAI:
        """Return a synchronous client; the model is loaded if it is not yet."""
        self._load()
        return super().new_client()

    def new_async_client(self) -> openai.AsyncOpenAI:
        """Return a client for one event loop; the model is loaded if it is not yet."""
        self._load()
        return super().new_async_client()

    def send(self, client: openai.OpenAI, request: dict[str, Any]) -> Reply:
        """Send a request and read the reply's call."""
        return self._called(super().send(client, request), request)

    async def asend(self, client: openai.AsyncOpenAI, request: dict[str, Any]) -> Reply:
        """Send a request as `send` does, without blocking the event loop."""
        return self._called(await super().asend(client, request), request)

    def _load(self) -> None:
        self._settings["base_url"] = shared_server(self._path, *self._loaded_with).base_url

    def _called(self, reply: Reply, request: dict[str, Any]) -> Reply:
        call = call_in(str(reply.message.get("content") or "")) if "grammar" in request else None
        if call is None:
            return reply
        made: Any = {"id": f"local{next(self._numbers):04d}", "type": "function", "function": call}
        return replace(reply, message={"role": "assistant", "content": None, "tool_calls": [made]})
