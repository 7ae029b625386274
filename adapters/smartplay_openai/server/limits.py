"""Simulated limits, with which the endpoint refuses requests like a paid service: long prompts, frequent requests.

They are for testing agents: whether an agent shortens its prompt, waits and retries, and reports why it stopped. Both
refusals are deterministic, so a test that fails once fails again.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

from smartplay_openai.problems import RequestError
from smartplay_tools import InvalidArgumentError


@dataclass
class SimulatedLimits:
    """The limits of an endpoint; by default there are none.

    Arguments:
        context_tokens: a longer prompt, in budget tokens, is refused as `context_length_exceeded`.
        busy_every: N, where every Nth request is refused with status 429.
        retry_after: the seconds that such a refusal asks to wait.
    """

    context_tokens: int | None = None
    busy_every: int | None = None
    retry_after: float = 0.0
    _requests: itertools.count[int] = field(default_factory=lambda: itertools.count(1), init=False, repr=False)

    def __post_init__(self) -> None:
        """Raise an error for limits under which no request would ever be answered."""
        if self.context_tokens is not None and self.context_tokens < 1:
            raise InvalidArgumentError(f"context_tokens={self.context_tokens} would refuse every prompt.")
        if self.busy_every is not None and self.busy_every < 2:
            raise InvalidArgumentError(f"busy_every={self.busy_every} would refuse every request; give at least 2.")

    def check_rate(self) -> None:
        """Count a request; raise `RequestError` if it is to be refused."""
        if self.busy_every is not None and next(self._requests) % self.busy_every == 0:
            problem = f"Rate limit reached: this endpoint refuses one in {self.busy_every} requests. Try again."
            headers = {"retry-after": f"{self.retry_after:g}"}
            raise RequestError(429, problem, code="rate_limit_exceeded", kind="requests", headers=headers)

    def check_length(self, tokens: int, param: str) -> None:
        """Raise `RequestError` if a prompt of this many tokens is too long."""
        if self.context_tokens is not None and tokens > self.context_tokens:
            problem = f"This model's maximum context length is {self.context_tokens} tokens, the prompt has {tokens}."
            raise RequestError(400, problem, param=param, code="context_length_exceeded")
