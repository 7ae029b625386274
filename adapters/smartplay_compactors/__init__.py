"""Compactors of projects that have no other adapter here: Agent Framework and LlamaIndex.

Each is a strategy by name, with the project's code unchanged:

    sp.Budget(prompt_tokens=1500, strategy="llama-index-summary:tokens=400")

`embeddings` is a memory with the word vectors of WordLlama. This module imports none of the packages.
"""

__all__: list[str] = []
