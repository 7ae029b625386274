"""A person in a browser as a player: a page shows the prompt, and what the page sends is the reply.

The page gets the prompt's messages and nothing else, so what has left the window is not there. Input that is not an
answer to the prompt is refused and never played, because the play is measured and not the typing. A page may be opened
twice or be out of date, so an answer names its prompt.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.errors import InvalidArgumentError, PlayerLeftError
from smartplay_tools.players.human.player import Asked, asked_for, in_words, named_action
from smartplay_tools.players.human.screen import budget_bars
from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.arguments import as_text, number_as_text
from smartplay_tools.types.messages import Message
from smartplay_tools.types.pictures import Picture

PICTURES = "rgb_array"
"""The render mode of a game that makes pictures of itself."""


class PassedError(InvalidArgumentError):
    """An answer belongs to a prompt that has been answered already."""


class BrowserPlayer:
    """Waits in `reply` until `answer` is called from the thread of a server."""

    name = "human"
    interactive = True

    def __init__(self) -> None:
        self.changed = threading.Condition()
        """Notified when there is another prompt, an answer, or the person has left."""
        self.has_left = False
        self.number = 0
        """The number of the state that is shown: a prompt, a result or anything else."""
        self._prompt: Prompt | None = None
        self.asked: dict[str, Any] | None = None
        """The prompt that waits for an answer, as JSON for the page; None if there is none."""
        self._reply: Message | None = None
        self._conversation: BaseConversation | None = None

    def attach(self, conversation: BaseConversation) -> None:
        """Keep the conversation, from which the page reads the remaining budget."""
        self._conversation = conversation

    def reply(self, prompt: Prompt) -> Reply:
        """Show the prompt until it has been answered; raise `PlayerLeftError` if the person leaves."""
        with self.changed:
            self._prompt, self.asked, self._reply = prompt, self._as_json(prompt), None
            self.number += 1
            self.changed.notify_all()
            self.changed.wait_for(lambda: self._reply is not None or self.has_left)
            self._prompt = self.asked = None
            if self._reply is None:
                raise PlayerLeftError("The person at the browser has left.")
            return Reply(self._reply)

    def answer(self, given: Mapping[str, Any]) -> None:
        """Take the page's answer; an `InvalidArgumentError` says what is wrong with it.

        `given` has the `number` of the prompt and, by what is asked for: `tool` with `action` or `text`, and perhaps
        `say`, the words beside a call; `action`; or `text`.
        """
        with self.changed:
            prompt = self._current(given)
            self._reply = _message(prompt, given)
            self.changed.notify_all()

    def picture(self, given: Mapping[str, Any]) -> str:
        """Return the game's picture of itself as a PNG data URI; the record notes that it was shown."""
        with self.changed:
            self._current(given)
            assert self._conversation is not None
            drawn = Picture.from_array(self._conversation.episode.picture())
        return drawn.data_url

    def leave(self) -> None:
        """End the wait for an answer; the episode ends as closed, and the same run continues it later."""
        with self.changed:
            self.has_left = True
            self.changed.notify_all()

    def _current(self, given: Mapping[str, Any]) -> Prompt:
        if self._prompt is None or self._reply is not None or given.get("number") != self.number:
            raise PassedError("This prompt has been answered already.")
        return self._prompt

    def _as_json(self, prompt: Prompt) -> dict[str, Any]:
        game = None if self._conversation is None else self._conversation.episode.game
        return {
            "asks": asked_for(prompt),
            "summary": prompt.purpose != "play",
            "messages": prompt.messages,
            "tools": [tool.to_json() for tool in prompt.tools],
            "actions": Reading(prompt).actions,
            "budget_bars": [{"short": bar.text, "share": bar.share} for bar in budget_bars(prompt, self._conversation)],
            "steps": None if self._conversation is None else self._conversation.episode.stats.steps,
            "rollout": None if self._conversation is None else self._conversation.episode.spec.rollout,
            "pictures": game is not None and game.render_mode == PICTURES,
        }


def _message(prompt: Prompt, given: Mapping[str, Any]) -> Message:
    """Return the reply that the page's answer stands for."""
    asked: Asked = asked_for(prompt)
    if asked == "words":
        return in_words(_text(given, "text"))
    if asked == "action":
        return in_words(_action(prompt, given))
    tool = given.get("tool")
    if tool not in {spec.name for spec in prompt.tools}:
        raise InvalidArgumentError("This prompt asks for a call of one of its tools.")
    say = _text(given, "say").strip() if "say" in given else None
    match tool:
        case "act":
            return call("act", say=say or None, action=_action(prompt, given))
        case "take_notes":
            return call("take_notes", say=say or None, text=_text(given, "text"))
        case "observe" | "read_manual":
            return call(tool, say=say or None)
    arguments = given.get("arguments")
    if not isinstance(arguments, Mapping):
        raise InvalidArgumentError(f"The answer lacks arguments, an object, for {tool}.")
    message = call(str(tool), say=say or None)
    message["tool_calls"][0]["function"]["arguments"] = as_text(dict(arguments))
    return message


def _action(prompt: Prompt, given: Mapping[str, Any]) -> str:
    typed = {"action": number_as_text(given.get("action"))}
    action = named_action(_text(typed, "action"), Reading(prompt).actions)
    if action is None:
        raise InvalidArgumentError("That is not an action of this game; choose one from the list.")
    return action


def _text(given: Mapping[str, Any], name: str) -> str:
    value = given.get(name)
    if not isinstance(value, str):
        raise InvalidArgumentError(f"The answer lacks {name}, a text.")
    return value
