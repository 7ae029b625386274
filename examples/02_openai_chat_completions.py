"""A loop between a game and chat completions, written out: every request and every tool result is visible.

    python examples/02_openai_chat_completions.py

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

    episode = stack.enter_context(sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=600)))
    conversation = sp.Conversation(episode, player=model)
    while (prompt := conversation.prompt()) is not None:
        completion = client.chat.completions.create(model=model, **smartplay_openai.chat_request(prompt))
        reply = smartplay_openai.chat_reply(completion)
        print(f"{conversation.view.tokens} tokens sent in {len(prompt.messages)} messages")
        for result in conversation.receive(reply):
            print(result.text)

result = conversation.result
print(f"{result.score:g} disks moved in {result.steps} steps ({result.end_reason})")
print(f"prompt tokens: {result.tokens.prompt} by our count, {result.tokens.provider.prompt} by the server's")
