"""How many examples property tests draw: 50 in `make test`, 1,000 with `--hypothesis-profile=thorough`. No clock
decides about an example, since a busy machine is not a fault.

And how many processes `-n auto` starts: half as many again as there are processors, because tests of servers, terminals
and engines wait. With one for each, two processors were idle for two fifths of the time of `make test`.

And that the garbage collector leaves alone what collection has imported, whole frameworks, which it would search again
and again: a fifteenth of the tests' time.

And that clients know one certificate, of nobody, instead of all authorities of the system, which take 25 ms to read for
each client: fast tests speak to servers on this machine, without TLS. Slow tests install packages.
"""

import gc
import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("quick", max_examples=50, deadline=None)
settings.register_profile("thorough", max_examples=1_000, deadline=None)
settings.load_profile("quick")


@pytest.hookimpl(optionalhook=True)  # there are environments without pytest-xdist
def pytest_xdist_auto_num_workers() -> int:
    return (os.cpu_count() or 2) * 3 // 2


def pytest_collection_finish(session: pytest.Session) -> None:
    if not any(item.get_closest_marker("slow") for item in session.items):
        os.environ["SSL_CERT_FILE"] = str(Path(__file__).parent / "data" / "one_authority.pem")
    gc.collect()
    gc.freeze()
