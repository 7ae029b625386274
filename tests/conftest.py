"""How many examples property tests draw: 50 in `make test`, 300 with `--hypothesis-profile=thorough`. No clock
decides about an example, since a busy machine is not a fault.

And how many processes `-n auto` starts: two for each processor for the slow tests, which wait for servers, terminals
and engines, and half as many again as there are processors for the fast ones, of which few wait: each process imports
all files, which takes a twentieth of the time of these tests.

And that the garbage collector rests while collection imports whole frameworks, leaves alone what they have made, and
looks for cycles once in 50,000 new objects instead of 700: a sixth of the time of collection, a fifteenth of the
tests'.

And that files of slow tests only, marked as a whole, are not imported where slow tests are left out: with the libraries
that nothing else needs, they were a seventh of the time of collection.

And that a game that a test registers, or reads from a file, is known until the test ends.

And that clients know one certificate, of nobody, instead of all authorities of the system, which take 25 ms to read for
each client: fast tests speak to servers on this machine, without TLS. Slow tests install packages.
"""

import gc
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from smartplay_tools.games import specs

settings.register_profile("quick", max_examples=50, deadline=None)
settings.register_profile("thorough", max_examples=300, deadline=None)
settings.load_profile("quick")
gc.disable()

SLOW_AS_A_WHOLE = re.compile(r"^pytestmark = \[?\s*pytest\.mark\.slow\b", re.MULTILINE)


@pytest.hookimpl(optionalhook=True)  # there are environments without pytest-xdist
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    processors = os.cpu_count() or 2
    return processors * 3 // 2 if config.option.markexpr == "not slow" else processors * 2


@pytest.fixture(autouse=True)
def forget_what_a_test_registers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(specs.GAMES, "_specs", dict(specs.GAMES._specs))
    monkeypatch.setattr(specs.IN_FILES, "read", dict(specs.IN_FILES.read))


@pytest.fixture(scope="module")
def beside_the_scripts() -> Iterator[None]:
    """Scripts find the modules beside them; these and the games that they register go when the tests end."""
    folder = Path(__file__).parents[1] / "experiments"
    before, games = set(sys.modules), dict(specs.GAMES._specs)
    sys.path.insert(0, str(folder))
    yield
    sys.path.remove(str(folder))
    specs.GAMES._specs = games
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], "__file__", None) or "").parent == folder:
            del sys.modules[name]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    if config.option.markexpr != "not slow" or collection_path.suffix != ".py":
        return None
    return SLOW_AS_A_WHOLE.search(collection_path.read_text(encoding="utf-8")) is not None or None


def pytest_collection_finish(session: pytest.Session) -> None:
    if not any(item.get_closest_marker("slow") for item in session.items):
        os.environ["SSL_CERT_FILE"] = str(Path(__file__).parent / "data" / "one_authority.pem")
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    gc.enable()
