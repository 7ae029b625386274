"""The human player: a person at a terminal, under exactly the window and the budget that an agent has.

The screen shows only the prompt: what has left the window has left the screen, too. On a terminal every
prompt is drawn on the alternate screen, which cannot be scrolled back; a prompt taller than the terminal is shown in
pages. Without a terminal (piped input, a log) prompts are printed one after another.

Input that is not an action is asked for again and never sent, because the play is measured and not the typing. What a
prompt asks a person for, and the message that answers it, are the same in the browser.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, TextIO

from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.conversation.paper import CHOICE
from smartplay_tools.errors import PlayerLeftError
from smartplay_tools.players.human.screen import Screen
from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.streams import own_input
from smartplay_tools.terminal import Console
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.messages import Message, text_of

Asked = Literal["call", "action", "words"]
"""A tool call; the name of an action, in the paper's protocol; or free text: thoughts, or a summary."""


def asked_for(prompt: Prompt) -> Asked:
    """Return what a prompt asks for."""
    if prompt.purpose != "play":
        return "words"
    if prompt.tools:
        return "call"
    return "action" if text_of(prompt.messages[-1]) == CHOICE else "words"


def in_words(text: str) -> Message:
    """Return an answer in free text."""
    return {"role": "assistant", "content": text}


def named_action(typed: str, actions: Sequence[str]) -> str | None:
    """Return the action that was given as a number or a name, ignoring case and a final full stop; None for none."""
    if typed.isascii() and typed.isdigit() and 1 <= int(typed) <= len(actions):
        return actions[int(typed) - 1]
    named = {name.lower().removesuffix("."): name for name in actions}
    return named.get(typed.lower().removesuffix("."))


HELP = """\
number or name   play that action
a                list the actions
o                observe: show the current observation again
m                read the manual; it is then part of the system message
u, d             page up and down, where a text is taller than the screen
q                leave; the episode ends as closed
?                this help
Text after a # is sent with the action and stays in your window as your own words: 3 # left was a dead end"""

FREE_HELP = """\
First question: write what you think, or nothing. Second question: the number or name of an action.
a   list the actions   u, d   page up and down   q   leave; the episode ends as closed   ?   this help"""


Answer = Callable[[str, tuple[str, ...]], Message | None]
"""Makes a message from the typed text and the legal actions; returns None if that is not possible."""


class HumanPlayer:
    """Shows each prompt to a person and asks for the reply.

    Arguments:
        console: where prompts are shown; standard error by default, so that standard output has only results.
        lines: where answers are read; the standard input by default. Its end is the same as leaving.
    """

    name = "human"
    interactive = True
    """One episode at a time, in the process that owns the terminal."""

    def __init__(self, *, seed: int = 0, console: Console | None = None, lines: TextIO | None = None) -> None:
        self._lines = own_input() if lines is None else lines
        self._screen = Screen(console or Console(stderr=True), is_answered_by_a_terminal=self._lines.isatty())
        self._conversation: BaseConversation | None = None

    def attach(self, conversation: BaseConversation) -> None:
        """Keep the conversation, from which the screen reads the remaining budget."""
        self._conversation = conversation

    def reply(self, prompt: Prompt) -> Reply:
        """Show the prompt and ask until the input is valid; raise `PlayerLeftError` if the person leaves."""
        actions = Reading(prompt).actions
        with self._screen.showing(prompt, actions, self._conversation):
            asked = asked_for(prompt)
            return Reply(self._ask(ANSWERS[asked], actions, HELP if asked == "call" else FREE_HELP))

    def _ask(self, answer: Answer, actions: tuple[str, ...], instructions: str) -> Message:
        while True:
            self._screen.ask()
            line = self._lines.readline()
            typed = line.strip()
            self._screen.answered(typed)
            if not line or typed == "q":
                raise PlayerLeftError("The person at the terminal has left.")
            if typed == "?":
                self._screen.read(instructions)
            elif typed == "a":
                self._screen.read("\n".join(f"{number}. {name}" for number, name in enumerate(actions, start=1)))
            elif typed in ("u", "d"):
                self._screen.page(up=typed == "u")
            elif (message := answer(typed, actions)) is not None:
                return message
            else:
                self._screen.tell(
                    f"{typed!r} is not an action here; ? shows help." if typed else "Type an action; ? shows help."
                )


def _tool_call(typed: str, actions: tuple[str, ...]) -> Message | None:
    asked, _, words = (part.strip() for part in typed.partition("#"))
    say = words or None
    if asked in ("o", "m"):
        return call({"o": "observe", "m": "read_manual"}[asked], say=say)
    action = named_action(asked, actions)
    return None if action is None else call("act", say=say, action=action)


def _choice(typed: str, actions: tuple[str, ...]) -> Message | None:
    action = named_action(typed, actions)
    return None if action is None else in_words(action)


def _words(typed: str, actions: tuple[str, ...]) -> Message:
    return in_words(typed)


ANSWERS: dict[Asked, Answer] = {"call": _tool_call, "action": _choice, "words": _words}
