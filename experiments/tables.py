"""The tables of the documentation that are made of published rows, all of them in seconds.

python experiments/tables.py              # prints them
python experiments/tables.py --publish    # puts them and their figures into the pages
python experiments/tables.py ruler arena  # these experiments alone
"""

from __future__ import annotations

import argparse
from importlib import import_module

from context import EXPERIMENTS
from page_tables import Experiment
from scores import DEGREES

SCRIPTS = (
    "arena", "arena_curves", "arena_claims", "cap_audit", "caps", "carry", "compaction", "entry", "learned_tables",
    "models", "ruler", "scores", "summaries", "window_for_a_budget", "wordings",
)  # fmt: skip


def experiments() -> dict[str, Experiment]:
    """Return the experiments by their names."""
    own = [DEGREES, *(import_module(script).EXPERIMENT for script in SCRIPTS)]
    return EXPERIMENTS | {experiment.name: experiment for experiment in own}


def main() -> None:
    """Print or publish the tables."""
    known = experiments()
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", help=f"experiments, all if not given: {', '.join(known)}")
    parser.add_argument("--publish", action="store_true", help="put tables and figures into the documentation")
    asked = parser.parse_args()
    if unknown := set(asked.names) - set(known):
        parser.error(f"no experiment {', '.join(sorted(unknown))}: they are {', '.join(known)}")
    for name in asked.names or known:
        if asked.publish:
            known[name].publish()
        else:
            print(*known[name].tables(known[name].rows()).values(), sep="\n\n", end="\n\n")


if __name__ == "__main__":
    main()
