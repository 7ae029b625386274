"""The ledger of an episode: its record, its counts, its answers to calls, and its end.

`Episode` has the methods for agents and harnesses. The `Ledger` has the methods for conversations, and for the readers
of records that play an episode again: they record events, have calls answered one by one, and complete turns. The
ledger belongs to this package; its members are not part of the public interface.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from smartplay_tools.context.strategies.custom import versions_of
from smartplay_tools.episode.carried import Carried
from smartplay_tools.episode.config import EpisodeConfig, ProtocolName, deviations, differs
from smartplay_tools.episode.game_session import GameSession
from smartplay_tools.episode.stats import EpisodeStats, versions
from smartplay_tools.games.specs import GAMES
from smartplay_tools.games.values import text
from smartplay_tools.threads import SerialQueue
from smartplay_tools.transcript.events import FORMAT, Event
from smartplay_tools.transcript.file import TranscriptWriter
from smartplay_tools.types import EndReason, EpisodeResult, ToolResult
from smartplay_tools.types.arguments import Arguments, meaning

Listener = Callable[[Event], None]
"""Called with each event of one episode, in the thread that records it; it can change nothing."""


class Ledger:
    """What happened in an episode so far: its events, its counts, and its result once it is over."""

    def __init__(
        self, config: EpisodeConfig, session: GameSession, writer: TranscriptWriter | None, carried: Carried | None
    ) -> None:
        self.config, self.session, self.game, self.carried = config, session, session.game, carried
        self.strategies = session.strategies
        """The strategies for the past that the budget asks for."""
        self.writer = writer
        """Writes the transcript; None without one. A continued record gets another."""
        self.player_versions: Mapping[str, str] = {}
        """What the player says of the programs and files that decide its replies."""
        self.listeners: Sequence[Listener] = ()
        self.stats = EpisodeStats()
        self.result: EpisodeResult | None = None
        self.if_closed: tuple[EndReason, Exception | None, str | None] | None = None
        self.lock = threading.RLock()
        self.queue = SerialQueue()
        """Runs the calls of asynchronous callers one after the other."""
        self.at_end: Callable[[], None] | None = None
        """Called once the episode has its result."""
        self.on_view: Callable[[int, int], None] | None = None
        """Called with the tokens of a new prompt and of its longest reply, before it is sent; may end the episode."""
        self.is_privileged = self.has_shown_pictures = False
        self.names_pictures_by_pixels = config.observation != "text"
        """Whether the record says so, which those do not that were written before pictures had these names."""
        self._answered: dict[str, tuple[tuple[str, str], ToolResult]] = {}
        """The calls and answers of all idempotency keys: copies of a call may come as long as the episode lives."""
        self._begun = self._step_is_unrecorded = False

    @property
    def done(self) -> bool:
        """Whether the episode is over."""
        return self.session.end_reason is not None

    @property
    def is_recording(self) -> bool:
        """Whether events are written: to a transcript, or to listeners."""
        return self.writer is not None or bool(self.listeners)

    def begin(self, *, player: str | None = None, protocol: ProtocolName = "tools") -> None:
        """Write the record's first event. The first call sets player and protocol, unless the config has them."""
        if self._begun:
            return
        self._begun = True
        update = {"player": self.config.player or player, "protocol": protocol}
        self.config = self.config.model_copy(update=update)
        start: Event = {
            "event": "start",
            "format": FORMAT,
            "config": self.config.to_json(),
            "budget": self.session.budget.model_dump(),
            "cut_results": self.session.cut_in_head,
            "versions": self.versions(),
        }
        if self.names_pictures_by_pixels:
            start["pictures"] = "pixels"
        if self.session.spec.id not in GAMES.benchmark:
            start["scoring"] = self.session.spec.scoring()
        if self.carried is not None:
            start["carried"] = self.carried.model_dump(exclude_none=True)
        self.record(start)

    def answer(
        self,
        turn: int,
        position: int,
        name: str,
        arguments: Arguments,
        *,
        may_act: bool = True,
        key: str = "",
        host: Literal["edited", "refused"] | None = None,
        refusal: str | None = None,
        is_foreign: bool = False,
        prompt_tokens: int | None = None,
    ) -> ToolResult:
        """Answer one call of a turn and record it; `complete_turn` follows the last one.

        `host` says what the host did to the call: changed its arguments, or refused it with the text `refusal`.
        `is_foreign` says that the call is one of the host's own tools, which did not run. `key` is the transport's
        idempotency key (`recall`). `prompt_tokens` counts the prompt that the call answers, if this library made it.
        """
        with self.lock:
            self._step_is_unrecorded = True
            was_over = self.done
            if is_foreign and not was_over:
                answer = self.session.answer_foreign(name, arguments, refusal)
            elif refusal is not None and not was_over:
                answer = self.session.say(refusal, "host")
            else:
                answer = self.session.answer(name, arguments, may_act=may_act)
                if self.config.budget_line == "on" and not self.done:
                    self.session.add_budget_line(answer, prompt_tokens)
            result = ToolResult(answer.text, answer.is_error, self.done, answer.data, answer.picture)
            event = self._call_event(turn, position, name, arguments, result, cut=answer.cut)
            if host is not None:
                event["host"] = host
            if refusal is not None:
                event["refusal"] = refusal
            if key:
                event["call_id"] = key  # a transport's keys outlive this process
            self.record(event)
            self._step_is_unrecorded = False
            if key and not was_over:  # afterwards every call has the same answer, and hosts may go on calling
                self.remember(key, name, arguments, result)
            return result

    def recall(self, key: str, name: str, arguments: Arguments) -> ToolResult | None:
        """Return the recorded answer to a call whose key was seen before."""
        if not key or key not in self._answered:
            return None
        asked, result = self._answered[key]
        if asked == (name, meaning(arguments)):
            return replace(result, data={**result.data, "replayed": True})
        answer = self.session.refuse(self.session.words("call_id_was_used"))
        return ToolResult(answer.text, True, self.done, answer.data)

    def remember(self, key: str, name: str, arguments: Arguments, result: ToolResult) -> None:
        """Keep an answer for the copies of a call that come with its key."""
        self._answered[key] = ((name, meaning(arguments)), result)

    def record(self, *events: Mapping[str, Any]) -> None:
        """Write events, and count them. After the end nothing is recorded."""
        if self.result is None:
            self.write(*events)
            for event in events:
                self.stats.apply(event)

    def write(self, *events: Mapping[str, Any]) -> None:
        """Write events to the transcript, if there is one, and tell the listeners. A view is written, not counted."""
        if self.writer is not None:
            self.writer.append(*events)
        for listener in self.listeners:
            for event in events:
                listener(dict(event))

    def complete_turn(self) -> None:
        """End the episode if too many turns in a row showed nothing new; called after each turn."""
        cap = self.session.budget.stalled_turns
        if cap is not None and self.stats.stalled >= cap:
            self.session.end("stalled_turns")
        self.finish_if_over()

    def finish_if_over(self) -> None:
        """Create the result and end the record, if the episode is over."""
        session = self.session
        if session.end_reason is None or self.result is not None:
            return
        game, spec, facts = self.game, session.spec, session.last_facts()
        result = EpisodeResult(
            game=spec.id,
            engine=game.engine,
            seed=self.config.seed,
            score=session.score,
            normalized_score=spec.normalize(session.score) if game.comparable else None,
            completed=session.completed,
            end_reason=session.end_reason,
            error=session.error,
            detail=session.detail,
            state_hash=facts["state_hash"],
            context=self.config.context,
            deviations={**self._deviations(), **facts["deviations"]},
            versions=self.versions(),
            **self.stats.counts(),
        )
        try:
            # If a step was interrupted before it was recorded, the record does not lead to this result.
            if not self._step_is_unrecorded:
                self.record({"event": "end", "result": result.model_dump(), "traceback": self.session.traceback})
        finally:
            self.result = result
            if self.at_end is not None:
                self.at_end()

    def versions(self) -> dict[str, str]:
        """Return the versions of the programs that can change how this episode runs, is counted or is played."""
        custom = versions_of(self.strategies.custom)
        of_game = self.game.versions().items()
        named = {text("`versions`", name, 0): text("`versions`", version, 0) for name, version in of_game}
        return {**versions(), **custom, **named, **self.player_versions}

    def _call_event(
        self, turn: int, position: int, name: str, arguments: Arguments, result: ToolResult, *, cut: bool
    ) -> Event:
        return {
            "event": "call",
            "turn": turn,
            "position": position,
            "name": name,
            "arguments": arguments.text,
            "text": result.text,
            "is_error": result.is_error,
            "done": result.done,
            "data": result.data,
            "cut": cut,
        }

    def _deviations(self) -> dict[str, Any]:
        configured = deviations(self.config, self.session.spec, self.session.budget, is_privileged=self.is_privileged)
        pictures = {"pictures": differs("none", "shown when asked for")} if self.has_shown_pictures else {}
        form = self.player_versions.get("format")
        return {**configured, **pictures, **({} if form is None else {"format": differs(None, form)})}
