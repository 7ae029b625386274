"""The player of LangChain's models waits and asks again as the players of `test_model_players.py` do."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import httpx2
import openai
import pytest
from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AIMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from smartplay_langchain import LangChainPlayer

from smartplay_tools.players import ModelCallError
from tests.adapters.test_model_players import PAUSE, Busy, question

pytestmark = pytest.mark.slow


class BusyModel(BaseChatModel):
    """The same as a LangChain model: its provider's errors come through as they are."""

    server: Any

    @property
    def _llm_type(self) -> str:
        return "busy"

    def bind_tools(self, tools: Any, **kwargs: Any) -> Any:
        return self.bind(tools=tools, **kwargs)

    def _generate(self, messages: Any, stop: Any = None, run_manager: Any = None, **_: Any) -> ChatResult:
        return asyncio.run(self._agenerate(messages))

    async def _agenerate(self, messages: Any, stop: Any = None, run_manager: Any = None, **_: Any) -> ChatResult:
        question = messages[-1].content
        if await self.server.refuses(question):
            raise StatusError(self.server.status)
        usage = {"input_tokens": 7, "output_tokens": 2, "total_tokens": 9}
        return ChatResult(generations=[ChatGeneration(message=AIMessage(question, usage_metadata=usage))])


class StatusError(Exception):
    """An error like those of providers' clients."""

    def __init__(self, status: int) -> None:
        super().__init__("Busy.")
        self.status_code = status
        self.response = type("Response", (), {"headers": {"retry-after": str(PAUSE)}})()


def test_a_bug_is_not_asked_again():
    class Wrong(BusyModel):
        def _generate(self, *_: Any, **__: Any) -> ChatResult:
            raise ZeroDivisionError

    player = LangChainPlayer(Wrong(server=None))
    with pytest.raises(ZeroDivisionError):
        player.reply(question(1))


def test_a_line_that_fails_is_another_attempt_in_langchain_too():
    in_a_stream = openai.APIError("Overloaded.", request=httpx2.Request("POST", "http://localhost"), body=None)
    failures = [ConnectionResetError(), TimeoutError(), in_a_stream, json.JSONDecodeError("Expecting value", "<", 0)]
    failures.append(UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"))

    class Faulty(BusyModel):
        def _generate(self, *arguments: Any, **options: Any) -> ChatResult:
            if failures:
                raise failures.pop()
            return super()._generate(*arguments, **options)

    player = LangChainPlayer(Faulty(server=Busy(refusals=0)), pause=0.0, retries=5)
    assert player.reply(question(1)).usage.requests == 6


@pytest.mark.parametrize(("status", "attempts"), [(503, 3), (400, 1)])
def test_a_status_is_read_wherever_a_client_keeps_it(status, attempts):
    class Plain(BusyModel):
        def _generate(self, *_: Any, **__: Any) -> ChatResult:
            response = httpx2.Response(status, request=httpx2.Request("POST", "http://localhost"))
            response.raise_for_status()
            raise AssertionError

    player = LangChainPlayer(Plain(server=None), retries=2, pause=0.0)
    with pytest.raises(ModelCallError, match=f"in {attempts} attempt.*HTTPStatusError"):
        player.reply(question(1))
