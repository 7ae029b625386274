"""Loops of one's own keep the objects of OpenAI's and Anthropic's clients, which are fitted as their JSON."""

from __future__ import annotations

from typing import Any

import pytest
from anthropic.types import Message
from openai.types.chat import ChatCompletionMessage
from openai.types.responses import ResponseFunctionToolCall

import smartplay_tools as sp
from tests.adapters.book import CAP
from tests.adapters.test_context_endpoint import MESSAGE
from tests.manager.histories import FORMS
from tests.manager.test_fit import steps


def as_kept(message: dict[str, Any], form: str) -> Any:
    """A message as a loop keeps what its client has read."""
    if form == "responses":
        return ResponseFunctionToolCall(**message) if message.get("type") == "function_call" else message
    if message["role"] != "assistant":
        return message
    if form == "chat":
        return ChatCompletionMessage.model_validate(message)
    return {**message, "content": Message.model_validate({**MESSAGE, **message}).content}


@pytest.mark.parametrize("options", [{}, {"history": 3, "beyond_history": "mask", "own_words": 2}])
@pytest.mark.parametrize("form", FORMS)
def test_objects_of_a_client_are_fitted_as_their_json_and_kept(form: Any, options: Any):
    """Under a cap, as the conversation grows; what is not changed is the object itself."""
    managers = [sp.ContextManager(CAP, **options) for _ in range(2)]
    kept, plain = list[Any](), list[Any]()
    for message in FORMS[form](steps(60)):
        plain.append(message)
        kept.append(as_kept(message, form))
        if kept[-1] is not message or len(kept) < 2:
            continue
        prompts = [manager.fit(sent, form=form) for manager, sent in zip(managers, (kept, plain), strict=True)]
        assert prompts[0].tokens == prompts[1].tokens <= CAP
        assert len(prompts[0].messages) == len(prompts[1].messages)
        if not options:
            assert all(any(each is own for own in kept) for each in prompts[0].messages)
    assert len(prompts[0].messages) < len(kept)
