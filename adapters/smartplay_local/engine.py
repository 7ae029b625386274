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
import time
import urllib.request
from pathlib import Path
from typing import Any

from smartplay_local.model_files import GGUF, read_gguf
from smartplay_tools import InvalidArgumentError
from smartplay_tools.errors import extra_named

DEFAULT_CONTEXT = 8192
"""Tokens of a prompt and its reply, or the model's own limit where that is smaller."""

MOST_THREADS = 4
"""By default no more threads than this compute, and no more than there are processors."""

_LOADING = threading.Lock()

with extra_named("smartplay_local", "local"):
    xllamacpp: Any = importlib.import_module("xllamacpp")
"""llama.cpp in this process; the package has no types."""


class LocalServer:
    """A model behind llama.cpp's server, until `close`.

    Arguments:
        model: the GGUF file.
        context: tokens of a prompt and its reply.
        threads: how many threads compute; the order of additions, hence a close choice, can depend on it.
    """

    def __init__(self, model: str | Path, *, context: int | None = None, threads: int | None = None) -> None:
        file = read_gguf(model)
        self.context = checked_context(file, context)
        check_memory(file, self.context)
        self._server: Any = _start(file, self.context, checked_threads(threads))
        self.base_url = f"{self._server.listening_address}/v1"

    def tokens(self, text: str) -> int:
        """Return how many tokens of this model a text has, by the engine's own count."""
        body = {"content": text, "add_special": False, "parse_special": False}
        return len(self.ask("/tokenize", body)["tokens"])

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
def shared_server(model: Path, context: int | None, threads: int | None) -> LocalServer:
    """Return the one server of this process for a model, started at the first call."""
    with _LOADING:
        return LocalServer(model, context=context, threads=threads)


def checked_context(file: GGUF, context: int | None) -> int:
    """Return the context to play with; one that is longer than the model's own is refused."""
    longest = file.context_length or DEFAULT_CONTEXT
    if context is None:
        return min(DEFAULT_CONTEXT, longest)
    if not 1 <= context <= longest:
        raise InvalidArgumentError(f"context is between 1 and {longest:,}, the model's own, not {context:,}.")
    return context


def checked_threads(threads: int | None) -> int:
    """Return how many threads compute."""
    if threads is None:
        return min(MOST_THREADS, os.cpu_count() or 1)
    if threads < 1:
        raise InvalidArgumentError(f"threads is at least 1, not {threads}.")
    return threads


def check_memory(file: GGUF, context: int) -> None:
    """Refuse a model that does not fit into the memory that is free now."""
    needed, free = file.memory(context), free_memory()
    if free is not None and needed > free:
        raise InvalidArgumentError(
            f"{file.path.name} takes about {needed / 1e9:,.1f} GB with a context of {context:,} tokens, and "
            f"{free / 1e9:,.1f} GB are free: choose a smaller context (--player-option context=N) or model."
        )


def free_memory() -> int | None:
    """Return how many bytes programs can still take, where the system says it."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    free = (line.split()[1] for line in lines if line.startswith("MemAvailable:"))
    return next((int(kibibytes) * 1024 for kibibytes in free), None)


def _start(file: GGUF, context: int, threads: int) -> Any:
    params = xllamacpp.CommonParams()
    params.model.path = str(file.path)
    params.n_ctx, params.n_parallel = context, 1
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = threads
    params.use_jinja, params.hostnames, params.port = True, ["127.0.0.1"], 0
    params.n_gpu_layers, params.fit_params = 0, False
    params.ui, params.warmup, params.verbosity = False, False, -1
    try:
        return xllamacpp.Server(params)
    except RuntimeError as error:
        raise InvalidArgumentError(
            f"llama.cpp could not load {file.path.name} ({error}): the file may be damaged, or of a model that "
            f"xllamacpp {xllamacpp.__version__} does not know."
        ) from error


def measure(model: str | Path, *, tokens: int = 32) -> dict[str, float]:
    """Return the seconds that loading takes, and how many tokens a second are read and written on this machine."""
    began = time.perf_counter()
    server = LocalServer(model)
    loaded = time.perf_counter() - began
    body = {"prompt": "The quick brown fox jumps over the lazy dog. " * 20, "ignore_eos": True}
    timings = server.ask("/completion", {**body, "n_predict": tokens})["timings"]
    server.close()
    return {
        "load_seconds": loaded,
        "read_per_second": timings["prompt_per_second"],
        "written_per_second": timings["predicted_per_second"],
    }
