"""ContextManager: decides what each prompt of any agent shows, never more than a cap, never what a provider refuses.

An agent keeps its messages as it does; before each request, `fit` returns what to send of them. It is a function of the
messages, the tools and the settings: whatever was asked before, the same conversation gives the same prompt. Restarts,
checkpoints, retries, branches and two threads on one manager need no care, because what a manager keeps is a cache.
docs/any-agent.md has the definition.
"""

from __future__ import annotations

import asyncio
import copy
import hashlib
import inspect
import itertools
import json
import math
import re
import threading
from collections.abc import Awaitable, Callable, Generator, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

from smartplay_tools.context.compaction import Compactor
from smartplay_tools.context.strategies.choices import Strategy
from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.context.tokens.tokenizers import Tokenizer
from smartplay_tools.errors import InvalidArgumentError, PromptOverflowError
from smartplay_tools.manager.choice import Choice, PastRules, Shown, TooLongError
from smartplay_tools.manager.counting import CUTS, Cost, MessageCounter, Tokens
from smartplay_tools.manager.fitted import Conversation, Draft, FittedPrompt, check_plain, plain, plain_messages
from smartplay_tools.manager.forms import FORMS, Given, MessageForm, form_of
from smartplay_tools.manager.memo import MemoFolder
from smartplay_tools.manager.reading import Part, Reading, kind_of
from smartplay_tools.manager.record import CHANGES, ThreadRecord, ranges
from smartplay_tools.manager.strategy import AskedStrategy, StrategyMaker, StrategyRunner
from smartplay_tools.manager.summaries import AskError, Covered, Question, Summaries, SummaryChain
from smartplay_tools.manager.tools import plain_tool, recorded_tool, specs_of
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import Budget, ResolvedBudget

__all__ = ["ContextManager"]

FormName = Literal["chat", "responses", "anthropic"]
"""The name of a form of messages."""

Ask = Callable[[list[dict[str, Any]], int], str | Awaitable[str]]
"""Asks a model: returns its answer to chat messages of words alone, in at most so many tokens."""

Fitting = Generator[Question, str, FittedPrompt]
"""Makes a prompt: yields the questions that it needs, is sent the answers, and returns it."""

IN_BUDGETS = (
    "prompt_tokens",
    "history",
    "slack",
    "result_tokens",
    "beyond_history",
    "own_words",
    "first_turns",
    "newest_pictures",
)
"""The fields of a `Budget` that have a meaning without a game."""

RECORDS = 64
"""How many records of threads a manager keeps open; a server that runs for months sees many."""

READINGS = 16
"""How many conversations a manager remembers, by their heads."""


class ContextManager:
    """Fits the messages of an agent into a budget of tokens and history.

        import smartplay_tools as sp

        manager = sp.ContextManager(prompt_tokens=8_000)
        messages = [{"role": "user", "content": "Find the fault in main.py."}]
        prompt = manager.fit(messages)
        assert prompt.messages == messages and prompt.tokens <= 8_000

    Arguments:
        prompt_tokens: the cap on every prompt, with its tools; None for no cap.
        history: how many results before the newest are shown, in steps: replies with results; None for all.
        slack: the share of the room that is freed at once when a prompt is full, so that its beginning, and with it the
            provider's cache, stays for a while. 0 shows as much as fits.
        result_tokens: the cap on one result; "auto" is a quarter of the room for units, at least 32; None for no cap.
        beyond_history: "drop" drops units older than `history`, "mask" puts a line in place of their results.
        own_words: how many steps before the newest keep the words and thoughts of their replies; None for all.
        first_turns: the number of first units that stay when later ones leave, as far as they fit.
        newest_pictures: how many pictures in results are shown, the newest ones; None for all.
        head: "task" keeps everything before the first reply, "system" the system message alone.
        pin: says of a message whether its unit stays.
        cut: which part of a long result goes: its "end" or its "middle".
        repair: whether lists that providers refuse are repaired; otherwise they are an `InvalidArgumentError`.
        tokenizer: the name of a tokenizer, or an object that counts.
        picture_tokens, sealed_tokens, extra_tokens: the tokens of pictures, of encrypted parts and of parts and tools
            that only their provider can count: a number, or a function of the part.
        form: "chat", "responses" or "anthropic"; None to see it from the messages.
        record: a folder for records, a file for each thread; None for none. `manager.record` says what is in them.
        strategy: `Summaries` to show a summary of what has left; a strategy that chooses what is shown, or a compactor
            that rewrites it, as a name, a class, an object or a function of messages and room; None for the newest.
        question_tokens: the cap on a question of a compactor, `prompt_tokens` if not given.
        ask: asks a model for `strategy`: called with chat messages and the most tokens of the answer, it returns the
            answer's text. If it is asynchronous, prompts are made by `afit`.
        memo: where answers are kept: a folder, or a mapping; a dict of this manager if not given.
        on_error: how an exception of `ask` is handled: "raise" lets it pass, "drop" goes on without a summary,
            or without the compactor, and says so in `FittedPrompt.failed`. In both cases the next prompt asks again.
    """

    def __init__(
        self,
        prompt_tokens: int | None,
        *,
        history: int | None = None,
        slack: float = 0.5,
        result_tokens: int | Literal["auto"] | None = "auto",
        beyond_history: Literal["drop", "mask"] = "drop",
        own_words: int | None = None,
        first_turns: int | None = None,
        newest_pictures: int | None = None,
        head: Literal["task", "system"] = "task",
        pin: Callable[[Given], bool] | None = None,
        cut: Literal["end", "middle"] = "end",
        repair: bool = True,
        tokenizer: str | Tokenizer | None = None,
        picture_tokens: Tokens | None = None,
        sealed_tokens: Tokens | None = None,
        extra_tokens: Tokens | None = None,
        form: FormName | None = None,
        record: str | Path | None = None,
        strategy: Summaries | Strategy | Compactor | type | Callable[..., Any] | str | None = None,
        question_tokens: int | None = None,
        ask: Ask | None = None,
        memo: MutableMapping[str, str] | str | Path | None = None,
        on_error: Literal["raise", "drop"] = "raise",
    ) -> None:
        check_numbers(prompt_tokens=prompt_tokens, result_tokens=None if result_tokens == "auto" else result_tokens)
        check_numbers(0, history=history, own_words=own_words, first_turns=first_turns, newest_pictures=newest_pictures)
        check_choice("beyond_history", beyond_history, ("drop", "mask"))
        check_choice("head", head, ("task", "system"))
        check_choice("cut", cut, CUTS)
        check_choice("form", form, (None, *FORMS))
        if not 0 <= slack <= 1:
            raise InvalidArgumentError(f"slack is a share from 0 to 1, not {slack!r}.")
        if beyond_history == "mask" and history is None:
            raise InvalidArgumentError('beyond_history="mask" masks nothing without a history; give history a number.')
        self.prompt_tokens = prompt_tokens
        masks = beyond_history == "mask"
        self._rules = PastRules(history, slack, masks, own_words, first_turns or 0, newest_pictures)
        self._result_tokens, self._head, self._repair = result_tokens, head, repair
        self._pin = pin or (lambda _: False)
        self._counter = shared_counter(tokenizer)
        self._extra = extra_tokens
        self._messages = MessageCounter(self._counter, cut, picture_tokens, sealed_tokens, extra_tokens)
        self._form = form
        self._folder = None if record is None else Path(record)
        self._records: dict[str, ThreadRecord] = {}
        self._settings = {"tokenizer": self._counter.tokenizer.name, "head": head, "cut": cut, **asdict(self._rules)}
        self._settings |= {"prompt_tokens": prompt_tokens, "result_tokens": result_tokens, "repair": repair}
        self._readings: dict[object, Reading] = {}
        self._lock = threading.Lock()
        """Held while a prompt is made, and never while a model is asked."""
        check_choice("on_error", on_error, ("raise", "drop"))
        self._ask, self._on_error = ask, on_error
        self._summaries: SummaryChain | None = None
        self._strategy: StrategyRunner | None = None
        if isinstance(strategy, Summaries):
            self._summaries = self._chain(strategy, memo)
        elif strategy is not None:
            self._strategy = self._runner(StrategyMaker(strategy), question_tokens, memo)
        elif ask is not None or memo is not None:
            raise InvalidArgumentError("Nobody asks without a strategy; give strategy=Summaries(tokens=...).")
        if question_tokens is not None and (self._strategy is None or not self._strategy.compacts):
            raise InvalidArgumentError(
                "question_tokens is the cap on questions of a compactor; give one, or leave it out."
            )

    def _runner(
        self, make: StrategyMaker, question_tokens: int | None, memo: MutableMapping[str, str] | str | Path | None
    ) -> StrategyRunner:
        """The runner of a strategy; an option that it decides itself is an `InvalidArgumentError`."""
        rules = self._rules
        decided: dict[str, object] = {"beyond_history": rules.masks, "first_turns": rules.first_turns}
        decided |= {
            "newest_pictures": rules.newest_pictures,
            "own_words": make.compacts and rules.own_words is not None,
        }
        for name, is_given in decided.items():
            if is_given:
                what = "rewrites messages" if make.compacts else "chooses the turns"
                raise InvalidArgumentError(
                    f"The strategy {make.name} {what} itself, so {name} has no meaning; leave it out."
                )
        check_numbers(question_tokens=question_tokens)
        self._settings |= {"strategy": make.name, "question_tokens": question_tokens}
        budget = ResolvedBudget(
            history=rules.history,
            slack=rules.slack,
            own_words=rules.own_words,
            prompt_tokens=self.prompt_tokens,
            question_tokens=question_tokens or self.prompt_tokens,
        )
        goes_on = self._on_error == "drop"
        return StrategyRunner(make, budget, self._counter, self._messages, kept_in(memo), goes_on=goes_on)

    def _chain(self, strategy: Summaries, memo: MutableMapping[str, str] | str | Path | None) -> SummaryChain:
        """The maker of summaries; what would never be asked, or at every step, is an `InvalidArgumentError`."""
        check_numbers(**asdict(strategy))
        rules, drops = self._rules, self._rules.history is not None and not self._rules.masks
        if not callable(self._ask):
            raise InvalidArgumentError("Summaries are asked for; give ask, a function of messages and max_tokens.")
        if self.prompt_tokens is None and not drops:
            raise InvalidArgumentError("Nothing ever leaves, so there is nothing to summarise; give prompt_tokens.")
        if rules.slack == 0 or (drops and math.floor(rules.slack * (rules.history or 0)) < 1):
            raise InvalidArgumentError("A summary would be asked for at every step; raise slack, or history.")
        self._settings |= {f"summary_{name}": number for name, number in asdict(strategy).items()}
        return SummaryChain(strategy, self.prompt_tokens, self._counter, kept_in(memo))

    @classmethod
    def of(cls, budget: Budget, **options: Any) -> ContextManager:
        """Return the manager of a budget; what only a game gives a meaning is an `InvalidArgumentError`.

        `options` are arguments that a budget does not have, such as `tokenizer` and `head`.
        """
        shared = {name: getattr(budget, name) for name in IN_BUDGETS}
        if shared["history"] == "game":
            shared["history"] = None
        if budget.summary_tokens is not None:
            options["strategy"] = Summaries(budget.summary_tokens, budget.question_tokens)
            budget = budget.model_copy(update={"summary_tokens": None, "question_tokens": None})
        if budget.strategy is not None:
            options |= {"strategy": budget.strategy, "question_tokens": budget.question_tokens}
            budget = budget.model_copy(update={"strategy": None, "question_tokens": None})
        for name, field in Budget.model_fields.items():
            if name not in IN_BUDGETS and getattr(budget, name) != field.default:
                raise InvalidArgumentError(
                    f"{name} has no meaning without a game; a context manager takes {', '.join(IN_BUDGETS)}."
                )
        return cls(**shared, **options)

    def count(self, messages: Sequence[Any], **beside: Any) -> int:
        """Return the tokens of a prompt that shows everything, whole; `beside` are the other arguments of `fit`."""
        whole = copy.copy(self)
        whole.prompt_tokens = whole._result_tokens = whole._folder = whole._summaries = whole._strategy = None
        whole._rules, whole._readings = PastRules(None, 0, False, None, 0, None), {}
        return whole.fit(messages, **beside).tokens

    def fit(
        self,
        messages: Sequence[Any],
        *,
        tools: Iterable[Any] = (),
        system: str | Sequence[Any] | None = None,
        output_schema: Any = None,
        form: FormName | None = None,
        thread: str | None = None,
    ) -> FittedPrompt:
        """Return the prompt of a conversation.

        Arguments:
            messages: all of the conversation, in one of the three forms; mappings, or the objects of a client. The list
                is not changed.
            tools: the tools that the request has, as any of the three forms writes them.
            system: the system prompt of a request to Anthropic, or the instructions of one to Responses, which are sent
                beside the messages; they count.
            output_schema: the schema of an answer's format, if the request has one; it counts.
            form: that of the messages, where it is known better than the manager knows it.
            thread: the name of the thread in the folder of records; by default, threads differ by their heads.

        Errors: a `PromptOverflowError` if what cannot be left out does not fit; an `InvalidArgumentError` for messages
        that are none, or that cannot be counted.
        """
        fitting = self._fitting(messages, tools, system, output_schema, form, thread)
        made = _next(fitting, None)
        while not isinstance(made, FittedPrompt):
            answer: Any
            ask = self._asked()
            try:
                answer = ask(*made)
            except Exception as error:  # whatever a model's client raises
                answer = error
            made = _next(fitting, answer)
        return made

    async def afit(
        self,
        messages: Sequence[Any],
        *,
        tools: Iterable[Any] = (),
        system: str | Sequence[Any] | None = None,
        output_schema: Any = None,
        form: FormName | None = None,
        thread: str | None = None,
    ) -> FittedPrompt:
        """Return what `fit` returns. An asynchronous `ask` is awaited; any other runs in a thread."""
        fitting = self._fitting(messages, tools, system, output_schema, form, thread)
        made = _next(fitting, None)
        while not isinstance(made, FittedPrompt):
            answer: Any
            ask = self._asked()
            try:
                is_async = inspect.iscoroutinefunction(ask)
                answer = ask(*made) if is_async else await asyncio.to_thread(ask, made[0], made[1])
                if inspect.isawaitable(answer):
                    answer = await answer
            except Exception as error:  # whatever a model's client raises
                answer = error
            made = _next(fitting, answer)
        return made

    def _fitting(
        self,
        messages: Sequence[Any],
        tools: Iterable[Any],
        system: str | Sequence[Any] | None,
        output_schema: Any,
        form: FormName | None,
        thread: str | None,
    ) -> Fitting:
        try:
            return (yield from self._made(messages, tools, system, output_schema, form, thread))
        except TypeError:
            check_plain(messages)  # where no message is at fault, it is an error of another kind
            raise

    def _made(
        self,
        messages: Sequence[Any],
        tools: Iterable[Any],
        system: str | Sequence[Any] | None,
        output_schema: Any,
        form: FormName | None,
        thread: str | None,
    ) -> Fitting:
        check_choice("form", form, (None, *FORMS))
        with self._lock:
            data, keys = plain_messages(messages)
            name = form or self._form
            conversation = Conversation(messages, data, keys, form_of(data) if name is None else FORMS[name])
            if system and not isinstance(system, str):
                system = [plain(part, "A part of `system`")[0] for part in system]
            beside = {"tools": [plain_tool(tool) for tool in tools], "system": system, "output_schema": output_schema}
            try:
                draft = self._draft(conversation, beside, has_summary=self._summaries is not None)
            except PromptOverflowError as error:
                if (record := self._record(conversation, thread)) is not None:
                    record.refusal(error.parts, self.prompt_tokens)
                raise
        summary, failed = (yield from self._summary(draft)) if draft.covered else (None, "")
        if draft.asked is not None:
            draft, failed = yield from self._with_choice(draft)
        with self._lock:
            if summary is None and draft.covered is not None and draft.lacks_user:
                draft = self._draft(conversation, beside, has_summary=False)
            return self._recorded(draft.prompt(conversation, summary, failed), conversation, beside, thread)

    def _summary(self, draft: Draft) -> Generator[Question, str, tuple[Shown | None, str]]:
        """Yield the questions of a summary; return it, and why there is none if nobody answered."""
        covered = draft.covered
        assert covered is not None
        assert self._summaries is not None
        try:
            text = yield from self._summaries.text(covered)
        except AskError as error:
            if self._on_error == "raise":
                raise error.reason from None
            return None, f"{type(error.reason).__name__}: {error.reason}"
        return (self._summaries.shown(text, covered.form) if text else None), ""

    def _with_choice(self, draft: Draft) -> Generator[Question, str, tuple[Draft, str]]:
        """Yield the questions of the strategy; return the prompt that it makes, and why nobody answered."""
        assert draft.asked is not None
        assert self._strategy is not None
        try:
            chosen = yield from self._strategy.chosen(draft.asked)
        except AskError as error:
            raise error.reason from None
        except TooLongError as error:
            parts = {**draft.parts, "pinned": error.pins, "newest turn": error.newest}
            raise PromptOverflowError.of(self.prompt_tokens or 0, parts) from None
        return draft.with_choice(chosen), chosen.failed

    def _asked(self) -> Callable[..., Any]:
        """The function that asks a model."""
        if not callable(self._ask):
            raise InvalidArgumentError("The strategy asks a model; give ask, a function of messages and max_tokens.")
        return self._ask

    def reported(self, prompt: FittedPrompt, tokens: int) -> None:
        """Record how many tokens the provider has counted in a prompt of this manager."""
        if prompt.recorded_as is not None:
            thread, number = prompt.recorded_as
            with self._lock:
                self._thread(thread).usage(number, tokens)

    def _draft(self, conversation: Conversation, beside: Mapping[str, Any], *, has_summary: bool) -> Draft:
        data, keys, form = conversation.data, conversation.keys, conversation.form
        schema = beside["output_schema"]
        tool_tokens = self._tool_tokens(beside["tools"]) + (self._counter.text(json.dumps(schema)) if schema else 0)
        begin = self._first_reply(data, form)
        messages_of_head, left_out = self._head_of(data[:begin], form)
        shown = [Shown(Part(n, m, self._cost(n, m, form, keys)), m) for n, m in messages_of_head]
        head_tokens = PRIMING + self._system_tokens(beside["system"]) + sum(each.tokens for each in shown)
        parts = {"tools": tool_tokens, "head": head_tokens}
        reserved = parts if self._summaries is None else {**parts, "summary": self._summaries.reserve}
        room = math.inf if self.prompt_tokens is None else self.prompt_tokens - sum(reserved.values())
        if room < 0:
            raise PromptOverflowError.of(self.prompt_tokens or 0, reserved)
        reading = self._reading(form, begin, self._most(room), keys)
        reading.read(data, keys)
        repaired = sorted({*left_out, *reading.repaired})
        if not self._repair and (repaired or reading.made):
            self._refuse(repaired, reading)
        newest = len(data) - 1 if len(data) > begin and len(data) - 1 not in repaired else None
        lacks_user = all(message.get("role") != "user" for _, message in messages_of_head)
        if self._strategy is not None:
            leading = len(
                [*itertools.takewhile(lambda each: each.message.get("role") in ("system", "developer"), shown)]
            )
            lead = [(at, each.part) for at, each in enumerate(shown)][leading:] if self._strategy.compacts else []
            asked = AskedStrategy.of(
                reading,
                newest,
                seed=self._seed(data[:begin], form, beside),
                room=None if math.isinf(room) else int(room),
                lead=lead,
                form=form,
                lacks_user=lacks_user,
            )
            head = shown[: len(shown) - len(lead)]
            return Draft(head, (), parts, repaired, len(reading.made), None, asked, lacks_user)
        needs_user = lacks_user and not has_summary
        try:
            choice = Choice.of(reading, self._rules, room, newest, form, self._messages, needs_user=needs_user)
        except TooLongError as error:
            reserved |= {"pinned": error.pins, "newest turn": error.newest}
            raise PromptOverflowError.of(self.prompt_tokens or 0, reserved) from None
        turns = [*choice.shown(reading, form, self._messages)]
        parts["pinned"] = choice.pins
        parts["turns"] = sum(each.tokens for each in turns) - choice.pins
        covered = None
        if has_summary and choice.first:
            ends = self._rules.beginnings(reading, room, choice.first)
            covered = Covered(self._seed(data[:begin], form, beside), reading.units[: choice.first], ends, form)
        return Draft(shown, turns, parts, repaired, len(reading.made), covered, None, lacks_user)

    def _seed(self, head: Sequence[Given], form: MessageForm, beside: Mapping[str, Any]) -> bytes:
        """The digest of what shapes prompts beside their units."""
        return canonical_json([self._settings, form.name, head, beside])

    def _recorded(
        self, prompt: FittedPrompt, conversation: Conversation, beside: Mapping[str, Any], thread: str | None
    ) -> FittedPrompt:
        """Write a prompt into the record of its thread, if there are records."""
        record = self._record(conversation, thread)
        if record is None:
            return prompt
        shown = [plain(message, "A message")[0] for message in prompt.messages]
        facts: dict[str, Any] = {name: ranges(getattr(prompt, name)) for name in CHANGES if getattr(prompt, name)}
        facts |= {"form": conversation.form.name, "made": prompt.made, "tokens": prompt.tokens}
        facts |= {"cap": self.prompt_tokens, "parts": dict(prompt.parts)}
        told = {**beside, "tools": [recorded_tool(tool) for tool in beside["tools"]]}
        number = record.prompt(conversation.data, shown, prompt.costs, told, facts)
        return replace(prompt, recorded_as=(record.path.stem, number))

    def _record(self, conversation: Conversation, thread: str | None) -> ThreadRecord | None:
        """The record of a thread; None where nothing is recorded."""
        if self._folder is None:
            return None
        if thread is None:
            begin = self._first_reply(conversation.data, conversation.form)
            thread = hashlib.sha256(canonical_json(conversation.data[:begin])).hexdigest()[:16]
        elif not re.fullmatch(r"[\w.-]{1,100}", thread) or thread.startswith("."):
            raise InvalidArgumentError(f"{thread!r} cannot name a thread: at most 100 letters, digits, dots, _ and -.")
        return self._thread(thread)

    def _thread(self, name: str) -> ThreadRecord:
        """The record of a thread; one that was not written for long is read again."""
        assert self._folder is not None
        record = self._records.pop(name, None) or ThreadRecord(self._folder / f"{name}.jsonl", self._settings)
        self._records[name] = record
        if len(self._records) > RECORDS:
            del self._records[next(iter(self._records))]
        return record

    def _first_reply(self, data: Sequence[Given], form: MessageForm) -> int:
        """The number of the first message after the head."""
        for number, message in enumerate(data):
            kind = kind_of(form, number, message)
            if kind == "reply":
                return number
            if self._head == "system" and (kind == "result" or message.get("role") not in ("system", "developer")):
                return number
        return len(data)

    @staticmethod
    def _head_of(data: Sequence[Given], form: MessageForm) -> tuple[list[tuple[int, Given]], list[int]]:
        """The messages of the head with their numbers, and those that lost results, since no call is before them."""
        head: list[tuple[int, Given]] = []
        changed: list[int] = []
        for number, message in enumerate(data):
            if form.kind(message) != "result":
                head.append((number, message))
                continue
            changed.append(number)
            words = form.with_results(message, [None] * len(form.results(message)))
            if words is not None:
                head.append((number, words))
        return head, changed

    def _cost(self, number: int, message: Given, form: MessageForm, keys: Sequence[object]) -> Cost:
        """The cost of a message of the head."""
        try:
            return self._messages.cost(message, form, None, keys[number])
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"Message {number} {error}.") from None

    def _system_tokens(self, system: str | Sequence[Any] | None) -> int:
        if not system:
            return 0
        return self._messages.tokens({"role": "system", "content": system}, FORMS["chat"])

    def _tool_tokens(self, tools: Iterable[Any]) -> int:
        specs, extra = specs_of(tools, self._extra)
        return self._counter.tools(specs) + extra

    def _most(self, room: float) -> int | None:
        """The cap on a result."""
        if self._result_tokens == "auto":
            return None if math.isinf(room) else max(32, int(room) // 4)
        return self._result_tokens

    def _reading(self, form: MessageForm, begin: int, most: int | None, keys: Sequence[object]) -> Reading:
        """The reading of this conversation so far; a new one if its head is not known."""
        known = form.name, begin, most, *keys[:begin]
        reading = self._readings.pop(known, None) or Reading(form, self._messages, begin, most, self._pin)
        self._readings[known] = reading
        if len(self._readings) > READINGS:
            del self._readings[next(iter(self._readings))]
        return reading

    def _refuse(self, repaired: Sequence[int], reading: Reading) -> None:
        if repaired:
            raise InvalidArgumentError(
                f"Message {repaired[0]} does not fit its neighbours: a result without its call, or apart from it. "
                "Mend the list, or let repair=True do it."
            )
        source = reading.units[reading.made[0]].parts[0].source
        raise InvalidArgumentError(
            f"A call of message {source} has no result. Mend the list, or let repair=True do it."
        )


def _next(fitting: Fitting, answer: str | Exception | None) -> Question | FittedPrompt:
    """Go on with an answer, or with what was raised in its place; return the next question, or the prompt."""
    try:
        if isinstance(answer, Exception):
            return fitting.throw(answer)
        return next(fitting) if answer is None else fitting.send(answer)
    except StopIteration as end:
        prompt: FittedPrompt = end.value
        return prompt


def kept_in(memo: MutableMapping[str, str] | str | Path | None) -> MutableMapping[str, str]:
    """Return where answers are kept."""
    if memo is not None and not isinstance(memo, str | Path | MutableMapping):
        raise InvalidArgumentError(f"A memo is a folder or a mutable mapping, not {type(memo).__name__}.")
    return MemoFolder(memo) if isinstance(memo, str | Path) else {} if memo is None else memo


def check_numbers(least: int = 1, **numbers: int | None) -> None:
    """Raise an `InvalidArgumentError` for a number that is none, or too small."""
    for name, number in numbers.items():
        if number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < least):
            raise InvalidArgumentError(f"{name} is a whole number from {least} on, or None; it is {number!r}.")


def check_choice(name: str, value: object, choices: Iterable[object]) -> None:
    """Raise an `InvalidArgumentError` for a value that is none of the choices."""
    choices = list(choices)
    if value not in choices:
        raise InvalidArgumentError(f"{name} is one of {', '.join(map(repr, choices))}; it is {value!r}.")
