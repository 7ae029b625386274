"""Fitted prompts of random conversations, judged by the definition; `tests.manager.fuzz` draws a million of them."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections import Counter
from pathlib import Path

from tests.manager.fuzz import digests, some


def test_no_prompt_of_a_random_conversation_has_a_fault():
    rows, found = some(0, 160, seed=6)
    assert not found, found[0]
    parts = "of fewer messages", "with cuts", "repaired", "with summaries", "compared with the definition"
    assert rows >= Counter({**dict.fromkeys(parts, 50), "prompts": 2_000, "rewritten": 5}), rows


def test_another_process_shows_the_same_prompts_in_another_order():
    numbers = [*range(120)]
    here = {str(number): digest for number, digest in digests(numbers, seed=8).items()}
    random.Random(8).shuffle(numbers)
    program = f"import json\nfrom tests.manager.fuzz import digests\nprint(json.dumps(digests({numbers}, seed=8)))"
    ran = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONHASHSEED": "8"},
        capture_output=True,
        check=True,
    )
    assert len({*here.values()}) > 100
    assert json.loads(ran.stdout) == here
