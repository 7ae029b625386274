"""ContextManager: decides what each prompt of any agent shows, never more than a cap, never what a provider refuses.

An agent keeps its messages as it does; before each request, `fit` returns what to send of them. It is a function of the
messages, the tools and the settings: whatever was asked before, the same conversation gives the same prompt. Restarts,
checkpoints, retries, branches and two threads on one manager need no care, because what a manager keeps is a cache.
docs/any-agent.md has the definition.
"""

from __future__ import annotations

import copy
import inspect
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.context.tokens.tokenizers import Tokenizer
from smartplay_tools.errors import InvalidArgumentError, PromptOverflowError, check_choice
from smartplay_tools.manager.asking import Ask, Asking, Fitting, GivenStrategy, Memo
from smartplay_tools.manager.counting import CUTS, MessageCounter, Tokens
from smartplay_tools.manager.drafting import Drafts
from smartplay_tools.manager.fitted import Conversation, FittedPrompt
from smartplay_tools.manager.forms import Given, form_of
from smartplay_tools.manager.plain import PlainMessages, check_plain, plain
from smartplay_tools.manager.record import ThreadRecord
from smartplay_tools.manager.settings import FormName, Settings
from smartplay_tools.manager.summaries import Summaries
from smartplay_tools.manager.threads import ThreadRecords, recorded
from smartplay_tools.manager.tools import plain_tool
from smartplay_tools.types import Budget, ResolvedBudget


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
        strategy: GivenStrategy | None = None,
        question_tokens: int | None = None,
        ask: Ask | None = None,
        memo: Memo | None = None,
        on_error: Literal["raise", "drop"] = "raise",
    ) -> None:
        check_choice("cut", cut, CUTS)
        budget = ResolvedBudget.model_construct(
            prompt_tokens=prompt_tokens,
            history=history,
            slack=slack,
            beyond_history=beyond_history,
            own_words=own_words,
            first_turns=first_turns or None,
            newest_pictures=newest_pictures,
        )
        counter = MessageCounter(shared_counter(tokenizer), cut, picture_tokens, sealed_tokens, extra_tokens)
        self._settings = Settings(budget, counter, result_tokens, head, pin, cut, repair, form)
        self._asking = Asking(
            self._settings, strategy, ask, question_tokens=question_tokens, memo=memo, on_error=on_error
        )
        self._drafts = Drafts(self._settings, self._asking)
        folder, written = record, self._settings.recorded | self._asking.recorded
        self._threads = None if folder is None else ThreadRecords(Path(folder), written)
        self._plain = PlainMessages()
        self._lock = threading.Lock()
        """Held while a prompt is made, and never while a model is asked."""

    @property
    def prompt_tokens(self) -> int | None:
        """The cap on every prompt."""
        return self._settings.budget.prompt_tokens

    @classmethod
    def of(cls, budget: Budget, **options: Any) -> ContextManager:
        """Return the manager of a budget; what only a game gives a meaning is an `InvalidArgumentError`.

        `options` are arguments that a budget does not have, such as `tokenizer` and `head`.
        """
        names = [name for name in inspect.signature(ContextManager).parameters if name in Budget.model_fields]
        for name, field in Budget.model_fields.items():
            if name not in (*names, "summary_tokens") and getattr(budget, name) != field.default:
                raise InvalidArgumentError(
                    f"{name} has no meaning without a game; a context manager takes {', '.join(names)}."
                )
        shared = {name: getattr(budget, name) for name in names}
        if shared["history"] == "game":
            shared["history"] = None
        if budget.summary_tokens is not None:
            summaries = Summaries(budget.summary_tokens, budget.question_tokens)
            shared |= {"strategy": summaries, "question_tokens": None}
        return cls(**shared | options)

    def count(self, messages: Sequence[Any], **beside: Any) -> int:
        """Return the tokens of a prompt that shows everything, whole; `beside` are the other arguments of `fit`."""
        whole, settings = copy.copy(self), replace(self._settings, budget=ResolvedBudget(), result_tokens=None)
        whole._settings, whole._asking, whole._threads = settings, Asking(settings), None
        whole._drafts = Drafts(settings, whole._asking)
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
        beside = {"tools": tools, "system": system, "output_schema": output_schema}
        return self._asking.answered(self._fitting(messages, beside, form, thread))

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
        beside = {"tools": tools, "system": system, "output_schema": output_schema}
        return await self._asking.aanswered(self._fitting(messages, beside, form, thread))

    def _fitting(
        self, messages: Sequence[Any], beside: dict[str, Any], form: FormName | None, thread: str | None
    ) -> Fitting:
        try:
            return (yield from self._made(messages, beside, form, thread))
        except (RecursionError, TypeError):
            check_plain(messages)  # where no message is at fault, it is an error of another kind
            raise

    def _made(
        self, messages: Sequence[Any], beside: dict[str, Any], form: FormName | None, thread: str | None
    ) -> Fitting:
        asking, cap = self._asking, self.prompt_tokens
        with self._lock:
            conversation = self._read(messages, form)
            beside = {**beside, "system": _plain_system(beside["system"]), "tools": [*map(plain_tool, beside["tools"])]}
            try:
                draft = self._drafts.of(conversation, beside, has_summary=asking.summaries is not None)
            except PromptOverflowError as error:
                if (record := self._record(conversation, thread)) is not None:
                    record.refusal(error.parts, cap)
                raise
        draft = yield from asking.completed(draft)
        with self._lock:
            if draft.summary is None and draft.covered is not None and draft.lacks_user:
                draft = replace(self._drafts.of(conversation, beside, has_summary=False), failed=draft.failed)
            prompt = draft.prompt(conversation)
            record = self._record(conversation, thread)
            return prompt if record is None else recorded(record, prompt, conversation, beside, cap)

    def _read(self, messages: Sequence[Any], form: FormName | None) -> Conversation:
        """The messages of a request as plain data."""
        data, keys = self._plain.read(messages)
        return Conversation(messages, data, keys, form_of(data, form or self._settings.form))

    def _record(self, conversation: Conversation, thread: str | None) -> ThreadRecord | None:
        """The record of a conversation; None where nothing is recorded."""
        if self._threads is None:
            return None
        begin = self._drafts.first_reply(conversation.data, conversation.form) if thread is None else 0
        return self._threads.record(thread, conversation.data[:begin])

    def reported(self, prompt: FittedPrompt, tokens: int, *, managed: bool = False) -> None:
        """Record how many tokens the provider has counted in a prompt of this manager.

        `managed` says that the provider was asked to manage the context itself: it has then counted another prompt.
        """
        if prompt.recorded_as is not None and self._threads is not None:
            thread, number = prompt.recorded_as
            with self._lock:
                self._threads.record(thread).usage(number, tokens, managed=managed)


def _plain_system(system: str | Sequence[Any] | None) -> str | Sequence[Any] | None:
    """Return a system prompt as plain data."""
    if not system or isinstance(system, str):
        return system
    return [plain(part, "A part of `system`")[0] for part in system]
