"""Local models: a GGUF file as a player, run by llama.cpp inside the process, without a key or a network.

    play(episode, LocalPlayer())                      # the model of `smartplay-tools model get`
    play(episode, LocalPlayer("models/qwen3.gguf", temperature=0.7))

llama.cpp's own server listens on a loopback port for as long as the process lives, and `LocalPlayer` is the OpenAI
player in front of it: there is one wire format. A model whose chat template has tools is sent them there; others read
them in the system message. A small model must not lose by syntax, so its calls are bound to the tools' schemas while it
writes them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_local.engine import LocalServer as LocalServer
    from smartplay_local.model_files import (
        DEFAULT_MODEL as DEFAULT_MODEL,
        GGUF as GGUF,
        KNOWN_MODELS as KNOWN_MODELS,
        KnownModel as KnownModel,
        fetch as fetch,
        find_model as find_model,
        name_of as name_of,
        read_gguf as read_gguf,
    )
    from smartplay_local.player import LocalPlayer as LocalPlayer

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
