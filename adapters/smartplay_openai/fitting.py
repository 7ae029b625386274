"""The context manager in OpenAI's Agents SDK, for an agent that exists.

    manager = sp.ContextManager(prompt_tokens=8_000)
    agent = Agent("reader", model=ContextManagerModel(model, manager), tools=tools)

`ContextManagerModel` takes the model's place, where tools of MCP servers, handoffs and the output schema are in view
and count. What it sends is not stored: sessions and results have every item. `window_filter` is the same as a filter of
the model's input, which sees none of these and is told the tools.
"""

from __future__ import annotations

import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

from smartplay_tools.errors import extra_named

with extra_named("smartplay_openai.fitting", "agents"):
    from agents import FunctionTool, Model, ModelResponse, MultiProvider, Tool
    from agents.run import CallModelData, ModelInputData
    from openai.types.responses import ResponseCompletedEvent

from smartplay_tools import ContextManager, FittedPrompt, InvalidArgumentError, ToolSpec
from smartplay_tools.players import asks_management

SIGNATURE = inspect.signature(Model.get_response)
STORED = [name for name, each in SIGNATURE.parameters.items() if each.kind is each.KEYWORD_ONLY]
"""Parts of a request that stand for what the provider keeps: all that the SDK passes by name alone."""


class ContextManagerModel(Model):
    """Sends another model what a context manager shows of the input.

    Arguments:
        model: a model of the SDK, or its name.
        manager: the budget.
    """

    def __init__(self, model: Model | str, manager: ContextManager) -> None:
        self._given = model
        self.manager = manager

    @cached_property
    def _model(self) -> Model:
        """The model; one that is named needs its key when it is first asked."""
        return MultiProvider().get_model(self._given) if isinstance(self._given, str) else self._given

    async def get_response(self, *given: Any, **named: Any) -> ModelResponse:
        """Ask the model with what fits."""
        prompt, request = await self._fitted(given, named)
        response = await self._model.get_response(*request.args[1:], **request.kwargs)
        self._report(prompt, request, response.usage.input_tokens)
        return response

    async def stream_response(self, *given: Any, **named: Any) -> AsyncIterator[Any]:
        """Ask the model with what fits, and yield the events of its reply."""
        prompt, request = await self._fitted(given, named)
        async for event in self._model.stream_response(*request.args[1:], **request.kwargs):
            if isinstance(event, ResponseCompletedEvent) and event.response.usage is not None:
                self._report(prompt, request, event.response.usage.input_tokens)
            yield event

    async def close(self) -> None:
        """Close the model."""
        await self._model.close()

    def get_retry_advice(self, request: Any) -> Any:
        """Return the model's own advice."""
        return self._model.get_retry_advice(request)

    async def _fitted(self, given: Sequence[Any], named: dict[str, Any]) -> tuple[FittedPrompt, inspect.BoundArguments]:
        """Return the prompt of a request, and the request with it, bound to the names that the SDK has."""
        bound = SIGNATURE.bind_partial(self, *given, **named)
        request = bound.arguments
        refuse_stored(request)
        said, schema, instructions = request["input"], request["output_schema"], request["system_instructions"]
        prompt = await self.manager.afit(
            [{"role": "user", "content": said}] if isinstance(said, str) else said,
            tools=offered(request["tools"], request["handoffs"]),
            system=instructions,
            output_schema=None if schema is None or schema.is_plain_text() else schema.json_schema(),
            form="responses",
        )
        request["input"] = prompt.messages
        return prompt, bound

    def _report(self, prompt: FittedPrompt, request: inspect.BoundArguments, tokens: int) -> None:
        if tokens:
            managed = asks_management(vars(request.arguments["model_settings"]))
            self.manager.reported(prompt, tokens, managed=managed)


def window_filter(
    manager: ContextManager, *, tools: Sequence[Tool] = (), output_schema: Any = None
) -> Callable[[CallModelData[Any]], Awaitable[ModelInputData]]:
    """Return a filter for `RunConfig.call_model_input_filter`, which is told the tools and the schema that count."""

    async def fitted(data: CallModelData[Any]) -> ModelInputData:
        given = data.model_data
        prompt = await manager.afit(
            given.input,
            tools=offered(tools),
            system=given.instructions,
            output_schema=output_schema,
            form="responses",
        )
        return ModelInputData(prompt.messages, given.instructions)

    return fitted


def offered(tools: Sequence[Tool], handoffs: Sequence[Any] = ()) -> list[Any]:
    """Return tools and handoffs as they are counted: a tool that a provider runs is named by its type."""
    specs: list[Any] = [
        ToolSpec(tool.name, tool.description, tool.params_json_schema)
        if isinstance(tool, FunctionTool)
        else {"type": tool.name}
        for tool in tools
    ]
    return [*specs, *(ToolSpec(h.tool_name, h.tool_description, h.input_json_schema) for h in handoffs)]


def refuse_stored(request: Mapping[str, Any]) -> None:
    """Raise an `InvalidArgumentError` for a request that names what the provider keeps."""
    for name in STORED:
        if request.get(name) is not None:
            raise InvalidArgumentError(
                f"With `{name}` the provider adds what it keeps, which cannot be counted; leave it out."
            )
