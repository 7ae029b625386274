"""What prompts and replies cost at a provider: what its cache sees of requests, and the sum during an episode."""
