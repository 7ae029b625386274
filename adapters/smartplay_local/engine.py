"""The engine: llama.cpp's server inside this process, on a free loopback port.

A model that this machine cannot hold is refused before it is loaded, because an operating system that runs out of
memory ends some process, not necessarily this one.
"""

from __future__ import annotations

import functools
import importlib
import json
import os
import threading
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from smartplay_local.model_files import GGUF, read_adapter, read_gguf, read_model
from smartplay_tools import InvalidArgumentError
from smartplay_tools.errors import extra_named

DEFAULT_CONTEXT = 8192
"""Tokens of a prompt and its reply, or the model's own limit where that is smaller."""

MOST_THREADS = 4
"""By default no more threads than this compute."""

_LOADING = threading.Lock()

with extra_named("smartplay_local", "local"):
    xllamacpp: Any = importlib.import_module("xllamacpp")
"""llama.cpp in this process; the package has no types."""


@dataclass(frozen=True)
class Loading:
    """How a model is loaded: everything that decides which server answers."""

    model: Path
    """The GGUF file."""
    adapter: Path | None = None
    """The GGUF file of a LoRA adapter of this model."""
    context: int | None = None
    """Tokens of a prompt and its reply."""
    threads: int | None = None
    """How many threads compute; the order of additions, hence a close choice, can depend on it."""

    def check(self) -> GGUF:
        """Return the model's file; an `InvalidArgumentError` if it cannot be loaded like this on this machine."""
        file = read_model(self.model)
        if self.threads is not None and self.threads < 1:
            raise InvalidArgumentError(f"threads is at least 1, not {self.threads}.")
        if self.adapter is not None:
            read_adapter(self.adapter, file)
        needed, free = self.memory, free_memory()
        if free is not None and needed > free:
            raise InvalidArgumentError(
                f"{file.path.name} takes about {needed / 1e9:,.1f} GB with a context of {self.tokens(file):,} tokens, "
                f"and {free / 1e9:,.1f} GB are free: choose a smaller context (--player-option context=N) or a "
                "smaller model."
            )
        return file

    @property
    def memory(self) -> int:
        """About how many bytes it takes; the engine keeps prompts of other episodes in as much as its context takes."""
        file = read_gguf(self.model)
        beside = 0 if self.adapter is None else read_gguf(self.adapter).bytes
        return file.memory(2 * self.tokens(file)) + beside

    def tokens(self, file: GGUF) -> int:
        """Return the context to play with; one that is longer than the model's own is refused."""
        longest = file.context_length or DEFAULT_CONTEXT
        if self.context is None:
            return min(DEFAULT_CONTEXT, longest)
        if not 1 <= self.context <= longest:
            raise InvalidArgumentError(f"context is between 1 and {longest:,}, the model's own, not {self.context:,}.")
        return self.context

    def start(self) -> Any:
        """Load the model and return llama.cpp's server."""
        file = self.check()
        tokens, threads = self.tokens(file), self.threads or idle_threads()
        params = xllamacpp.CommonParams()
        params.model.path = str(file.path)
        params.n_ctx, params.n_parallel = tokens, 1
        params.cache_ram_mib = max(1, tokens * file.cache_bytes // 2**20)
        params.cpuparams.n_threads = params.cpuparams_batch.n_threads = threads
        params.use_jinja, params.hostnames, params.port = True, ["127.0.0.1"], 0
        params.n_gpu_layers, params.fit_params = 0, False
        params.ui, params.warmup, params.verbosity = False, False, -1
        if self.adapter is not None:
            adapter = xllamacpp.CommonAdapterLoraInfo()
            adapter.path, adapter.scale = str(self.adapter), 1.0
            params.lora_adapters = [adapter]
        try:
            return xllamacpp.Server(params)
        except RuntimeError as error:
            beside = "" if self.adapter is None else f" with the adapter {self.adapter.name}"
            raise InvalidArgumentError(
                f"llama.cpp could not load {file.path.name}{beside} ({error}): a file or its chat template may be "
                f"damaged, or of a kind that xllamacpp {xllamacpp.__version__} does not know."
            ) from error


def idle_threads() -> int:
    """Return how many threads compute by default: as many as processors are idle, where the system says it.

    Two threads on two busy processors wait for each other, and are slower than one.
    """
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return max(1, min(MOST_THREADS, round(processors - load)))


class LocalServer:
    """A model behind llama.cpp's server, until `close`; the arguments are the fields of `Loading`."""

    def __init__(self, model: str | Path, **loading: Any) -> None:
        how = Loading(Path(model).expanduser(), **loading)
        self._server: Any = how.start()
        self.base_url = f"{self._server.listening_address}/v1"

    def written(self, messages: Sequence[Mapping[str, Any]], tools: Sequence[Mapping[str, Any]]) -> str:
        """Return a prompt as the model's chat template writes it; a `ValueError` says why it cannot."""
        try:
            return str(self.ask("/apply-template", {"messages": messages, "tools": tools})["prompt"])
        except urllib.error.HTTPError as error:
            answer = error.read().decode("utf-8", "replace")
            raise ValueError(answer.partition('"message":"')[2][:200] or answer[:200]) from error

    def ask(self, path: str, body: dict[str, Any]) -> dict[str, Any]:
        """Send a request to the engine, past the environment's proxies, and return the answer."""
        url, headers = self.base_url.removesuffix("/v1") + path, {"Content-Type": "application/json"}
        request = urllib.request.Request(url, json.dumps(body).encode(), headers)
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=600) as answer:
            result: dict[str, Any] = json.load(answer)
        return result

    def close(self) -> None:
        """Stop the server and free the model."""
        self._server = None


@functools.cache
def shared_server(how: Loading) -> LocalServer:
    """Return the one server of this process for a model, started at the first call."""
    with _LOADING:
        return LocalServer(**vars(how))


def free_memory() -> int | None:
    """Return how many bytes programs can still take, where the system says it."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    free = (line.split()[1] for line in lines if line.startswith("MemAvailable:"))
    return next((int(kibibytes) * 1024 for kibibytes in free), None)
