"""The tokens of a reply: those that a provider reports, and those that a model drew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from smartplay_tools.types.recorded import Count, Recorded


class SampledTokens(Recorded):
    """A reply in the tokens that the model drew, for training on records; no prompt, count or score depends on them.

    Tokenising the text again can give tokens other than those drawn, and the probabilities hold only for those drawn.
    """

    later: ClassVar[Mapping[str, Any]] = {"logprobs": None, "prompt": None}

    reply: tuple[Count, ...]
    """The ids of the reply's tokens, the one that ends it included."""
    logprobs: tuple[Annotated[float, Field(le=0, allow_inf_nan=False)], ...] | None = None
    """The natural logarithm of the probability with which each of them was drawn."""
    prompt: tuple[Count, ...] | None = None
    """The ids of the prompt's tokens. They make a record much longer, because every turn has its whole prompt."""

    @model_validator(mode="after")
    def _has_a_logprob_for_each(self) -> Self:
        if self.logprobs is not None and len(self.logprobs) != len(self.reply):
            raise ValueError(f"there are {len(self.logprobs)} logprobs for {len(self.reply)} tokens")
        return self


MOST_TOKENS = 10**12
"""More tokens than a provider can have counted for one reply."""


class Usage(Recorded):
    """Tokens as a provider reports them.

    `cached`, read from its cache, and `written` to it are parts of `prompt`, `reasoning` is a part of `reply`.
    """

    later: ClassVar[Mapping[str, Any]] = {"written": 0, "written_1h": 0, "cut": 0}

    prompt: int = 0
    reply: int = 0
    cached: int = 0
    written: int = 0
    written_1h: int = 0
    """The part of `written` that is kept for an hour, where a provider reports it separately."""
    reasoning: int = 0
    requests: int = 1
    """The attempts made for one reply, each of which is billed."""
    cut: int = 0
    """Replies that the provider cut at their length limit, by their `finish_reason`."""

    @classmethod
    def reported(cls, event: Mapping[str, Any]) -> Usage | None:
        """Return the provider's count in a `usage` event; None if it gave none, or numbers that cannot be tokens."""
        usage = None if event["provider"] is None else cls(**event["provider"])
        return usage if usage is not None and usage.is_possible else None

    @property
    def is_possible(self) -> bool:
        """Whether the numbers can be tokens: none is negative or beyond 10^12, and no part is larger than its whole."""
        numbers = [getattr(self, name) for name in Usage.model_fields]
        parts = self.cached + self.written <= self.prompt and self.written_1h <= self.written
        return parts and min(numbers) >= 0 and max(numbers) <= MOST_TOKENS

    @property
    def has_tokens(self) -> bool:
        """Whether a provider has counted any: what asks it counts its requests even where it reports no tokens."""
        return self.prompt > 0 or self.reply > 0

    def replaced_by(self, reported: Usage | None) -> Usage:
        """Return the usage that a provider reported in place of our count, which this is.

        Without tokens in it, or with numbers that cannot be tokens, its requests and cut replies count, and our tokens.
        """
        if reported is None:
            return self
        if reported.has_tokens and reported.is_possible:
            return reported
        return self.model_copy(update={"requests": reported.requests, "cut": reported.cut})

    def __add__(self, other: Usage) -> Usage:
        return Usage(**{name: getattr(self, name) + getattr(other, name) for name in Usage.model_fields})
