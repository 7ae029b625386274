"""Trimmers of other projects for the cap audit: their own code, with the settings of their documentation.

Each takes messages of chat completions and a cap, turns the messages into its own form, trims, and turns them back. A
name ends with what counts: `exact` is the counter that judges, `tokenizer` the tokenizer alone where a trimmer takes no
more than that, `own` what it does by itself. Where a framework sends the system message beside the history, the cap is
less the tokens of that message.

Importing this needs the packages of `experiments/cap-audit/requirements.txt`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
from collections.abc import Callable
from importlib import resources
from types import SimpleNamespace
from typing import Any

# The vocabularies of tiktoken that a package brings: nothing is downloaded.
os.environ["TIKTOKEN_CACHE_DIR"] = str(resources.files("llama_index.core") / "_static" / "tiktoken_cache")
os.environ["CUSTOM_TIKTOKEN_CACHE_DIR"] = os.environ["TIKTOKEN_CACHE_DIR"]
os.environ["LITELLM_LOCAL_MODEL_COST_MAP"] = "True"

import ag2.events as ag2_events
import agent_framework as maf
import agentfit
import chatfit
import contexttrim
import convopack
import ctx_compact
import litellm
import tokentrim
from ag2.middleware import TokenLimiter
from agent_framework._compaction import apply_compaction
from autogen_core import FunctionCall, models as autogen
from autogen_core.model_context import TokenLimitedChatCompletionContext
from autogen_ext.models.openai import OpenAIChatCompletionClient
from cap_audit_histories import Messages, calls, count, message_tokens, prompt_tokens
from convopack.providers.openai import from_openai, to_openai
from haystack import dataclasses as haystack
from haystack.components.agents.state import State
from haystack.hooks.compaction import CompactionHook, SlidingWindowCompactor
from haystack.token_counters import ApproximateTokenCounter
from inspect_ai import model as inspect
from langchain.agents.middleware import ClearToolUsesEdit
from langchain_core.messages import convert_to_messages, convert_to_openai_messages, trim_messages as langchain_trim
from langchain_core.messages.utils import count_tokens_approximately
from llama_index.core.base.llms.types import ChatMessage as LlamaMessage
from llama_index.core.memory import ChatMemoryBuffer
from pydantic_ai import Agent, messages as pydantic
from pydantic_ai.models.function import FunctionModel
from pydantic_ai_harness.compaction import SlidingWindowCompaction

Trimmer = Callable[[Messages, int], Messages]

LOOP = asyncio.new_event_loop()
wait = LOOP.run_until_complete

logging.disable(logging.WARNING)


def a_call(identity: str, name: str, arguments: Any) -> dict[str, Any]:
    """A call of chat completions."""
    written = arguments if isinstance(arguments, str) else json.dumps(arguments, ensure_ascii=False)
    return {"id": identity, "type": "function", "function": {"name": name, "arguments": written}}


def reply(content: str | None, calls: list[dict[str, Any]]) -> dict[str, Any]:
    """A reply of chat completions."""
    return {"role": "assistant", "content": content or ""} | ({"tool_calls": calls} if calls else {})


def result(identity: str, content: str) -> dict[str, Any]:
    """A result of chat completions."""
    return {"role": "tool", "tool_call_id": identity, "content": content}


# The forms of messages of the frameworks.


def to_framework(message: dict[str, Any]) -> Any:
    """A message of Microsoft's Agent Framework."""
    if message["role"] == "tool":
        contents = [maf.Content.from_function_result(message["tool_call_id"], result=message["content"])]
        return maf.Message("tool", contents)
    contents = [maf.Content.from_text(message["content"])]
    contents += [maf.Content.from_function_call(i, name, arguments=said) for i, name, said in calls(message)]
    return maf.Message(message["role"], contents)


def of_framework(message: Any) -> dict[str, Any]:
    """A message of Microsoft's Agent Framework in chat form."""
    text = "".join(each.text for each in message.contents if each.type == "text")
    for each in message.contents:
        if each.type == "function_result":
            return result(each.call_id, each.result)
    made = [a_call(e.call_id, e.name, e.arguments) for e in message.contents if e.type == "function_call"]
    return reply(text, made) if str(message.role) == "assistant" else {"role": str(message.role), "content": text}


def to_autogen(message: dict[str, Any]) -> Any:
    """A message of AutoGen."""
    text = message["content"]
    match message["role"]:
        case "tool":
            found = autogen.FunctionExecutionResult(content=text, name="tool", call_id=message["tool_call_id"])
            return autogen.FunctionExecutionResultMessage(content=[found])
        case "assistant":
            made = [FunctionCall(id=i, name=name, arguments=said) for i, name, said in calls(message)]
            said = {"content": made, "thought": text} if made else {"content": text}
            return autogen.AssistantMessage(**said, source="agent")
        case "user":
            return autogen.UserMessage(content=text, source="user")
    return autogen.SystemMessage(content=text)


def of_autogen(message: Any) -> Messages:
    """A message of AutoGen in chat form."""
    if isinstance(message, autogen.FunctionExecutionResultMessage):
        return [result(each.call_id, each.content) for each in message.content]
    if isinstance(message, autogen.AssistantMessage):
        if isinstance(message.content, str):
            return [reply(message.content, [])]
        return [reply(message.thought, [a_call(each.id, each.name, each.arguments) for each in message.content])]
    return [{"role": "user" if isinstance(message, autogen.UserMessage) else "system", "content": message.content}]


def to_pydantic(messages: Messages) -> list[Any]:
    """A history of Pydantic AI, in which results of one reply are one request."""
    found: list[Any] = []
    for message in messages:
        text = message["content"]
        if message["role"] == "assistant":
            made = [pydantic.ToolCallPart(name, said, i) for i, name, said in calls(message)]
            found.append(pydantic.ModelResponse([pydantic.TextPart(text), *made]))
            continue
        part: Any = pydantic.UserPromptPart(text)
        if message["role"] == "system":
            part = pydantic.SystemPromptPart(text)
        if message["role"] == "tool":
            part = pydantic.ToolReturnPart("tool", text, message["tool_call_id"])
        if found and isinstance(found[-1], pydantic.ModelRequest):
            found[-1].parts = [*found[-1].parts, part]
        else:
            found.append(pydantic.ModelRequest([part]))
    return found


def of_pydantic(message: Any) -> Messages:
    """A message of Pydantic AI in chat form."""
    if isinstance(message, pydantic.ModelResponse):
        made = [a_call(e.tool_call_id, e.tool_name, e.args) for e in message.parts if e.part_kind == "tool-call"]
        return [reply("".join(e.content for e in message.parts if e.part_kind == "text"), made)]
    roles = {"system-prompt": "system", "user-prompt": "user"}
    return [
        result(part.tool_call_id, part.content)
        if part.part_kind == "tool-return"
        else {"role": roles[part.part_kind], "content": part.content}
        for part in message.parts
    ]


def to_ag2(messages: Messages) -> list[Any]:
    """A history of AG2, in which results of one reply are one event."""
    found: list[Any] = []
    for message in messages:
        text = message["content"]
        if message["role"] == "tool":
            if not isinstance(found[-1], ag2_events.ToolResultsEvent):
                found.append(ag2_events.ToolResultsEvent([]))
            content = ag2_events.ToolResult(text)
            found[-1].results.append(ag2_events.ToolResultEvent(parent_id=message["tool_call_id"], result=content))
        elif message["role"] == "assistant":
            made = [ag2_events.ToolCallEvent(id=i, name=name, arguments=said) for i, name, said in calls(message)]
            said = ag2_events.ModelMessage(text)
            found.append(ag2_events.ModelResponse(said, tool_calls=ag2_events.ToolCallsEvent(made)))
        else:
            found.append(ag2_events.ModelRequest.ensure_request([text]))
    return found


def of_ag2(event: Any) -> Messages:
    """An event of AG2 in chat form."""
    if isinstance(event, ag2_events.ToolResultsEvent):
        return [result(each.parent_id, each.result.parts[0].content) for each in event.results]
    if isinstance(event, ag2_events.ModelResponse):
        made = [a_call(each.id, each.name, each.arguments) for each in event.tool_calls.calls]
        return [reply(event.message.content if event.message else "", made)]
    return [{"role": "user", "content": event.parts[0].content}]


# The trimmers.


def langchain_exact(messages: Any) -> int:
    """The judge's count of messages of LangChain."""
    return prompt_tokens(convert_to_openai_messages(messages))


def langchain(token_counter: Any, **settings: Any) -> Trimmer:
    """`trim_messages` of LangChain."""

    def trim(messages: Messages, cap: int) -> Messages:
        options = {"strategy": "last", "include_system": True, "token_counter": token_counter, **settings}
        return convert_to_openai_messages(langchain_trim(convert_to_messages(messages), max_tokens=cap, **options))

    return trim


def clear_tool_uses(token_counter: Any) -> Trimmer:
    """What `ContextEditingMiddleware` does before each request of an agent of LangChain."""

    def trim(messages: Messages, cap: int) -> Messages:
        given = convert_to_messages(messages)
        ClearToolUsesEdit(trigger=cap).apply(given, count_tokens=token_counter)
        return convert_to_openai_messages(given)

    return trim


def llama_index(tokenizer: Any) -> Trimmer:
    """`ChatMemoryBuffer` of LlamaIndex, which the system message stands beside."""

    def trim(messages: Messages, cap: int) -> Messages:
        kept = [LlamaMessage(role=m["role"], content=m["content"], additional_kwargs=m) for m in messages[1:]]
        memory = ChatMemoryBuffer.from_defaults(kept, token_limit=cap, tokenizer_fn=tokenizer)
        shown = memory.get(initial_token_count=count(messages[0]["content"]))
        return [messages[0], *(message.additional_kwargs for message in shown)]

    return trim


class ExactClient(OpenAIChatCompletionClient):  # type: ignore[misc]
    """AutoGen's client with the judge's counter."""

    def count_tokens(self, messages: Any, *, tools: Any = ()) -> int:
        """Count as the judge does."""
        return prompt_tokens([one for message in messages for one in of_autogen(message)])


def autogen_limit(client: Any) -> Trimmer:
    """`TokenLimitedChatCompletionContext` of AutoGen, which the system message stands beside."""
    made = client(model="gpt-4o", api_key="none")

    def trim(messages: Messages, cap: int) -> Messages:
        given = list(map(to_autogen, messages[1:]))
        limit = cap - message_tokens(messages[0])
        context = TokenLimitedChatCompletionContext(made, token_limit=limit, initial_messages=given)
        shown = wait(context.get_messages())
        return [messages[0], *(one for message in shown for one in of_autogen(message))]

    return trim


def ag2_limit(messages: Messages, cap: int) -> Messages:
    """`TokenLimiter` of AG2, which the system message stands beside."""
    shown: list[Any] = []

    async def send(events: Any, _: Any) -> Any:
        shown.extend(events)

    events = to_ag2(messages[1:])
    limiter = TokenLimiter(cap - message_tokens(messages[0]))(events[0], SimpleNamespace())  # type: ignore[arg-type]
    wait(limiter.on_llm_call(send, events, SimpleNamespace()))  # type: ignore[arg-type]
    return [messages[0], *(one for event in shown for one in of_ag2(event))]


def agent_framework(tokenizer: Any) -> Trimmer:
    """`TokenBudgetComposedStrategy` of Microsoft's Agent Framework."""

    def trim(messages: Messages, cap: int) -> Messages:
        tiers = [maf.ToolResultCompactionStrategy(keep_last_tool_call_groups=1)]
        tiers.append(maf.SlidingWindowStrategy(keep_last_groups=20))
        strategy = maf.TokenBudgetComposedStrategy(token_budget=cap, tokenizer=tokenizer, strategies=tiers)
        shown = apply_compaction(list(map(to_framework, messages)), strategy=strategy, tokenizer=tokenizer)
        return list(map(of_framework, wait(shown)))

    return trim


def pydantic_harness(tokenizer: Any) -> Trimmer:
    """An agent of Pydantic AI with the harness's `SlidingWindowCompaction`, whose model says what it was sent."""

    def trim(messages: Messages, cap: int) -> Messages:
        shown: list[Any] = []

        def answer(sent: Any, _: Any) -> Any:
            shown.extend(sent)
            return pydantic.ModelResponse([pydantic.TextPart("done")])

        window = SlidingWindowCompaction(max_tokens=cap, keep_tokens=cap // 2, tokenizer=tokenizer)
        wait(Agent(FunctionModel(answer), capabilities=[window]).run(message_history=to_pydantic(messages)))
        return [one for message in shown for one in of_pydantic(message)]

    return trim


def inspect_trim(exact: bool) -> Trimmer:
    """Inspect's compaction with `CompactionTrim`, which is asked before every request of a history, as in an agent."""
    model = inspect.get_model("mockllm/model", memoize=False)
    if exact:

        async def count_tokens(given: Any, config: Any = None) -> int:
            return count(given) if isinstance(given, str) else prompt_tokens(await inspect.messages_to_openai(given))

        model.api.count_tokens = count_tokens  # type: ignore[method-assign]

    def trim(messages: Messages, cap: int) -> Messages:
        given = wait(inspect.messages_from_openai(messages))
        handler = inspect.compaction(inspect.CompactionTrim(threshold=cap), given[:2], model=model)
        for number in range(2, len(given)):
            if given[number].role == "assistant":
                with contextlib.suppress(RuntimeError):  # it says that it cannot go below the cap
                    wait(handler.compact_input(given[:number]))
        return wait(inspect.messages_to_openai(wait(handler.compact_input(given))[0]))

    return trim


class ExactCounter:
    """The judge's counter as Haystack takes it."""

    def count(self, messages: Any, tools: Any = None) -> int:
        """Count as the judge does."""
        return prompt_tokens([message.to_openai_dict_format() for message in messages]) - 3


def haystack_window(counter: Any) -> Trimmer:
    """`CompactionHook` of Haystack with `SlidingWindowCompactor`; the window of the model is the cap."""

    def trim(messages: Messages, cap: int) -> Messages:
        state = State({}, {"messages": list(map(haystack.ChatMessage.from_openai_dict_format, messages))})
        CompactionHook(SlidingWindowCompactor(), context_window=cap, token_counter=counter).run(state)
        return [message.to_openai_dict_format() for message in state.data["messages"]]

    return trim


class PackerCounter:
    """The judge's counter as convopack takes it."""

    name = "judge"

    def count(self, text: str) -> int:
        """Count a text."""
        return count(text)

    def count_message(self, message: Any) -> int:
        """Count a message as the judge does."""
        return message_tokens(to_openai([message])[0])

    def count_messages(self, messages: Any) -> int:
        """Count a prompt as the judge does."""
        return prompt_tokens(to_openai(messages))


def packer(tokenizer: Any) -> Trimmer:
    """convopack, as its first example has it."""

    def trim(messages: Messages, cap: int) -> Messages:
        made = convopack.Packer(
            budget=cap, tokenizer=tokenizer, strategy=convopack.Recency(), pin=["system", "first_user"]
        )
        return to_openai(made.pack(from_openai(messages)).kept)

    return trim


def contexttrim_window(counter: Any, priming: int) -> Trimmer:
    """contexttrim, as its first example has it."""

    def trim(messages: Messages, cap: int) -> Messages:
        strategy = contexttrim.strategies.ImportanceWeighted()
        made = contexttrim.ContextManager(cap - priming, strategy, token_counter=counter)
        return made.extend(messages).fit()

    return trim


def fit_agent(**counting: Any) -> Trimmer:
    """agentfit, as its first example has it."""
    return lambda messages, cap: agentfit.fit(messages, max_tokens=cap, preserve_last_n=2, **counting).messages


def trim_tokens(messages: Messages, cap: int) -> Messages:
    """tokentrim, which takes the system message apart."""
    return tokentrim.trim(messages[1:], "gpt-4o", system_message=messages[0]["content"], max_tokens=cap)


HUMAN = {"start_on": "human", "end_on": ("human", "tool")}

TRIMMERS: dict[tuple[str, str, str], Trimmer] = {
    ("langchain-core", "trim_messages, from a human", "exact"): langchain(langchain_exact, **HUMAN),
    ("langchain-core", "trim_messages, from a human", "own"): langchain(count_tokens_approximately, **HUMAN),
    ("langchain-core", "trim_messages, from anywhere", "exact"): langchain(langchain_exact),
    ("langchain-core", "trim_messages, from anywhere", "own"): langchain(count_tokens_approximately),
    ("langchain", "ClearToolUsesEdit", "exact"): clear_tool_uses(langchain_exact),
    ("langchain", "ClearToolUsesEdit", "own"): clear_tool_uses(count_tokens_approximately),
    ("llama-index-core", "ChatMemoryBuffer", "own"): llama_index(None),
    ("autogen-core", "TokenLimited...Context", "exact"): autogen_limit(ExactClient),
    ("autogen-core", "TokenLimited...Context", "own"): autogen_limit(OpenAIChatCompletionClient),
    ("ag2", "TokenLimiter", "own"): ag2_limit,
    ("agent-framework-core", "TokenBudgetComposedStrategy", "tokenizer"): agent_framework(
        SimpleNamespace(count_tokens=count)
    ),
    ("agent-framework-core", "TokenBudgetComposedStrategy", "own"): agent_framework(maf.CharacterEstimatorTokenizer()),
    ("pydantic-ai-harness", "SlidingWindowCompaction", "tokenizer"): pydantic_harness(count),
    ("pydantic-ai-harness", "SlidingWindowCompaction", "own"): pydantic_harness(None),
    ("inspect-ai", "CompactionTrim", "exact"): inspect_trim(exact=True),
    ("inspect-ai", "CompactionTrim", "own"): inspect_trim(exact=False),
    ("haystack-ai", "SlidingWindowCompactor", "exact"): haystack_window(ExactCounter()),
    ("haystack-ai", "SlidingWindowCompactor", "own"): haystack_window(ApproximateTokenCounter()),
    ("litellm", "trim_messages", "own"): lambda messages, cap: litellm.utils.trim_messages(
        messages, "gpt-4o", max_tokens=cap
    ),
    ("convopack", "Recency", "exact"): packer(PackerCounter()),
    ("convopack", "Recency", "own"): packer("tiktoken:gpt-4o"),
    ("ctx-compact", "compact", "exact"): lambda messages, cap: (
        ctx_compact.compact(messages, max_tokens=cap - 3, count_tokens=message_tokens).messages
    ),
    ("ctx-compact", "compact", "own"): lambda messages, cap: ctx_compact.compact(messages, max_tokens=cap).messages,
    ("contexttrim", "ImportanceWeighted", "exact"): contexttrim_window(message_tokens, 3),
    ("contexttrim", "ImportanceWeighted", "own"): contexttrim_window(None, 0),
    ("agentfit-py", "fit", "tokenizer"): fit_agent(tokenizer=count),
    ("agentfit-py", "fit", "own"): fit_agent(model="gpt-4o"),
    ("chatfit", "fit", "own"): lambda messages, cap: chatfit.fit(messages, cap, model="gpt-4o").messages,
    ("tokentrim", "trim", "own"): trim_tokens,
}
"""The trimmers by package, name and what counts."""
