"""What every prompt of a conversation must be, computed from the replies and from the game alone.

`Model.receive` takes a reply and says what each of its calls must be answered; `Model.prompt` says what the next prompt
must be. Words that the documentation leaves open, those of errors, are taken from the results as they were given.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import smartplay_tools as sp

from .answering import IN_HEAD, Answering
from .counting import PRIMING, Counting, as_sent
from .cutting import cut
from .turns import MARKER, Item, Turn
from .window import View, Window

NUDGE = "Your reply called no tool. Call `act`, `observe` or `read_manual` to go on."
FRAME = "Your summary of what has left your view:\n"
QUESTION = (
    "The oldest turns above are about to leave your view. In at most {} tokens, write what must not be forgotten; it "
    "replaces any earlier summary. Answer in words, without a tool."
)
IDLE = 3


@dataclass
class Expected:
    """A prompt as it must be."""

    messages: list[sp.Message]
    tokens: int
    prefix_tokens: int
    prefix_messages: int
    max_tokens: int | None
    shown_steps: int
    dropped_turns: int
    purpose: str


class Model(Answering):
    """A conversation, as the documentation says that it is."""

    def __init__(self, game: sp.TextGame, seed: int, facts: Mapping[str, Any], n: Counting) -> None:
        """`facts` are what an episode has beside its game: head, tools, budget in numbers, rollout, manual, batch,
        observation, and the tokens of its picture."""
        super().__init__(game, seed, facts, n)
        self.turns: list[Turn] = []
        self.pictures = 0
        self.idle, self.stalled = 0, 0
        self.summary: str | None = None
        self.owes = False
        self.decided = 0
        self.asked: View | None = None
        self.latest: Expected | None = None
        self.last_cap: int | None = None
        asks = self.budget.summary_tokens is not None
        self.question: sp.Message = {"role": "user", "content": QUESTION.format(self.budget.summary_tokens)}
        longest = 3 + n.text("user") + n.text(FRAME) + (self.budget.summary_tokens or 0)
        self.window = Window(self.budget, n, n.message(self.question) if asks else 0, longest if asks else 0)
        self.before: list[tuple[Any, sp.Message]] = []  # the prompt to play of one turn less
        self.now = self._shown(self.window.view)

    # --- Prompts -------------------------------------------------------------

    def prompt(self) -> Expected | None:
        """Return the next prompt; None where the episode is over, with its reason in `end`."""
        if self.end is None and self.window.ends:
            self.end = "prompt_tokens"
        if self.end is None and self.window.fails:
            self.end = "strategy_error"
        if self.end is not None:
            return None
        expected = self._request() if self.owes else self._play()
        left = None
        if self.budget.episode_tokens is not None:
            left = self.budget.episode_tokens - self.totals.prompt - self.totals.reply - expected.tokens
        caps = [cap for cap in (self.budget.reply_tokens, left) if cap is not None]
        expected.max_tokens = self.last_cap = min(caps, default=None)
        if left is not None and left < (self.budget.reply_tokens or 1):
            self.end = "episode_tokens"
            return None
        if self.latest is not None:
            pairs = zip(expected.messages, self.latest.messages, strict=False)
            expected.prefix_messages = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], pairs))
        self.latest = expected
        return expected

    def _shown(self, view: View) -> list[tuple[Any, sp.Message]]:
        """The messages of a prompt with what makes each of them the same as one of another prompt."""
        shown: list[tuple[Any, sp.Message]] = [((-1, i), message) for i, message in enumerate(self.head)]
        for position, (i, oldest) in enumerate(view.turns):
            if position == view.anchors:
                shown += self._summary_message()
            shown += [((i, -1), {"role": "user", "content": words}) for at, words in view.texts if at == i]
            shown += [
                ((i, j), message) for j, message in enumerate(self.turns[i].seen(oldest, view.words, view.pictures))
            ]
        if len(view.turns) <= view.anchors:
            shown += self._summary_message()
        return shown

    def _summary_message(self) -> list[tuple[Any, sp.Message]]:
        return [] if self.summary is None else [((-2, 0), {"role": "user", "content": FRAME + self.summary})]

    def _tokens(self, shown: Sequence[tuple[Any, sp.Message]]) -> int:
        return self.n.messages(message for _, message in shown) + self.n.tools(self.tools) + PRIMING

    def _expected(
        self, shown: list[tuple[Any, sp.Message]], before: Sequence[tuple[Any, sp.Message]], first: bool
    ) -> Expected:
        same = itertools.takewhile(lambda pair: pair[0] == pair[1], zip(shown, before, strict=False))
        prefix = 0 if first else self._tokens([both[0] for both in same]) - PRIMING
        messages = [message for _, message in shown]
        return Expected(messages, self._tokens(shown), prefix, 0, None, 0, 0, "play")

    def _play(self) -> Expected:
        view = self.window.view
        shown = self.now = self._shown(view)
        expected = self._expected(shown, self.before, not self.turns)
        expected.shown_steps, expected.dropped_turns = self._steps(view), len(self.turns) - len(view.turns)
        return expected

    def _steps(self, view: View, until: int | None = None) -> int:
        """How many observations reach back, without a gap, from the newest one that a prompt shows."""
        seen: set[int] = set()
        for i, oldest in view.turns:
            if i in view.counting and (until is None or i < until):
                seen |= self.turns[i].shown(oldest, view.pictures)
        if self.budget.strategy is not None:
            return len(seen)
        return next(k for k in range(len(seen) + 1) if max(seen, default=0) - k not in seen)

    def _request(self) -> Expected:
        stays, view = self.window.leaves, self.asked
        assert stays is not None
        assert view is not None
        cut_off = [item for item in self.before if item[0][0] < stays]
        expected = self._expected([*cut_off, ((-3, 0), self.question)], self.before, False)
        kept = sum(i < stays for i, _ in view.turns)
        expected.shown_steps, expected.dropped_turns = self._steps(view, stays), len(self.turns) - 1 - kept
        expected.purpose = "summary"
        return expected

    # --- Replies -------------------------------------------------------------

    def receive(self, reply: sp.Message, given: Sequence[sp.ToolResult], foreign: Mapping[str, str]) -> list[str]:
        """Take the reply to the latest prompt, as the conversation has it; return what is wrong with its results."""
        assert self.latest is not None
        self._charge(reply, self.latest)
        if self.latest.purpose == "summary":
            self._summarise(reply)
            return []
        turn = Turn(as_sent(reply))
        calls = reply.get("tool_calls", ())
        own = [call for call in calls if call["function"]["name"] not in foreign]
        wrong = [] if len(own) == len(given) else [f"{len(given)} results for {len(own)} calls"]
        visible = set().union(*(self.turns[i].shown(oldest) for i, oldest in self.window.view.turns))
        documents = {
            step: f"Step {step}, after {call}:\n{text}"
            for step, (text, call) in sorted(self.observed.items())
            if step not in visible
        }
        results, is_new, acts = iter(given), False, 0
        for call in calls:
            name, arguments = call["function"]["name"], call["function"]["arguments"]
            if name in foreign:
                turn.items.append(Item({"role": "tool", "content": foreign[name], "tool_call_id": call["id"]}))
                continue
            result = next(results)
            acts += name == "act"
            is_refused = acts > 1 and self.facts["batch"] == "first_act"
            expected, item_date, shows, new = self._answer(turn, name, arguments, documents, is_refused)
            if (result.picture is not None) != (shows is not None and self.facts["picture"] > 0):
                wrong.append(f"{name}({arguments}) must have a picture where it shows an observation that is one")
            is_new |= new
            if expected.text is None:
                if not self._is_error(result):
                    wrong.append(f"{name}({arguments}) must be an error ({expected.kind}): {result}")
            elif (result.text, result.is_error) != (expected.text, bool(expected.kind)):
                wrong.append(f"{name}({arguments}) must be {expected!r}, not {result.text!r}")
            content: Any = result.text
            if result.picture is not None:
                picture = result.picture
                image = {"type": "image", "sha256": picture.sha256, "width": picture.width, "height": picture.height}
                content = [{"type": "text", "text": result.text}, image]
            shown = IN_HEAD if name == "read_manual" and result.data.get("manual") else content
            item = Item({"role": "tool", "content": shown, "tool_call_id": call["id"]}, item_date, shows)
            if result.picture is not None:
                item.picture, self.pictures = self.pictures, self.pictures + 1
                item.without = result.text if self.facts["observation"] == "both" else MARKER
            turn.items.append(item)
        turn.step = self.steps
        self.idle = 0 if calls else self.idle + 1
        if not calls:
            turn.items.append(Item({"role": "user", "content": NUDGE}))
            self.totals.add("idle_replies")
        if turn.plays or is_new:
            self.stalled = 0
        elif len(own) == len(calls):
            self.stalled += 1
        if self.end is None and self.idle == IDLE:
            self.end = "no_tool_call"
        if self.end is None and self.budget.stalled_turns is not None and self.stalled >= self.budget.stalled_turns:
            self.end = "stalled_turns"
        self.turns.append(turn)
        return wrong

    def add(self, message: sp.Message) -> None:
        """Take a user message that the host adds after the latest reply."""
        self.turns[-1].items.append(Item(message))

    def close_turn(self) -> None:
        """Decide the window, once everything behind a reply is there and the next prompt is asked for."""
        if self.end is not None or self.decided == len(self.turns):
            return
        self.decided = len(self.turns)
        self.before, self.asked = self.now, self.window.view
        head = self.n.messages(self.head) + self.n.tools(self.tools) + PRIMING
        summary = self.n.messages(message for _, message in self._summary_message())
        self.window.decide(self.turns, head, summary)
        self.owes = self.window.leaves is not None
        if not self.owes and not self.window.ends:
            self.now = self._shown(self.window.view)

    def _charge(self, reply: sp.Message, prompt: Expected) -> None:
        totals, tokens = self.totals, self.n.message(reply)
        totals.prompt += prompt.tokens
        totals.prefix += prompt.prefix_tokens
        totals.reply += tokens
        totals.overruns += self.last_cap is not None and tokens > self.last_cap
        if prompt.purpose == "summary":
            totals.summary_prompt += prompt.tokens
            totals.summary_reply += tokens

    def _summarise(self, reply: sp.Message) -> None:
        n, cap = self.n.text, self.budget.summary_tokens
        content = reply["content"]
        words = "".join(part["text"] for part in content) if isinstance(content, list) else content or ""
        text = cut(words, n(FRAME) + cap, n, FRAME) if words.strip() else ""
        self.totals.add("summaries")
        self.totals.add("refused_calls", len(reply.get("tool_calls", ())))
        self.totals.add("cut_summaries", text != words and bool(words.strip()))
        if text.strip():
            self.summary = text
        else:
            self.totals.add("empty_summaries")
        self.owes = False
