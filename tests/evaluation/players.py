"""Players for runs that go wrong: worker processes import them by name."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import smartplay_tools as sp


def act(action: str, say: str | None = None) -> sp.Message:
    return sp.call("act", say=say, action=action)


class FirstMoves:
    """Plays the slot machine's first arm; `before` runs at every prompt."""

    name = "first moves"

    def __init__(self, *, seed: int, **options: Any) -> None:
        self.seed, self.options = seed, options

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        self.before(prompt)
        return sp.Reply(act("1"), self.usage(prompt))

    def before(self, prompt: sp.Prompt) -> None: ...

    def usage(self, prompt: sp.Prompt) -> sp.Usage | None:
        return None


class Broken(FirstMoves):
    """Raises an error at every prompt."""

    def before(self, prompt: sp.Prompt) -> None:
        raise RuntimeError("no more ideas")


class BrokenOnce(FirstMoves):
    """Raises an error at the first prompt of an episode's first attempt, which a file in `marks` records."""

    def before(self, prompt: sp.Prompt) -> None:
        mark = Path(self.options["marks"]) / str(self.seed)
        if not mark.exists():
            mark.touch()
            raise RuntimeError("stumbled")


class Killer(FirstMoves):
    """Kills its process in every episode whose seed is the option `victim`."""

    def before(self, prompt: sp.Prompt) -> None:
        if self.seed == self.options["victim"]:
            os._exit(9)


class Slow(FirstMoves):
    """Waits before every reply."""

    def before(self, prompt: sp.Prompt) -> None:
        time.sleep(self.options.get("seconds", 0.01))


class Metered(FirstMoves):
    """Reports a usage as a provider would: half as much again as we count, the half of it cached."""

    def usage(self, prompt: sp.Prompt) -> sp.Usage | None:
        return sp.Usage(prompt=self.options.get("prompt", 1000), reply=100, cached=500)


class Uncounted(FirstMoves):
    """Reports its requests without any tokens, as what asks a server without usage does."""

    def usage(self, prompt: sp.Prompt) -> sp.Usage | None:
        return sp.Usage()


class Waiting:
    """An asynchronous player, which fails if the event loop is blocked."""

    name = "waiting"
    at_once = most_at_once = 0

    def __init__(self, *, seed: int, **options: Any) -> None: ...

    async def areply(self, prompt: sp.Prompt) -> sp.Reply:
        import asyncio

        kind = type(self)
        kind.at_once += 1
        kind.most_at_once = max(kind.most_at_once, kind.at_once)
        await asyncio.sleep(0.01)
        kind.at_once -= 1
        return sp.Reply(act("1"))


class Connected(Waiting):
    """Serves many episodes through one connection, which fails at the very first prompt."""

    serves_many = True
    opened = closed = 0

    def __init__(self, *, seed: int, **options: Any) -> None:
        self.open = False

    async def __aenter__(self) -> Connected:
        type(self).opened += 1
        self.open = True
        return self

    async def __aexit__(self, *error: object) -> None:
        type(self).closed += 1
        self.open = False

    async def areply(self, prompt: sp.Prompt) -> sp.Reply:
        assert self.open
        if type(self).opened == 1:
            raise RuntimeError("the line broke")
        return await super().areply(prompt)


class Leaver(FirstMoves):
    """Exits the program."""

    def before(self, prompt: sp.Prompt) -> None:
        raise SystemExit(0)


class Wordy(FirstMoves):
    """Replies with a thousand words to every prompt."""

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        return sp.Reply({**act("1"), "content": "so " * 1000})


class Moody(FirstMoves):
    """Plays the arm that a file names."""

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        return sp.Reply(act(Path(self.options["mood"]).read_text()))
