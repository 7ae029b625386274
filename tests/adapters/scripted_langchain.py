"""A LangChain chat model that says what a script says, and keeps what it was sent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from langchain_core.language_models import BaseChatModel
from langchain_core.messages import BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from smartplay_langchain import from_langchain, to_langchain

from tests.adapters.conformance import Script


class ScriptedModel(BaseChatModel):
    script: Iterator[Any]
    sent: list[Any]
    settings: list[dict[str, Any]]

    def __init__(self, script: Script) -> None:
        super().__init__(script=iter(script), sent=[], settings=[])

    @property
    def _llm_type(self) -> str:
        return "scripted"

    def bind_tools(self, tools: Any, **kwargs: Any) -> Any:
        return self.bind(tools=tools, **kwargs)

    def _generate(self, messages: list[BaseMessage], stop: Any = None, run_manager: Any = None, **kwargs: Any) -> Any:
        self.sent.append([dict(from_langchain(message)) for message in messages])
        self.settings.append(kwargs)
        (reply,) = to_langchain([next(self.script)])
        return ChatResult(generations=[ChatGeneration(message=reply)])
