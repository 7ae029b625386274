"""GameSession: what a call does to the game, and what the model is told about it.

It knows the game and the caps. Locks, transports, records and prompts belong to `Episode`. It counts nothing: the
answers say what happened, and `EpisodeStats` counts them.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from smartplay_tools.context import prompts
from smartplay_tools.context.prompts.budget_line import with_budget_line
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.base import StrategyTool
from smartplay_tools.context.tokens import TokenCounter, truncation
from smartplay_tools.episode import budgets
from smartplay_tools.episode.carried import STORES, Carried, check_carry, longest_message
from smartplay_tools.episode.config import CellConfig
from smartplay_tools.episode.tools import MistakeError, ParsedCall, Tools
from smartplay_tools.games import values
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.types import EndReason, ResolvedBudget
from smartplay_tools.types.arguments import Arguments
from smartplay_tools.types.messages import Message
from smartplay_tools.types.pictures import Picture

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame


@dataclass(slots=True)
class Answer:
    """The outcome of a call."""

    text: str
    data: dict[str, Any]
    is_error: bool = False
    cut: bool = False
    """Whether the text was cut to its cap."""
    picture: Picture | None = None
    """The picture that is shown with the text."""


class GameSession:
    """A game in progress: `answer` takes a call and returns its answer. `end_reason` is set when it ends."""

    def __init__(
        self,
        spec: GameSpec,
        game: TextGame,
        config: CellConfig,
        counter: TokenCounter,
        carried: Carried | None = None,
    ) -> None:
        """`carried` is what the episode takes over from the trial before it."""
        asked, manual, context, observation = config.budget, config.manual, config.context, config.observation
        self.observation = observation
        self.spec, self.game, self.counter = spec, game, counter
        self.words = config.words
        """What the model is told, in the version of the config."""
        self.manual, self.context = manual, context
        budgets.check_strategies(asked, spec, context=context, observation=observation)
        check_carry(config, asked)
        self.strategies = Strategies(asked, counter, self.words)
        withheld = _withheld(config)
        self.tools = Tools(game, self.words, self.strategies.tools, withheld=withheld)
        self.on_picture: Callable[[Picture], Picture] | None = None
        """Called with every picture before it is shown; returns the picture under its name in the record."""
        self.steps = self.tool_calls = 0
        self.end_reason: EndReason | None = None
        self.score: float = 0
        self.completed = False
        """Score and completion as of the latest step that the game has played without an error."""
        self.game_seconds = 0.0
        self._contents: dict[str, str] = {}
        """What is needed of each step, as far as it is on record."""
        self.error: str | None = None
        self.detail: str | None = None
        self.traceback: str | None = None
        # Without a prompt cap nothing depends on the head, and the tokenizer need not be loaded for it.
        head = 0
        if asked.prompt_tokens is not None:
            head = counter.messages(prompts.head(self.words, context=context)) + counter.tools(self.tools.game_specs)
        self._picture_tokens = 0 if observation == "text" else counter.image(*game.picture_shape)
        self.budget: ResolvedBudget = budgets.resolve(asked, spec, head, self._picture_tokens)
        cap = self.budget.result_tokens
        self._cap_on_words = None if cap is None else cap - self._picture_tokens
        """The cap on the words of an observation: what its picture leaves of a result."""
        self.manual_text = self.cut(game.manual, self.budget.manual_tokens, truncation.cut_middle)
        self.manual_is_cut = self.manual_text != game.manual
        pinned = self.manual_text if manual == "pinned" else None
        self.head = prompts.head(self.words, pinned, context=context, withheld=withheld)
        self.aged_task: Message | None = None
        """The task without the first observation, where the head has it at first; None where it never has it."""
        self.cut_in_head = int(pinned is not None and self.manual_is_cut)
        """How many of the texts in the head were cut."""
        if config.first_observation == "prompt":
            first = self.cut(game.observation, cap, truncation.cut_end)
            self.cut_in_head += first != game.observation
            self.aged_task = self.head[-1]
            self.head = [self.head[0], *prompts.head(self.words, observation=first)[1:]]
        least, longest = 0, None
        if asked.prompt_tokens is not None and config.carry is not None:
            longest = longest_message(config.carry, self.budget, counter, self.words)
        if asked.prompt_tokens is not None and context == "window":
            least = counter.prompt(self.head, self.tools.specs)
            budgets.check_head(self.budget, least, self.strategies, carried=longest or 0)
        if observation != "text":
            words = counter.text(f"{self.words('picture_shown')}\n{self.words('game_is_over')}")
            budgets.check_pictures(self.budget, least, self._picture_tokens, words)
        if carried is not None and config.carry is not None:
            store = STORES[config.carry]
            if held := getattr(carried, store.kept):
                self.strategies.asked[store.field].begin(held)
            self.head = [*self.head, carried.message(counter, longest, self.words)]

    def end(self, reason: EndReason, error: BaseException | None = None, detail: str | None = None) -> None:
        """End the play, unless it has ended already."""
        if self.end_reason is None:
            self.end_reason, self.detail = reason, detail
            if error is not None:
                self.error = f"{type(error).__name__}: {error}"
                self.traceback = "".join(traceback.format_exception(error))

    def answer(self, name: str, arguments: Arguments, *, may_act: bool = True) -> Answer:
        """Answer a call; `may_act` is False where the batch policy refuses another action."""
        if self.end_reason is not None:
            return self.refuse(self.words("episode_is_over", reason=self.end_reason), "over")
        self.tool_calls += 1
        try:
            parsed = self.tools.parse(name, arguments)
        except MistakeError as mistake:
            answer = self.refuse(str(mistake), mistake.kind)
        else:
            if parsed.tool == "act" and not may_act:
                answer = self.refuse(self.words("only_first_action"))
            else:
                answer = self._play(parsed)
        self._end_if_calls_are_spent()
        return answer

    def add_budget_line(self, answer: Answer, prompt_tokens: int | None) -> None:
        """Add the line about the budget to an answer that is not the manual, which becomes part of the head."""
        if "manual" not in answer.data:
            cap, steps = self.budget.prompt_tokens, self.spec.rollout - self.steps
            answer.text = with_budget_line(answer.text, self.words, tokens=prompt_tokens, cap=cap, steps=steps)

    def answer_foreign(self, name: str, arguments: Arguments, said: str | None) -> Answer:
        """Answer a call of the host's own tool that has no result; `said` is the host's text, None for this library's.

        A call whose arguments are not an object is a mistake of the model's, whoever answers it. Any other call was
        refused by the host, or, if there is no text of the host's, its tool is no longer offered: it is then answered
        as a call of an unknown tool. Results of the host's own tools are not cut, and nor is this text.
        """
        mistake, problem = "host", arguments.problem
        if problem is None and said is None:
            return self.answer(name, arguments)
        if problem is not None:
            mistake = "malformed"
            self.tool_calls += 1
            self._end_if_calls_are_spent()
            if said is None:
                reason = self.words("bad_foreign_arguments", problem=self.words(problem.name, **problem.values))
                said = self.words("error", reason=reason)
        assert said is not None
        return Answer(said, {"step": self.steps, "mistake": mistake, "legal": False}, is_error=True)

    def _end_if_calls_are_spent(self) -> None:
        if self.tool_calls == self.budget.tool_calls:
            self.end("tool_calls")

    def refuse(self, reason: str, kind: str = "refused") -> Answer:
        """Return the answer to a call that was not played."""
        return self.say(self.words("error", reason=reason), kind)

    def say(self, text: str, kind: str) -> Answer:
        """Return a text, such as the host's, as the answer to a call that was not played; it is cut as any other."""
        answer = self._show(text, mistake=kind, legal=False)
        answer.is_error = True
        return answer

    def _play(self, call: ParsedCall) -> Answer:
        match call.tool:
            case "act":
                assert call.action is not None
                return self._act(call.action)
            case "observe":
                text, cut = self._observation()
                answer = self._show_observation(text)
                answer.cut = answer.cut or cut
                return answer
            case "read_manual" if self.manual == "tool":
                return Answer(self.manual_text, {"step": self.steps, "manual": True}, cut=self.manual_is_cut)
            case "read_manual":
                return self._show(self.words("manual_is_above" if self.manual == "pinned" else "no_manual"))
        return self._use(self.tools.added[call.tool], call.text if call.values is None else call.values)

    def _use(self, tool: StrategyTool, given: str | Mapping[str, Any]) -> Answer:
        """Answer a call of a strategy's tool."""
        answer = tool.answer(given)
        if answer.mistake is not None:
            return self.refuse(answer.text, answer.mistake)
        if answer.is_cut is not None:
            return Answer(answer.text, {"step": self.steps, **answer.data}, cut=answer.is_cut)
        return self._show(answer.text, **answer.data)

    def _act(self, action: int) -> Answer:
        began = time.perf_counter()
        try:
            declared = self._declared(action)
            text, reward, terminated, truncated = self.game.advance(action)
            self.game_seconds += time.perf_counter() - began
            data: dict[str, Any] = {"reward": reward, "score": self.game.score, "legal": True, **declared}
            over = terminated or truncated or self.steps + 1 >= self.spec.rollout
            if over or (self.steps + 1) % self.game.hash_every == 0 or self.tool_calls == self.budget.tool_calls:
                data["state_hash"] = self.game.state_hash()
        except Exception as error:
            # An engine that breaks ends this episode, on the record, and no other.
            self.end("game_error", error)
            return self.refuse(self.words("game_has_failed"), "game_error")
        self.steps += 1
        self.note_score()
        if over:
            self.end("terminated" if terminated else "rollout")
        return self._show_observation(text, data, self.words("game_is_over") if over else "")

    def note_score(self) -> None:
        """Keep the game's score and completion, which may be anything once it has failed."""
        self.score, self.completed = self.game.score, self.game.completed

    def last_facts(self) -> dict[str, Any]:
        """What the game says of itself at the end; a game that fails at that has failed."""
        facts: dict[str, Any] = {"state_hash": "", "deviations": {}}
        try:
            facts["deviations"] = values.facts("`deviations`", self.game.deviations(), self.steps)
            if self.end_reason != "game_error":  # it may not be able to compute its state hash
                facts["state_hash"] = self.game.state_hash()
        except Exception as error:
            self.end_reason = None
            self.end("game_error", error)
        return facts

    def _declared(self, action: int) -> dict[str, Any]:
        """What the game declares about the action that comes next, for the record: `needs` and `breaks`.

        `contents` are those of needs that no earlier action has on record.
        """
        declared: dict[str, Any] = {}
        for name, numbers in (("needs", self.game.needs), ("breaks", self.game.breaks)):
            if numbers is not None:
                declared[name] = values.whole_numbers(f"`{name}`", numbers, self.steps)
            if isinstance(numbers, Mapping) and name == "needs":
                contents = values.contents("`needs`", numbers, self.steps)
                if new := dict(contents.items() - self._contents.items()):
                    declared["contents"] = {step: new[step] for step in contents if step in new}
                self._contents |= new
        return {"action": action, **declared} if declared else {}

    def _observation(self) -> tuple[str, bool]:
        """The current observation and whether it was cut; where the host owns the context, with the history."""
        current = self.game.observation
        history = self.game.recent() if self.context == "host" and self.observation != "picture" else ""
        if not history:
            return current, False
        whole, cap = f"{history}\n\n{current}", self._cap_on_words
        if cap is None or self.counter.text(whole) <= cap:
            return whole, False
        steps = self.steps if self.budget.history is None else min(self.steps, self.budget.history)
        return truncation.cut_history(self.game.recent, steps, current, cap, self.counter.text, self.words.cut), True

    def _show_observation(
        self, text: str, facts: Mapping[str, Any] = MappingProxyType({}), last_line: str = ""
    ) -> Answer:
        """Return the answer with the current observation: in words, as a picture, or both; a picture is never cut.

        `facts` are further data of the answer.
        """
        shown = self.words("picture_shown") if self.observation == "picture" else text
        shown = f"{shown}\n{last_line}" if last_line else shown
        words = self.cut(shown, self._cap_on_words, self._cut_observation)
        data = {"step": self.steps, "observation_step": self.steps, **facts}
        if self.observation == "text":
            return Answer(words, data, cut=words != shown)
        picture = self.game.picture() if self.on_picture is None else self.on_picture(self.game.picture())
        return Answer(words, {**data, "picture": picture.facts}, cut=words != shown, picture=picture)

    def _cut_observation(self, text: str, cap: int, count: truncation.Count, notice: truncation.Notice) -> str:
        """Return the words of an observation that are over their cap: their beginning, or the first page of them."""
        shortening, results = self.strategies.shortening, self.budget.result_tokens
        if shortening is None or results is None:
            return truncation.cut_end(text, cap, count, notice)
        page: str = shortening.shorten(text, cap, results)
        return page

    def _show(self, text: str, **data: Any) -> Answer:
        shown = self.cut(text, self.budget.result_tokens, truncation.cut_end)
        return Answer(shown, {"step": self.steps, **data}, cut=shown != text)

    def cut(self, text: str, cap: int | None, cut: truncation.Cut) -> str:
        """Return a text that is over its cap shortened by `cut`, with a notice; any other as it is."""
        if cap is None or self.counter.text(text) <= cap:
            return text
        return cut(text, cap, self.counter.text, self.words.cut)


def _withheld(config: CellConfig) -> frozenset[str]:
    """The tools that are not offered, since they could say nothing new.

    Every prompt of a window shows the current observation, unless a strategy of a user's decides that.
    """
    if config.offered_tools == "all":
        return frozenset()
    shows_all = config.first_observation == "prompt" and config.budget.strategy is None
    useless = {"read_manual": config.manual != "tool", "observe": shows_all}
    return frozenset(name for name, says_nothing in useless.items() if says_nothing)
