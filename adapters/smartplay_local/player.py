"""The player `local:MODEL`: a model file on this machine, through the OpenAI player and llama.cpp's server."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from smartplay_local.engine import Loading, LocalServer, shared_server, xllamacpp
from smartplay_local.model_files import (
    KNOWN_MODELS,
    Format,
    find_adapter,
    find_model,
    name_of,
    read_gguf,
    sha256_of_file,
)
from smartplay_local.text import FORMATS, argument_of, as_text, bounded, call_in, grammar_of, sample
from smartplay_tools import Budget, Episode, InvalidArgumentError, Prompt, Reply, play
from smartplay_tools.errors import extra_named
from smartplay_tools.games import lockers_setting
from smartplay_tools.terminal import say
from smartplay_tools.types.messages import calls_of, text_of

with extra_named("smartplay_local", "local"):
    import openai
    from smartplay_openai import OpenAIPlayer

UNUSED = "http://127.0.0.1:9/v1"
"""A base URL at which nothing answers: the server's port is known once it runs."""

MOST_TOKENS = 2_000
"""Cap on a reply in a model's own template where the budget has none: words before a call have no other end."""

TOLD, QUESTIONS = 8, 4
"""How many things a model is told in the trial, and of how many of them it is asked."""

TRIAL_TOKENS, STALLED = 80, 2
"""Cap on a reply in the trial, and after how many turns in a row without a step it ends."""

PASSES = 0.75
"""The share of the trial's questions that a model has to answer for a format to be one in which it can play."""


@functools.cache
def tried(how: Loading) -> tuple[Format, str]:
    """Return the format for a model, and what a trial has shown of the formats.

    The trial is a game of lockers, with all that was told in view. The first format in which enough questions are
    answered is chosen; if none is, that with the most right answers, then with the most steps.
    """
    shown: dict[Format, tuple[int, int]] = {}
    for form in FORMATS:
        if form == "template" and not read_gguf(how.model).knows_tools:
            continue
        shown[form] = _trial(how, form)
        if shown[form][0] >= PASSES * QUESTIONS:
            break
    best = max(shown, key=shown.__getitem__)
    told = ", ".join(f"{form} {right}" for form, (right, _) in shown.items())
    words = f"right answers of {QUESTIONS} in a trial: {told}"
    say(f"{how.model.name} plays in the format {best} ({words}); --player-option format=NAME fixes one.", err=True)
    return best, words


def _trial(how: Loading, form: Format) -> tuple[int, int]:
    """How many questions a model answers right in a format, and how many steps it plays."""
    beside = None if how.adapter is None else str(how.adapter)
    player = LocalPlayer(
        str(how.model), adapter=beside, format=form, retries=0, context=how.context, threads=how.threads
    )
    rules: Any = {"manual": "pinned", "first_observation": "prompt", "offered_tools": "useful"}
    budget = Budget(history=None, reply_tokens=TRIAL_TOKENS, tool_calls=TOLD + QUESTIONS, stalled_turns=STALLED)
    with player, Episode(lockers_setting("LockersTrial-v0", facts=TOLD), seed=0, budget=budget, **rules) as episode:
        result = play(episode, player)
    return int(result.score), result.steps


class LocalPlayer(OpenAIPlayer):
    """A player that asks a model file on this machine. The model is loaded when it is asked for the first time.

    All players of a process that name the same file, adapter, context and threads share one server.

    Arguments:
        model: a known model's name, or the path of a GGUF file; by default the one of `smartplay-tools model get`.
        adapter: the path of a LoRA adapter in GGUF, loaded instead of the model's default adapter.
        format: how tools and calls are written, one of `FORMATS`: "template" is the model's own chat template, whose
            calls llama.cpp reads; in the others they are text in the messages. By default a trial decides (`tried`).
        context: tokens of a prompt and its reply; by default 8,192, or the model's own limit where that is smaller.
        threads: how many threads compute; by default as many as processors are idle, at most four.
        temperature: 0 is the most likely reply; above, replies are drawn with `seed`.
        timeout: seconds that a reply may take, the time included for which it waits for others.
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
        temperature: float = 0.0,
        seed: int = 0,
        timeout: float = 3600.0,
        parameters: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        if refused := {"base_url", "api_key", "stream", "tool_choice"} & options.keys():
            raise InvalidArgumentError(f"A local model takes no {min(refused)}; leave it out, or play openai:MODEL.")
        beside = find_adapter(model) if adapter is None else Path(adapter).expanduser()
        self.loading = Loading(find_model(model), beside, context, threads)
        """How the model is loaded."""
        file = self.loading.check()
        if format is not None and format not in FORMATS:
            raise InvalidArgumentError(f"format must be one of {', '.join(FORMATS)}, not {format!r}.")
        if format == "template" and not file.knows_tools:
            raise InvalidArgumentError(
                f"The chat template of {file.path.name} has no tools; leave format out, or text."
            )
        known = KNOWN_MODELS.get(model)
        self._format = format or (known.format if known is not None and adapter is None else None)
        own = {"temperature": temperature, "seed": seed % 2**32, "cache_prompt": True, **(parameters or {})}
        super().__init__(name_of(model), base_url=UNUSED, seed=seed, timeout=timeout, parameters=own, **options)
        self._numbers = itertools.count()
        self._argument_of: dict[str, str | None] = {}
        """The one argument of each tool that was in a prompt; None for a tool without one."""

    @property
    def format(self) -> Format:
        """How calls are written; where neither the user nor the known model says it, the model is loaded and tried."""
        return self._format or tried(self.loading)[0]

    @property
    def versions(self) -> Mapping[str, str]:
        """What decides the replies beside the prompt, for records: the engine, the format, and the digests of files."""
        files = {"model": self.loading.model, "adapter": self.loading.adapter}
        digests = {name: f"sha256:{sha256_of_file(path)}" for name, path in files.items() if path is not None}
        chosen = {} if self._format else {"trial": tried(self.loading)[1]}
        return {"xllamacpp": xllamacpp.__version__, "format": self.format, **chosen, **digests}

    def request(self, prompt: Prompt) -> dict[str, Any]:
        """Return the body of the request; where the model plays, its reply is bound to the schemas of the tools."""
        may_call = bool(prompt.tools) and prompt.purpose == "play"
        if self.format == "template":
            body = super().request(replace(prompt, tools=tuple(map(bounded, prompt.tools))))
            body |= {"tool_choice": "required", self._limit_field: MOST_TOKENS, **body} if may_call else {}
        else:
            self._argument_of |= {tool.name: argument_of(tool) for tool in prompt.tools}
            written = as_text(prompt.messages, prompt.tools, self.format)
            body = super().request(replace(prompt, shared=written, tools=()))
            body.pop("tool_choice", None)
            body |= {"grammar": grammar_of(prompt.tools, self.format)} if may_call else {}
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
            words, function = call_in(text_of(message), self._argument_of, self.format)
            made: Any = [] if function is None else [{"type": "function", "function": function}]
            message = {"role": "assistant", "content": words or None} if made else message
        else:
            made = calls_of(message)
        if not made:
            return reply
        numbered: Any = [{**call, "id": f"local{next(self._numbers):04d}"} for call in made]
        return replace(reply, message={**message, "tool_calls": numbered})
