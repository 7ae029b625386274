"""Local models: a GGUF file as a player, run by llama.cpp inside the process, without a key or a network.

    play(episode, LocalPlayer())                      # the model of `smartplay-tools model get`
    play(episode, LocalPlayer("models/qwen3.gguf", temperature=0.7))

llama.cpp's own server listens on a loopback port for as long as the process lives, and `LocalPlayer` is the OpenAI
player in front of it: there is one wire format. A small model must not lose by syntax, so its calls are bound to the
tools' schemas while it writes them.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_local", "local"):
    import xllamacpp as _xllamacpp  # noqa: F401

from smartplay_local.engine import LocalServer, measure
from smartplay_local.player import LocalPlayer

__all__ = ["LocalPlayer", "LocalServer", "measure"]
