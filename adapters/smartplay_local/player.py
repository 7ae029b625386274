"""The player `local:MODEL`: a model file on this machine, through the OpenAI player and llama.cpp's server."""

from __future__ import annotations

import functools
import itertools
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from smartplay_local.engine import Loading, LocalServer, shared_server, shared_slots, xllamacpp
from smartplay_local.model_files import find_adapter, find_model, name_of, read_gguf, sha256_of_file
from smartplay_local.text import as_text, bounded, call_in, grammar_of, sample
from smartplay_tools import Budget, Episode, InvalidArgumentError, Prompt, Reply, play
from smartplay_tools.errors import extra_named
from smartplay_tools.types.messages import calls_of

with extra_named("smartplay_local", "local"):
    import openai
    from smartplay_openai import OpenAIPlayer

UNUSED = "http://127.0.0.1:9/v1"
"""A base URL at which nothing answers: the server's port is known once it runs."""

Format = Literal["template", "text"]

FORMATS: tuple[Format, ...] = ("template", "text")

MOST_TOKENS = 2_000
"""Cap on a reply in a model's own template where the budget has none: words before a call have no other end."""


@functools.cache
def chosen_format(how: Loading) -> Format:
    """Return the format for a model: its template, if that has tools and the model calls one of them in a trial.

    llama.cpp binds a call to its schema, but lets the model write words before it, and some models write their calls
    as words in another form than their template's. The trial is a first prompt, without a call that could be repeated.
    """
    if not read_gguf(how.model).knows_tools:
        return "text"
    messages, tools = sample(with_tools=True)
    return "template" if shared_server(how).calls(messages[:2], tools) else "text"


class LocalPlayer(OpenAIPlayer):
    """A player that asks a model file on this machine. The model is loaded when it is asked for the first time.

    All players of a process that name the same file, adapter, context, threads and slots share one server.

    Arguments:
        model: a known model's name, or the path of a GGUF file; by default the one of `smartplay-tools model get`.
        adapter: the path of a LoRA adapter in GGUF, loaded instead of the model's default adapter.
        format: "template" sends tools in the model's own chat template, and llama.cpp reads the calls; "text" writes
            them into the messages. By default "template" where the file's template has tools and the model calls one
            when it is tried.
        context: tokens of a prompt and its reply; by default 8,192, or the model's own limit where that is smaller.
        threads: how many threads compute; by default one less than there are processors, from one to four.
        slots: how many prompts are answered at a time. Each has a separate context, which takes memory.
        temperature: 0 is the most likely reply; above, replies are drawn with `seed`.
        timeout: seconds that a reply may take, the time included for which it waits for a slot.
        options: those of `OpenAIPlayer`, such as `parameters`, for whatever else llama.cpp's server takes.
    """

    _registered = "local"

    serves_many = False
    """Each episode has a player with the episode's own seed; the server is shared."""

    def __init__(
        self,
        model: str = "",
        *,
        adapter: str | None = None,
        format: Format | None = None,  # noqa: A002  # the word that users give
        context: int | None = None,
        threads: int | None = None,
        slots: int = 1,
        temperature: float = 0.0,
        seed: int = 0,
        timeout: float = 3600.0,
        parameters: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        if refused := {"base_url", "api_key", "parse_calls", "stream", "tool_choice"} & options.keys():
            raise InvalidArgumentError(f"A local model takes no {min(refused)}; leave it out, or play openai:MODEL.")
        beside = find_adapter(model) if adapter is None else Path(adapter).expanduser()
        self.loading = Loading(find_model(model), beside, context, threads, slots)
        """How the model is loaded."""
        file = self.loading.check()
        if format not in (None, *FORMATS):
            raise InvalidArgumentError(f"format must be one of {', '.join(FORMATS)}, not {format!r}.")
        if format == "template" and not file.knows_tools:
            raise InvalidArgumentError(
                f"The chat template of {file.path.name} has no tools; leave format out, or text."
            )
        self._format = format
        own = {"temperature": temperature, "seed": seed % 2**32, "cache_prompt": True, **(parameters or {})}
        super().__init__(name_of(model), base_url=UNUSED, seed=seed, timeout=timeout, parameters=own, **options)
        self._numbers = itertools.count()

    @property
    def format(self) -> Format:
        """How the model is sent tools; where its file does not decide it, the model is loaded and tried."""
        return self._format or chosen_format(self.loading)

    @property
    def versions(self) -> Mapping[str, str]:
        """What decides the replies beside the prompt, for records: the engine, the format, and the digests of files."""
        files = {"model": self.loading.model, "adapter": self.loading.adapter}
        digests = {name: f"sha256:{sha256_of_file(path)}" for name, path in files.items() if path is not None}
        return {"xllamacpp": xllamacpp.__version__, "format": self.format, **digests}

    def request(self, prompt: Prompt) -> dict[str, Any]:
        """Return the body of the request; where the model plays, its reply is bound to the schemas of the tools."""
        may_call = bool(prompt.tools) and prompt.purpose == "play"
        if self.format == "template":
            body = super().request(replace(prompt, tools=tuple(map(bounded, prompt.tools))))
            body |= {"tool_choice": "required", self._limit_field: MOST_TOKENS, **body} if may_call else {}
        else:
            body = super().request(replace(prompt, shared=as_text(prompt.messages, prompt.tools), tools=()))
            body.pop("tool_choice", None)
            body |= {"grammar": grammar_of(prompt.tools)} if may_call else {}
        if self.loading.slots > 1 and prompt.cache_key:
            body["id_slot"] = shared_slots(self.loading).slot_of(prompt.cache_key)
        return body

    def new_client(self) -> openai.OpenAI:
        """Return a synchronous client; the model is loaded if it is not yet."""
        self.load()
        return super().new_client()

    def new_async_client(self) -> openai.AsyncOpenAI:
        """Return a client for one event loop; the model is loaded if it is not yet."""
        self.load()
        return super().new_async_client()

    def send(self, client: openai.OpenAI, request: dict[str, Any]) -> Reply:
        """Send a request and read the reply's call."""
        return self._called(super().send(client, request), request)

    async def asend(self, client: openai.AsyncOpenAI, request: dict[str, Any]) -> Reply:
        """Send a request as `send` does, without blocking the event loop."""
        return self._called(await super().asend(client, request), request)

    def load(self) -> LocalServer:
        """Return the server; the model is loaded if it is not yet, and its chat template writes a short chat."""
        server = shared_server(self.loading)
        self._settings["base_url"] = server.base_url
        messages, tools = sample(with_tools=self.format == "template")
        try:
            server.written(messages, tools)
        except ValueError as error:
            remedy = "play it with --player-option format=text" if tools else "play another file of this model"
            name = self.loading.model.name
            raise InvalidArgumentError(
                f"llama.cpp cannot use the chat template of {name} ({error}); {remedy}."
            ) from error
        return server

    def _called(self, reply: Reply, request: dict[str, Any]) -> Reply:
        """Return a reply with its calls, numbered: the engine draws their ids, and some templates show them."""
        message = reply.message
        if "grammar" in request:
            function = call_in(str(message.get("content") or ""))
            made: Any = [] if function is None else [{"type": "function", "function": function}]
            message = {"role": "assistant", "content": None} if made else message
        else:
            made = calls_of(message)
        if not made:
            return reply
        numbered: Any = [{**call, "id": f"local{next(self._numbers):04d}"} for call in made]
        return replace(reply, message={**message, "tool_calls": numbered})


def measure(model: str | Path, *, tokens: int = 32, turns: int = 12) -> dict[str, float]:
    """Return the seconds of loading and of a turn, the bytes of memory, and the tokens read and written a second.

    `model` is a known model's name or a path. A turn is one of an episode of Rock Paper Scissors under a cap of 1,000
    tokens with `slack` 0.5; the seconds are the mean over the first turns.
    """
    began = time.perf_counter()
    with LocalPlayer(str(model)) as player:
        server = player.load()
        loaded = time.perf_counter() - began
        body = {"prompt": "The quick brown fox jumps over the lazy dog. " * 20, "ignore_eos": True}
        timings = server.ask("/completion", {**body, "n_predict": tokens})["timings"]
        budget = Budget(prompt_tokens=1000, slack=0.5, tool_calls=turns, stalled_turns=None)
        with Episode("RockPaperScissorBasic-v0", seed=0, budget=budget) as episode:
            began = time.perf_counter()
            played = play(episode, player).turns
    return {
        "load_seconds": loaded,
        "read_per_second": timings["prompt_per_second"],
        "written_per_second": timings["predicted_per_second"],
        "turn_seconds": (time.perf_counter() - began) / max(1, played),
        "memory": player.loading.memory,
    }
