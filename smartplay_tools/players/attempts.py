"""Attempts: how often and how fast a failed request is retried. Each attempt is billed, so each is counted.

The code does not depend on a client library. It reads `status_code`, `code` and the headers of `response` from an
error where they exist, as in the errors of OpenAI's, Anthropic's and httpx's clients.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Mapping
from dataclasses import replace
from email.utils import parsedate_to_datetime
from typing import Any
from urllib.parse import urlsplit

from smartplay_tools.errors import PromptRefusedError, SmartPlayError
from smartplay_tools.players.server_errors import ServerError, server_error
from smartplay_tools.types import Reply, Usage

LONGEST_PAUSE = 8.0
"""Seconds at which the pauses stop doubling."""

LONGEST_WISH = 60.0
"""The request is not retried if the server asks for a longer pause than this."""


class ModelCallError(SmartPlayError):
    """A model gave no reply. The message has the number of attempts and the reason; `usage` is their cost."""

    def __init__(self, usage: Usage, error: Exception) -> None:
        times = "1 attempt" if usage.requests == 1 else f"{usage.requests} attempts"
        said, reason = server_error(error), str(error).rstrip(".")
        for words in (words.rstrip(".") for words in said.words):  # of a provider behind a gateway
            if words not in reason and repr(words)[1:-1] not in reason:
                reason = f"{reason}: {words}"
        if (url := _asked(error)) and url not in reason:
            reason = f"{reason} ({url})"
        super().__init__(f"No reply from the model in {times}: {type(error).__name__}: {reason}{_remedy(error, said)}")
        self.usage = usage


REMEDIES = {
    "quota": "The account behind the key has nothing left to spend",
    "key": "Check the key, which is read from a variable such as OPENAI_API_KEY",
    "model": "Check the model's name and --base-url, which ends in /v1 as a rule",
    "interface": "Play it as openai-responses:MODEL, or without reasoning: parameters={{'reasoning_effort': 'none'}}",
    "cap": "The cap on replies, reply_tokens (--reply-tokens), is larger than this model takes: lower it",
    "moderation": "A filter of the provider refuses this prompt",
    "context": "The model's context{tokens} is full; --prompt-tokens keeps prompts and replies within it",
}
"""What a user can do, by what an error is about."""


def _remedy(error: Exception, said: ServerError) -> str:
    """What a user can do about an error, after the sentence that reports it."""
    if said.about in REMEDIES:
        tokens = "" if said.tokens is None else f" of {said.tokens:,} tokens"
        return f". {REMEDIES[said.about].format(tokens=tokens)}"
    return ". Is the server running at this address?" if type(error).__name__ == "APIConnectionError" else ""


class ModelRefusedError(ModelCallError):
    """A server refuses every request of this player: the key, the address or the model's name is wrong."""


class ModelPromptError(ModelCallError, PromptRefusedError):
    """A server refuses this one prompt, which the model's context cannot hold."""


class ModelFilterError(ModelPromptError):
    """A filter of the provider refuses this one prompt, which is counted."""

    def __init__(self, usage: Usage, error: Exception) -> None:
        super().__init__(usage.model_copy(update={"refused": 1}), error)


PROMPT_ERRORS = {"context": ModelPromptError, "moderation": ModelFilterError}
"""How a refused prompt is raised, by what the refusal is about."""


def given_up(error: Exception) -> Exception:
    """Return what an episode is given up with (`BaseConversation.give_up`) after an error of a framework's client."""
    about = "" if isinstance(error, ModelCallError) else server_error(error).about
    return PROMPT_ERRORS[about](Usage(), error) if about in PROMPT_ERRORS else error


def reply_in(error: Exception) -> Reply:
    """Return the reply that an error of a framework's client was: a call of the model that the server could not read.

    Any other error is raised again, one of this prompt as a `PromptRefusedError`.
    """
    said, other = server_error(error), given_up(error)
    if said.whose == "model":
        return said.as_reply()
    if other is error:
        raise error
    raise other from error


class BrokenAnswerError(Exception):
    """A server's answer is not a reply: it has no choices, its stream ends early, or it is something else."""

    def __init__(self, problem: str, usage: Usage | None = None, body: Any = None) -> None:
        super().__init__(problem)
        self.usage = usage
        """The usage that the provider reports for it, if any."""
        self.body = body
        """The error that the answer holds in place of a reply, if it does."""


class UnreadableAnswerError(BrokenAnswerError):
    """A whole answer whose shape is not that of a reply: the same would come again, so it is asked for once more."""


def plain_answer(answer: Any) -> dict[str, Any]:
    """Return a client's object as a dictionary of only the fields that were sent, whatever a server has put into them.

    A mapping is copied; anything else that is not the client's raises a `BrokenAnswerError`.
    """
    if isinstance(answer, Mapping):
        return dict(answer)
    dump = getattr(answer, "model_dump", None)
    if dump is None:
        raise BrokenAnswerError(f"The server sent {str(answer)[:80]!r}, which is not JSON.")
    # The client's objects may have values that their fields do not allow; its warnings are not needed.
    sent: dict[str, Any] = dump(exclude_unset=True, warnings=False)
    return sent


def error_in(answer: Mapping[str, Any], problem: str) -> str:
    """Return a sentence with a problem of an answer, and with what the server says went wrong, if it does."""
    error = answer.get("error")
    reason = error.get("message") if isinstance(error, Mapping) else error
    return f"{problem}: {reason.rstrip('.')}." if reason and isinstance(reason, str) else f"{problem}."


def unreadable(answer: Mapping[str, Any], problem: str, usage: Usage | None) -> BrokenAnswerError:
    """Return the error of an answer that is not a reply: its own, if it says what went wrong, or that of its shape."""
    kind = BrokenAnswerError if answer.get("error") else UnreadableAnswerError
    return kind(error_in(answer, problem), usage, answer.get("error"))


class Attempts:
    """The attempts at one reply. Pauses begin at `first_pause` seconds and double; a quarter of each is random."""

    def __init__(self, retries: int, first_pause: float, jitter: random.Random) -> None:
        self._retries, self._first_pause, self._jitter = retries, first_pause, jitter
        self._made = self._unreadable = 0
        self._spent = Usage(requests=0)

    def begin(self) -> None:
        """Count an attempt, whether or not it succeeds."""
        self._made += 1

    def usage(self, last: Usage | None) -> Usage:
        """The usage of all attempts together; `last` is the provider's usage of the one that succeeded."""
        spent = self._spent if last is None else self._spent + last
        return spent.model_copy(update={"requests": self._made})

    def broken_call(self, error: Exception) -> Reply | None:
        """Return the reply that an error was, if it is a call of the model that the server could not read."""
        said, charged = server_error(error), getattr(error, "usage", None)
        if said.whose != "model":
            return None
        reply = said.as_reply(charged if isinstance(charged, Usage) else None)
        return replace(reply, usage=self.usage(reply.usage))

    def pause(self, error: Exception) -> float:
        """Return the seconds to wait before asking again; raise `ModelCallError` if that is pointless."""
        charged = getattr(error, "usage", None)
        if isinstance(charged, Usage):
            self._spent += charged
        said, wish = server_error(error), _wish(error)
        wish = said.wait if wish is None else wish
        if said.whose == "player":
            raise ModelRefusedError(self.usage(None), error) from error
        if said.about in PROMPT_ERRORS:
            raise PROMPT_ERRORS[said.about](self.usage(None), error) from error
        advice = _headers(error).get("x-should-retry")
        may_pass = advice == "true" or (advice != "false" and said.whose == "moment")
        self._unreadable += isinstance(error, UnreadableAnswerError)
        is_spent = self._made > self._retries or self._unreadable > 1
        if is_spent or not may_pass or (wish or 0) > LONGEST_WISH:
            raise ModelCallError(self.usage(None), error) from error
        pause = min(self._first_pause * 2 ** (self._made - 1), LONGEST_PAUSE) * (1 - self._jitter.random() / 4)
        return pause if wish is None else max(wish, 0.0)


def _asked(error: Exception) -> str | None:
    """The address that could not be reached, from a client's error, without parts that may be secret."""
    try:
        url = str(getattr(getattr(error, "request", None), "url", ""))
    except RuntimeError:  # httpx raises this if there is none
        url = ""
    if not url:
        return None
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"


def _wish(error: Exception) -> float | None:
    """The seconds that the server asks to wait; None if it does not say."""
    headers = _headers(error)
    for header, unit in (("retry-after-ms", 0.001), ("retry-after", 1.0)):
        try:
            seconds = float(headers[header]) * unit
        except (KeyError, ValueError):
            continue
        if not math.isnan(seconds):
            return seconds
    try:
        return parsedate_to_datetime(headers["retry-after"]).timestamp() - time.time()
    except (KeyError, ValueError, OverflowError):
        return None


def _headers(error: Exception) -> Mapping[str, Any]:
    headers = getattr(getattr(error, "response", None), "headers", None)
    return headers if isinstance(headers, Mapping) else {}
