"""The context manager in OpenAI's Agents SDK, for an agent that exists.

    manager = sp.ContextManager(prompt_tokens=8_000)
    agent = Agent("reader", model=ContextManagerModel(model, manager), tools=tools)

`ContextManagerModel` takes the model's place, where tools of MCP servers, handoffs and the output schema are in view
and count. What it sends is not stored: sessions and results have every item. `window_filter` is the same as a filter of
the model's input, which sees none of these and is told the tools.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from functools import cached_property
from typing import Any

from smartplay_tools.errors import extra_named

with extra_named("smartplay_openai.fitting", "agents"):
    from agents import FunctionTool, Model, ModelResponse, MultiProvider, Tool
    from agents.run import CallModelData, ModelInputData
    from openai.types.responses import ResponseCompletedEvent

from smartplay_tools import ContextManager, FittedPrompt, InvalidArgumentError, ToolSpec
from smartplay_tools.players import asks_management


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

    async def get_response(
        self,
        system_instructions: str | None,
        input: str | Sequence[Any],  # noqa: A002  # the SDK's name
        model_settings: Any,
        tools: list[Tool],
        output_schema: Any,
        handoffs: list[Any],
        tracing: Any,
        **stored: Any,
    ) -> ModelResponse:
        """Ask the model with what fits."""
        prompt = await self._fitted(system_instructions, input, tools, output_schema, handoffs, stored)
        response = await self._model.get_response(
            system_instructions, prompt.messages, model_settings, tools, output_schema, handoffs, tracing, **stored
        )
        if response.usage.input_tokens:
            managed = asks_management(vars(model_settings))
            self.manager.reported(prompt, response.usage.input_tokens, managed=managed)
        return response

    async def stream_response(
        self,
        system_instructions: str | None,
        input: str | Sequence[Any],  # noqa: A002  # the SDK's name
        model_settings: Any,
        tools: list[Tool],
        output_schema: Any,
        handoffs: list[Any],
        tracing: Any,
        **stored: Any,
    ) -> AsyncIterator[Any]:
        """Ask the model with what fits, and yield the events of its reply."""
        prompt = await self._fitted(system_instructions, input, tools, output_schema, handoffs, stored)
        async for event in self._model.stream_response(
            system_instructions, prompt.messages, model_settings, tools, output_schema, handoffs, tracing, **stored
        ):
            if isinstance(event, ResponseCompletedEvent) and event.response.usage is not None:
                managed = asks_management(vars(model_settings))
                self.manager.reported(prompt, event.response.usage.input_tokens, managed=managed)
            yield event

    async def close(self) -> None:
        """Close the model."""
        await self._model.close()

    def get_retry_advice(self, request: Any) -> Any:
        """Return the model's own advice."""
        return self._model.get_retry_advice(request)

    async def _fitted(
        self,
        instructions: str | None,
        given: str | Sequence[Any],
        tools: Sequence[Tool],
        output_schema: Any,
        handoffs: Sequence[Any],
        stored: dict[str, Any],
    ) -> FittedPrompt:
        for name, value in stored.items():
            if value is not None:
                raise InvalidArgumentError(
                    f"With `{name}` the provider adds what it keeps, which cannot be counted; leave it out."
                )
        schema = None if output_schema is None or output_schema.is_plain_text() else output_schema.json_schema()
        items = [{"role": "user", "content": given}] if isinstance(given, str) else given
        offered = [
            *map(_offered, tools),
            *(ToolSpec(h.tool_name, h.tool_description, h.input_json_schema) for h in handoffs),
        ]
        return await self.manager.afit(
            items, tools=offered, system=instructions, output_schema=schema, form="responses"
        )


def window_filter(
    manager: ContextManager, *, tools: Sequence[Tool] = (), output_schema: Any = None
) -> Callable[[CallModelData[Any]], Awaitable[ModelInputData]]:
    """Return a filter for `RunConfig.call_model_input_filter`, which is told the tools and the schema that count."""

    async def fitted(data: CallModelData[Any]) -> ModelInputData:
        given = data.model_data
        offered = [_offered(tool) for tool in tools]
        prompt = await manager.afit(
            given.input, tools=offered, system=given.instructions, output_schema=output_schema, form="responses"
        )
        return ModelInputData(prompt.messages, given.instructions)

    return fitted


def _offered(tool: Tool) -> Any:
    """A tool as it is counted: one that a provider runs is named by its type."""
    if isinstance(tool, FunctionTool):
        return ToolSpec(tool.name, tool.description, tool.params_json_schema)
    return {"type": tool.name}
