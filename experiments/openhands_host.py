"""The agent of the OpenHands SDK as a host of `experiments/hosts.py`, with the condenser of its package.

The SDK needs Python 3.12, and is imported only where its host is played: an environment of its own (`docs/hosts.md`).
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Sequence
from typing import Any, Self

from openhands.sdk import LLM, Agent, Conversation, Tool
from openhands.sdk.context.condenser import LLMSummarizingCondenser
from openhands.sdk.tool import Action, Observation, ToolDefinition, ToolExecutor, register_tool
from pydantic import SecretStr

for name in ("openhands", "uvicorn", "uvicorn.access"):  # its SDK has every logger print
    logging.getLogger(name).setLevel(logging.ERROR)


class Look(Action):
    """A call without arguments."""


class Act(Action):
    """A call of `act`."""

    action: str


class Seen(Observation):
    """What a tool of the game has answered."""


class Executor(ToolExecutor[Any, Seen]):
    """Calls a function of the game."""

    def __init__(self, function: Callable[..., str]) -> None:
        self._function = function

    def __call__(self, action: Any, conversation: Any = None) -> Seen:
        """Return what the function says."""
        return Seen.from_text(text=self._function(*action.model_dump(include={"action"}).values()))


class _GameTool(ToolDefinition[Any, Seen]):
    @classmethod
    def create(cls, *_: object, **__: object) -> Sequence[Self]:
        raise NotImplementedError("An instance is registered for every episode.")


class ObserveTool(_GameTool):
    """Looks at the game."""


class ActTool(_GameTool):
    """Plays an action."""


class ReadManualTool(_GameTool):
    """Reads the game's manual."""


KINDS: Sequence[tuple[type[_GameTool], type[Action]]] = ((ObserveTool, Look), (ActTool, Act), (ReadManualTool, Look))


def play(
    tools: Sequence[Callable[..., str]], instructions: str, task: str, model: str, base_url: str, cap: int
) -> None:
    """Play one episode with the agent, whose `LLMSummarizingCondenser` begins at `cap` tokens, by its own count."""
    for (kind, action), function in zip(KINDS, tools, strict=True):
        described = {"description": str(function.__doc__), "action_type": action, "observation_type": Seen}
        register_tool(function.__name__, kind(executor=Executor(function), **described))
    llm = LLM(model=f"openai/{model}", base_url=base_url, api_key=SecretStr("none"), num_retries=0)
    agent = Agent(
        llm=llm,
        tools=[Tool(name=function.__name__) for function in tools],
        include_default_tools=[],
        system_prompt=instructions,
        condenser=LLMSummarizingCondenser(llm=llm, max_tokens=cap),
    )
    with tempfile.TemporaryDirectory() as workspace:
        conversation = Conversation(
            agent=agent, workspace=workspace, max_iteration_per_run=100_000, visualizer=None, stuck_detection=False
        )
        conversation.send_message(task)
        conversation.run()
