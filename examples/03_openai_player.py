"""Play with the player `openai:MODEL`, which handles requests, retries, timeouts, usage and the record.

    python examples/03_openai_player.py

Without MODEL it talks to a local endpoint in which the rule player answers. For a model, set MODEL, OPENAI_API_KEY and,
if it is not OpenAI's, OPENAI_BASE_URL.
"""

import os
import tempfile
from contextlib import ExitStack
from pathlib import Path

import smartplay_gateway

import smartplay_tools as sp

transcript = Path(tempfile.mkdtemp()) / "hanoi.jsonl"

with ExitStack() as stack:
    if os.environ.get("MODEL"):
        player = sp.get_player(f"openai:{os.environ['MODEL']}")
    else:
        endpoint = stack.enter_context(smartplay_gateway.LocalEndpoint(sp.get_player("rule")))
        player = sp.get_player("openai:rule", base_url=endpoint.base_url)
    stack.enter_context(player)

    budget = sp.Budget(prompt_tokens=600, reply_tokens=500)
    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget, transcript=transcript) as episode:
        result = sp.play(episode, player)

print(f"{result.score:g} disks moved in {result.steps} steps ({result.end_reason})")
print(f"tokens by our count: {result.tokens.prompt} in prompts, {result.tokens.reply} in replies")
print(f"by the server's: {result.tokens.provider}")
print("replay:", "identical" if sp.replay(transcript).identical else "differs")
