"""A loop around Anthropic's client, written out: `request` converts a prompt, `reply` converts an answer.

    python examples/13_anthropic.py
    SMARTPLAY_MODEL=claude-sonnet-4-5 python examples/13_anthropic.py

Without a model's name the rule player answers instead of the client, and no key is needed.
"""

import os

import anthropic
from smartplay_anthropic import reply, request

import smartplay_tools as sp

name = os.environ.get("SMARTPLAY_MODEL")
client = anthropic.Anthropic() if name else None
rule = sp.get_player("rule")

with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=700)) as episode:
    conversation = sp.Conversation(episode)
    while (prompt := conversation.prompt()) is not None:
        body = request(prompt)
        answer = reply(client.messages.create(model=name, **body)) if client else rule.reply(prompt)
        conversation.receive(answer)

print(f"the last request held {len(body['messages'])} messages and {len(body['tools'])} tools")
print(f"{episode.result.score:g} disks moved in {episode.result.steps} steps ({episode.result.end_reason})")
