"""Models on this machine: files in llama.cpp's format GGUF, which the extra `local` plays without a key or a network.

    fetch("smollm2-135m", print)        # once: downloads it into the user's cache folder and compares its sha256
    find_model("smollm2-135m")          # its path; any other name is the path of a file of yours

model_files   the models that can be downloaded by name, and where they are kept
gguf_header   what a model file says of itself: its vocabulary, its shape, the memory that it takes
"""

from smartplay_tools.models.gguf_header import GGUF, read_gguf
from smartplay_tools.models.model_files import DEFAULT_MODEL, KNOWN_MODELS, KnownModel, fetch, find_model, name_of

__all__ = ["DEFAULT_MODEL", "GGUF", "KNOWN_MODELS", "KnownModel", "fetch", "find_model", "name_of", "read_gguf"]
