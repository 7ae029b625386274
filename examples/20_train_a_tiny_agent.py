"""Train an agent of your own on a laptop: on a teacher's records, then by reward, in the windows that it plays in.

    pip install 'smartplay-tools[train]'
    python examples/20_train_a_tiny_agent.py           # some four minutes of one processor, or CUDA; no key, no network
    python examples/20_train_a_tiny_agent.py --quick   # a minute, which shows that everything works and teaches little

`rule` plays; its records are exported; a transformer of 160,000 parameters learns to reply as `rule` did, from what
`rule` saw; it plays worlds that neither saw; and under the smallest cap it is trained further by reward.
`examples/tiny_agent.py` has the model. docs/train-a-tiny-agent.md says what came out, and how sure that is.
"""

import argparse
import random
import tempfile
from collections.abc import Iterable
from pathlib import Path

import tiny_agent

import smartplay_tools as sp
from smartplay_tools.evaluation.exports import export
from smartplay_tools.statistics.intervals import mean_estimate

GAME = "RockPaperScissorBasic-v0"
CAPS = (600, 800, 1200, None)  # tokens of a prompt; None is full context
HELD_OUT, REWARDED = 1_000_000, 2_000_000  # seeds of the worlds; the teacher plays others


def episodes(cap: int | None, seeds: Iterable[int]) -> list[sp.Episode]:
    return [sp.Episode(GAME, seed=seed, budget=sp.Budget(prompt_tokens=cap)) for seed in seeds]


def show(what: str, played: Iterable[sp.Episode]) -> None:
    scores = mean_estimate([episode.result.score for episode in played if episode.result])
    interval = "" if scores.low is None else f" [{scores.low:.1f}, {scores.high:.1f}]"
    print(f"{what:20} {scores.mean:5.1f}{interval}", flush=True)


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--quick", action="store_true")
quick = parser.parse_args().quick
worlds, tokens, held_out, updates = (2, 60_000, 1, 1) if quick else (60, 4_000_000, 40, 30)

folder = Path(tempfile.mkdtemp())
budgets = [sp.Budget(prompt_tokens=cap) for cap in CAPS]
sp.evaluate([GAME], ["rule"], budgets=budgets, trials=worlds, seed=1, out=folder / "run", executor="inline")
print(export(folder / "run", folder / "data", "sft-chains").counts)

rows = tiny_agent.read_rows(folder / "data")
tokenizer = tiny_agent.make_tokenizer(random.Random(0).sample(rows, min(len(rows), 1500)))
model = tiny_agent.new_model(tokenizer, seed=0)
loss = tiny_agent.train(model, [tiny_agent.encode(tokenizer, row) for row in rows], tokens)
print(f"trained on the replies of {len(rows)} rows: loss {loss:.3f}")


def play_held_out(stage: str) -> None:
    for cap in CAPS:
        played = episodes(cap, range(HELD_OUT, HELD_OUT + held_out))
        tiny_agent.play(model, tokenizer, played)
        show(f"{stage}, {cap or 'no cap'}", played)


play_held_out("taught")
groups = ([episodes(CAPS[0], [REWARDED + 4 * n + world] * 6) for world in range(4)] for n in range(updates))
for number, score in enumerate(tiny_agent.reinforce(model, tokenizer, groups), start=1):
    print(f"update {number} of {updates}: mean score {score:.1f}", flush=True)
play_held_out("rewarded")
