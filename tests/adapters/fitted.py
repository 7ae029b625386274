"""What holds for an agent of every framework that plays no game, and whose prompts a context manager fits to a budget.

The test file of a framework has a class of `FittedConformance`, in which an agent of the framework reads a book.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import pytest

import smartplay_tools as sp
from tests.adapters.book import CAP, PAGES, TASK
from tests.adapters.fitted_fuzz import HOSTS, check_some
from tests.manager.fuzz import cleared
from tests.manager.histories import Messages, text_of_page
from tests.manager.judge import is_broken

DOORS = "Nothing but doors."


class Book(NamedTuple):
    """What came of reading it, in the framework's own messages."""

    sent: Sequence[Any]
    """What the model was sent, prompt by prompt."""
    stored: Sequence[Any]
    """What the framework keeps."""
    tools: Sequence[sp.ToolSpec]
    """What the model was shown."""
    system: str = ""
    """The instructions, where they are apart from the messages."""


def ask(messages: Messages, max_tokens: int) -> str:
    return DOORS


async def aask(messages: Messages, max_tokens: int) -> str:
    return DOORS


class FittedConformance:
    """The tests of a framework."""

    framework: ClassVar[str]
    """Its name in `fitted_fuzz`, which reads its messages."""
    streams: ClassVar[bool] = True

    async def read(self, manager: sp.ContextManager, *, streamed: bool = False) -> Book:
        """Have an agent read the book, whose calls have the ids `cPAGE`."""
        raise NotImplementedError

    async def read_by_sub_agent(self, manager: sp.ContextManager, chief: sp.ContextManager) -> Book:
        """Have an agent that is held by `chief` call an agent that is held by `manager` and reads the book."""
        raise NotImplementedError

    def prompts(self, book: Book) -> list[Messages]:
        """The prompts in the form of the judge: each is under its cap by a fresh count, whole, and with its task."""
        host = HOSTS[self.framework][0]()
        sent = [host.read([*each]) for each in book.sent]
        assert len(sent) == PAGES + 1
        for messages in sent:
            counted = sp.ContextManager(None, form=host.form).fit(messages, tools=book.tools, system=book.system)
            assert (counted.tokens <= CAP, counted.repaired, counted.made) == (True, [], 0)
            assert not is_broken(host.form, messages)
            assert TASK in [message.get("content") for message in messages[:2]]
        return sent

    def check(self, book: Book) -> tuple[list[Messages], Messages]:
        """The framework keeps everything. Returns the prompts and what is kept in the form of the judge."""
        sent, stored = self.prompts(book), HOSTS[self.framework][0]().read([*book.stored])
        assert len(sent[-1]) < len(stored)
        found = [(m.get("tool_call_id", m.get("call_id")), m.get("output", m.get("content"))) for m in stored]
        results = [(int(call[1:]), text) for call, text in found if call and call[1:].isdigit() and text]
        assert len(results) == PAGES + 2 * (PAGES // 7)
        assert all(text == text_of_page(page) for page, text in results)
        return sent, stored

    @pytest.mark.parametrize(("slack", "streamed"), [(0, False), (0.5, False), (0.5, True)])
    async def test_an_agent_stays_under_its_cap(self, slack, streamed):
        if streamed and not self.streams:
            pytest.skip("its agents are not streamed")
        self.check(await self.read(sp.ContextManager(CAP, slack=slack), streamed=streamed))

    async def test_sub_agents_have_managers_of_their_own(self):
        self.prompts(await self.read_by_sub_agent(sp.ContextManager(CAP), sp.ContextManager(400)))

    async def test_a_compactor_rewrites_what_is_sent_alone(self):
        sent, stored = self.check(await self.read(sp.ContextManager(CAP, strategy=cleared)))
        texts = {str(message.get("output", message.get("content"))) for message in sent[-1]}
        assert "[cleared]" in texts
        assert "[cleared]" not in str(stored)

    @pytest.mark.parametrize("asked", [ask, aask])
    async def test_a_summary_is_shown_and_not_stored(self, asked):
        manager = sp.ContextManager(CAP, strategy=sp.Summaries(60), ask=asked)
        sent, stored = self.check(await self.read(manager, streamed=asked is aask and self.streams))
        assert any(str(message.get("content")).endswith(DOORS) for message in sent[-1][:3])
        assert DOORS not in str(stored)

    async def test_prompts_of_random_conversations_have_no_fault(self):
        await check_some(self.framework)
