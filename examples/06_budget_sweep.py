"""Measure what a smaller context costs in score and saves in tokens, with a sweep over context windows.

    python examples/06_budget_sweep.py

Without MODEL the rule player plays: it knows only what its prompt says, so it scores less with a smaller window. For a
model, set MODEL, OPENAI_API_KEY and, if it is not OpenAI's, OPENAI_BASE_URL.
Every cell has the same seeds; if OUT names a folder, the same command continues a sweep that was stopped.
"""

import os
import tempfile

import smartplay_tools as sp

swept = sp.sweep(
    ["BanditTwoArmedHighLowFixed-v0"],
    [f"openai:{os.environ['MODEL']}" if os.environ.get("MODEL") else "rule"],
    vary={"history": [1, 5, 50], "slack": [0, 0.5]},
    budget=sp.Budget(reply_tokens=500),
    trials=4,
    out=os.environ.get("OUT") or tempfile.mkdtemp(),
    executor="async",  # processes would import this script again
)

for cell in swept.summary:
    difference = "the reference" if cell["reference"] else f"{cell['score_difference']:+6.2f} to the reference"
    print(
        f"history {cell['history']:2}, slack {cell['slack']:3g}: {cell['score']:5.2f} points, {difference}; "
        f"{cell['tokens']:6,.0f} tokens, {cell['prefix_share']:.0%} of the prompts in a stable prefix"
    )
print("On disk:", *swept.write(), sep="\n  ")
