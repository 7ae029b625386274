"""The check of which engines work on this machine: it creates a world on each of them."""

from __future__ import annotations

import time
from dataclasses import dataclass

from smartplay_tools.errors import SmartPlayError
from smartplay_tools.games.minecraft.engines import ENGINES, load_engine
from smartplay_tools.games.minecraft.tasks import CORRECTED_GOALS


@dataclass(frozen=True)
class Check:
    """The result of the check of an engine."""

    engine: str
    works: bool
    detail: str
    """The time that a new world took and the program that made it, or the error and the remedy."""


def check_engines() -> list[Check]:
    """Make a world on every engine; if one fails, the others are still tried."""
    return [_check(name) for name in ENGINES]


def _check(name: str) -> Check:
    start = time.perf_counter()
    try:
        engine = load_engine(name)(text="corrected")
        try:
            engine.reset(0, CORRECTED_GOALS[0])
            programs = "".join(f" ({program} {version})" for program, version in engine.versions.items())
        finally:
            engine.close()
    except SmartPlayError as error:
        return Check(name, False, str(error))
    except Exception as error:  # any error of an engine is a result of the check
        return Check(name, False, f"{type(error).__name__}: {error}")
    return Check(name, True, f"a new world in {time.perf_counter() - start:.2f} s{programs}")
