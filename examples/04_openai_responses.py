"""A loop with the stateless Responses interface, written out: a model's reasoning is sent back with its turn.

    python examples/04_openai_responses.py

Without MODEL it talks to a local endpoint in which the rule player answers. For a model, set MODEL, OPENAI_API_KEY and,
if it is not OpenAI's, OPENAI_BASE_URL.
"""

import os
from contextlib import ExitStack

import openai
import smartplay_gateway
import smartplay_openai

import smartplay_tools as sp

with ExitStack() as stack:
    if os.environ.get("MODEL"):
        client, model = stack.enter_context(openai.OpenAI()), os.environ["MODEL"]
    else:
        endpoint = stack.enter_context(smartplay_gateway.LocalEndpoint(sp.get_player("rule")))
        http_client = openai.DefaultHttpxClient(trust_env=False)  # no proxy between this machine and itself
        client = stack.enter_context(openai.OpenAI(base_url=endpoint.base_url, api_key="none", http_client=http_client))
        model = "rule"

    budget = sp.Budget(prompt_tokens=600, reply_tokens=2000)
    episode = stack.enter_context(sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget))
    conversation = sp.Conversation(episode, player=model)
    while (prompt := conversation.prompt()) is not None:
        response = client.responses.create(model=model, **smartplay_openai.responses_request(prompt))
        reply = smartplay_openai.responses_reply(response)
        print("output items:", ", ".join(item.type for item in response.output))
        for result in conversation.receive(reply):
            print(result.text)

result = conversation.result
print(f"{result.score:g} disks moved in {result.steps} steps ({result.end_reason})")
