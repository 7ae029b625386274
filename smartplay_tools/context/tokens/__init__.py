"""Budget tokens: one exact, offline count for every conversation.

Providers count tokens in their own ways, some of them undocumented. A budget has to be the same in every framework,
known before the call and reproducible, so the count is defined here, on the canonical chat form with a real tokenizer:

- a message is 3 + n(role) + n(its text), + 1 + n(name) if it is named, + 3 + 8 + n(name) + n(arguments) for each tool
  call, + 8 for a result's call id (ids are random: they cost a constant), + n(readable text) of reasoning;
- a prompt is the sum over its messages, + 3 for priming, + the tools by the formula that OpenAI's cookbook gives.

`TokenCounter` counts by this definition; the tokenizers that it can count with are in `tokenizers`.
"""

from smartplay_tools.context.tokens.counter import PRIMING, TokenCounter
from smartplay_tools.context.tokens.o200k import VOCABULARY_SHA256, vocabulary
from smartplay_tools.context.tokens.tokenizers import DEFAULT_TOKENIZER, Tokenizer, get_tokenizer

__all__ = [
    "DEFAULT_TOKENIZER",
    "PRIMING",
    "VOCABULARY_SHA256",
    "TokenCounter",
    "Tokenizer",
    "get_tokenizer",
    "vocabulary",
]
