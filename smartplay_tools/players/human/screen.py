"""The screen of the human player: a prompt, what the budget has left, the actions, and a line to answer on.

The lines below the prompt list the actions if they take at most half of the terminal, and else name the key that lists
them. This leaves room for the prompt in 40 columns by 12 lines.

The tokens of a prompt are charged to the episode with the reply to it, so those of the episode include them, and what
is left there is what the reply may take.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.rule import Rule
from rich.segment import Segment, Segments

from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.terminal import Console, Text
from smartplay_tools.types import Prompt
from smartplay_tools.types.messages import Message, calls_of, text_of


@dataclass(frozen=True)
class BudgetBar:
    """A fact about the budget."""

    text: str
    share: float | None = None
    """How much of the cap is used, at most 1; None without a cap."""


def budget_bars(prompt: Prompt, conversation: BaseConversation | None) -> list[BudgetBar]:
    """Return what the budget allows and how much of it is gone; empty without a conversation."""
    if conversation is None or conversation.view is None:
        return []
    budget, stats, view = conversation.episode.budget, conversation.episode.stats, conversation.view
    used = stats.tokens.prompt + stats.tokens.reply + view.tokens
    bars = [
        _budget_bar("prompt", view.tokens, budget.prompt_tokens),
        _budget_bar("episode", used, budget.episode_tokens),
    ]
    if conversation.spending is not None:
        bars.append(_budget_bar("cost", conversation.spending.with_prompt, budget.episode_cost))
    bars.append(_budget_bar("calls", stats.tool_calls, budget.tool_calls))
    # The view counts the current observation, a history counts what is behind it.
    past = max(0, view.shown_steps - 1)
    bars.append(BudgetBar(f"past steps {past}/{'all' if budget.history is None else budget.history}"))
    if prompt.max_tokens is not None:
        bars.append(BudgetBar(f"reply {prompt.max_tokens:,}"))
    return bars


def _budget_bar(name: str, used: float, cap: float | None) -> BudgetBar:
    if cap is None:
        return BudgetBar(f"{name} {used:,}")
    return BudgetBar(f"{name} {used:,.12g}/{cap:,.12g}", min(1.0, used / cap))


KEYS = "o observe, m manual, ? help, q leave"
FREE_KEYS = "? help, q leave"
"""Of the paper's protocol, which has no tools."""

STYLES = {"system": "dim", "user": "blue", "assistant": "green", "tool": "bold"}
NAMES = {"system": "system", "user": "user", "assistant": "you", "tool": "game"}

Lines = list[list[Segment]]


class Screen:
    """Draws on the alternate screen of a terminal, or prints if there is no terminal."""

    def __init__(self, console: Console, *, is_answered_by_a_terminal: bool) -> None:
        self._console = console
        self._echoed = is_answered_by_a_terminal
        self._pages = is_answered_by_a_terminal and console.is_terminal and not console.is_dumb_terminal
        self._body: Lines = []
        self._text: Lines = []
        """What is read in place of the prompt, such as the help."""
        self._footer: RenderableType = ""
        self._note = ""
        self._from_the_end = 0
        """The number of lines of the prompt below the visible part."""

    @contextmanager
    def showing(self, prompt: Prompt, actions: Sequence[str], conversation: BaseConversation | None) -> Iterator[None]:
        """Show a prompt until it has been answered."""
        body = Group(*map(_message, prompt.messages))
        self._footer = self._footer_of(prompt, actions, conversation)
        self._note, self._text, self._from_the_end = "", [], 0
        if not self._pages:
            self._console.print(Group(Rule("prompt"), body, self._footer))
            yield
            return
        self._body = self._lines(body)
        self._console.set_alt_screen(True)
        try:
            yield
        finally:
            self._console.set_alt_screen(False)

    def ask(self) -> None:
        """Draw, and leave the cursor on the input line."""
        if self._pages:
            self._draw()
        self._console.print(Text("> ", style="bold"), end="")

    def answered(self, typed: str) -> None:
        """Echo the input if no terminal did."""
        if not self._echoed:
            self._console.print(Text(typed))

    def tell(self, note: str) -> None:
        """Show a note about the input, which is not part of the prompt."""
        if self._pages:
            self._note, self._text, self._from_the_end = note, [], 0
        else:
            self._console.print(Text(note, style="yellow"))

    def read(self, text: str) -> None:
        """Show a text in place of the prompt, from its beginning, until something else is typed than u and d."""
        if self._pages:
            self._text = self._lines(Text(text, style="yellow"))
            self._from_the_end = max(0, len(self._text) - self._height())
        else:
            self._console.print(Text(text, style="yellow"))

    def page(self, *, up: bool) -> None:
        """Go a page up or down in a prompt that is taller than the screen."""
        height = self._height()
        highest = max(0, len(self._shown()) - height)
        self._from_the_end = min(highest, max(0, self._from_the_end + (height if up else -height)))

    def _draw(self) -> None:
        height = self._height()
        end = len(self._shown()) - self._from_the_end
        shown = self._shown()[max(0, end - height) : end]
        above, below = max(0, end - height), self._from_the_end
        more = f"{above} lines above (u), {below} below (d)" if above or below else ""
        self._console.clear()
        self._console.print(Segments([segment for line in shown for segment in [*line, Segment.line()]]), end="")
        self._console.print(Text(more, style="yellow"))
        self._console.print(self._below())
        self._note = ""

    def _shown(self) -> Lines:
        return self._text or self._body

    def _footer_of(
        self, prompt: Prompt, actions: Sequence[str], conversation: BaseConversation | None
    ) -> RenderableType:
        """Return the lines below the prompt, with the actions if there is room for them."""
        budget = Text(", ".join(bar.text for bar in budget_bars(prompt, conversation)), style="cyan")
        numbered = [Text(f"{number}. {name}") for number, name in enumerate(actions, start=1)]
        listed = Columns(numbered, column_first=True, padding=(0, 3))
        full = Group(Rule(style="dim"), budget, listed, Text(KEYS if prompt.tools else FREE_KEYS, style="dim"))
        if not self._pages or len(self._lines(full)) <= self._console.height // 2:
            return full
        more = Text(f"a lists the {len(actions)} actions, ? help, q leave", style="dim")
        return Group(*(Text(text.plain, text.style, no_wrap=True, overflow="ellipsis") for text in (budget, more)))

    def _height(self) -> int:
        """Lines that the footer, the line about pages and the answer leave for the prompt."""
        return max(2, self._console.height - len(self._lines(self._below())) - 2)

    def _below(self) -> RenderableType:
        return Group(self._footer, Text(self._note, style="yellow")) if self._note else self._footer

    def _lines(self, what: RenderableType) -> Lines:
        return self._console.render_lines(what, pad=False)


def _message(message: Message) -> RenderableType:
    """A message of the prompt: its role, its text and its tool calls."""
    role = message["role"]
    style = STYLES.get(role, "")
    parts: list[RenderableType] = [Text(NAMES.get(role, role), style=f"{style} underline")]
    if words := text_of(message):
        parts.append(Padding(Text(words, style=style), (0, 0, 0, 2)))
    for made in calls_of(message):
        function = made["function"]
        parts.append(Padding(Text(f"{function['name']} {function['arguments']}", style=style), (0, 0, 0, 2)))
    return Group(*parts)
