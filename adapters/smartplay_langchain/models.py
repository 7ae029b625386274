"""LangChain chat models as players of this package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AnyMessage
from pydantic import SecretStr

from smartplay_langchain.asking import Asked, PromptSettings, ToolChoice, read_reply
from smartplay_tools import InvalidArgumentError, Prompt, Reply, schema
from smartplay_tools.errors import extra_named
from smartplay_tools.players import ModelPlayer, asks_management, check_key, readable_proxies
from smartplay_tools.players.cache_marks import CacheMarks, checked_marks

FAILURES = frozenset(
    {
        "APIConnectionError",
        "APIError",
        "ConnectionError",
        "HTTPError",
        "JSONDecodeError",
        "TimeoutError",
        "UnicodeDecodeError",
    }
)
"""The class names of failed requests in the clients of most providers, in Python, httpx and requests; an error in a
stream and half a body have no status."""


class LangChainPlayer(ModelPlayer):
    """The player `langchain:MODEL`: any chat model that LangChain knows.

    Arguments:
        model: a name for LangChain's `init_chat_model`, such as "openai:gpt-4o-mini", or a chat model.
        limit_field: the name of the model's parameter for the cap on a reply.
        summary_tool_choice: the model's `tool_choice` where a summary is asked for, which is written in words: "none",
            as most models spell it, or `{"type": "none"}` for `ChatAnthropic`.
        cache: for `ChatAnthropic`, mark the prompt's end and that of the part that is unchanged since the previous
            prompt, so that the provider caches them, or with "stable" only the latter; for `ChatOpenAI` at OpenAI, send
            the episode's `prompt_cache_key`, and that mark to models that cache up to marks. False sends nothing.
        pictures: whether the model sees pictures; without it, episodes whose observations are pictures are refused.
        seed, retries, pause, at_once: as for `ModelPlayer`. A model made here by its name does not retry by itself
            (`max_retries=0`, if it has that field); a model object keeps its own retries, which are not counted.
        parameters: further arguments of `init_chat_model`, such as `temperature=0`.

    LangChain's models keep their connections themselves, some of them for all models of a process: `close` leaves
    them alone, and `areply` belongs to the event loop that asked first.
    """

    def __init__(
        self,
        model: str | BaseChatModel = "",
        *,
        limit_field: str = "max_tokens",
        summary_tool_choice: ToolChoice = "none",
        cache: CacheMarks = True,
        pictures: bool = False,
        seed: int = 0,
        retries: int = 4,
        pause: float = 0.5,
        at_once: int | None = None,
        **parameters: Any,
    ) -> None:
        if not model:
            raise InvalidArgumentError("This player needs a model: langchain:MODEL.")
        name = f"langchain:{model if isinstance(model, str) else type(model).__name__}"
        super().__init__(name, seed=seed, retries=retries, pause=pause, at_once=at_once)
        self.observations = ("text", "picture", "both") if pictures else ("text",)
        with readable_proxies():
            self._model = _chat_model(model, parameters) if isinstance(model, str) else model
        self.manages_context = asks_management(parameters, vars(self._model))
        for key in _keys_of(self._model):
            check_key(key, name)
        self._settings = PromptSettings(limit_field, summary_tool_choice, checked_marks(cache))

    def request(self, prompt: Prompt) -> tuple[Asked, list[AnyMessage]]:
        """Return the model, bound to tools, cap and tool choice, and the messages for it."""
        return self._settings.request(prompt, self._model, [schema(tool, "openai") for tool in prompt.tools])

    def new_client(self) -> None:
        """LangChain's models are their own clients."""

    def new_async_client(self) -> None:
        """LangChain's models are their own clients."""

    def send(self, client: None, request: tuple[Asked, list[AnyMessage]]) -> Reply:
        """Invoke the model."""
        model, messages = request
        with readable_proxies():
            return read_reply(model.invoke(messages))

    async def asend(self, client: None, request: tuple[Asked, list[AnyMessage]]) -> Reply:
        """Invoke the model without blocking the event loop."""
        model, messages = request
        with readable_proxies():
            return read_reply(await model.ainvoke(messages))

    def check_ready(self) -> None:
        """Raise an `InvalidArgumentError` if the model's client cannot be made; Anthropic's is made when it is used."""
        with readable_proxies():
            getattr(self._model, "_client", None)

    def failed(self, error: Exception) -> bool:
        """Whether the provider refused or the connection failed: LangChain passes on the client's own errors."""
        kinds = {
            kind.__name__ for kind in type(error).__mro__
        }  # the classes come from many packages, so they are compared by name
        has_status = isinstance(getattr(error, "status_code", None), int)
        is_answer = bool(error.args) and isinstance(error.args[0], Mapping)  # an error in place of a completion
        return has_status or is_answer or not kinds.isdisjoint(FAILURES)


def _keys_of(model: BaseChatModel) -> Iterator[str]:
    """Yield the keys in a model's fields: they are secrets, or texts in a field that is called a key or a token."""
    for name, value in vars(model).items():
        if isinstance(value, SecretStr):
            yield value.get_secret_value()
        elif isinstance(value, str) and name.endswith(("api_key", "api_token", "access_token")):
            yield value


def _chat_model(name: str, parameters: dict[str, Any]) -> BaseChatModel:
    with extra_named("The player langchain:MODEL", "langchain"):
        from langchain.chat_models import init_chat_model
    model: BaseChatModel = init_chat_model(name, **parameters)
    if "max_retries" in type(model).model_fields and "max_retries" not in parameters:
        # By default the model would retry without reporting it.
        model = init_chat_model(name, max_retries=0, **parameters)
    return model
