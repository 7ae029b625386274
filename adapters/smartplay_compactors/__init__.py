"""Compactors of projects that have no other adapter here: Google ADK, Agent Framework, LlamaIndex and OpenHands.

Each is a strategy by name, with the project's code unchanged:

    sp.Budget(prompt_tokens=1500, strategy="llama-index-summary:tokens=700")

`embeddings` is a memory with vectors of words, which a package brings along. This module imports none of them.
"""
