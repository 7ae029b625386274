"""The driver: feeds the recorded inputs of an episode to a new episode, which writes its own record.

The inputs are the replies of the model and the actions of the host. Everything else (texts, rewards, state hashes, the
contents of each prompt, counts) is produced again. Any difference between the two records is reported.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby, zip_longest
from typing import Any, Literal, TypeAlias

from smartplay_tools.context.compaction import GivenHistory, Room
from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.tokens import Tokenizer
from smartplay_tools.conversation.agent_session import AgentSession, Conversation
from smartplay_tools.conversation.base import CheckedReply
from smartplay_tools.conversation.paper import PaperConversation
from smartplay_tools.episode.carried import Carried
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import TranscriptError
from smartplay_tools.records.faults import ErrorLocation, record_named
from smartplay_tools.records.prompts import is_compacted
from smartplay_tools.transcript.events import Event, compares_pictures, purpose_of
from smartplay_tools.transcript.file import MemoryRecord
from smartplay_tools.types import Purpose, Reply, SampledTokens, ToolCall, ToolSpec, Usage
from smartplay_tools.types.arguments import canonical_text
from smartplay_tools.types.messages import Message
from smartplay_tools.types.pictures import Picture

Driven: TypeAlias = Conversation | AgentSession | PaperConversation

BUDGET_ENDS = ("prompt_tokens", "episode_tokens", "episode_cost", "strategy_error")
"""Reasons for which an episode ends when the next prompt is requested."""

UNSENT_ENDS = ("prompt_tokens", "episode_tokens", "episode_cost")
"""Those of these that a prompt causes which is not on record, nor, often, how a compactor has rewritten it."""

EXTERNAL_ENDS = ("player_error", "run_budget", "host", "closed")
"""End reasons from outside the game and the budgets: a replay takes them from the record, and an episode can be
continued after them in a new record."""

UNCOMPARED = frozenset(
    {("start", "versions"), ("end", "traceback")}
    | {("end", "result", name) for name in ("versions", "deviations", "error")}
)
"""Where two plays may differ: versions, what a version lists as deviations (they follow from the config, which is
compared), and the text of an exception. The chain includes them, so it is not compared either."""

LATER = frozenset(
    {("start", "scoring"), ("end", "result", "tokens", "texts"), ("call", "data", "contents")}
    | {("usage", "texts"), ("usage", "purpose")}
)
"""What records of older versions do not have."""

SHA256 = re.compile("[0-9a-f]{64}")

NOT_REPLAYED = ("resume", "exception")
"""Events about the record itself."""


class Driver:
    """A new episode, with a conversation if the record has one, to which the events of a record are fed.

    `differences` compares the new record with the one that was fed.
    """

    @record_named()
    def __init__(
        self,
        recorded: Sequence[Event],
        *,
        kind: type[Conversation] | type[AgentSession] = Conversation,
        tokenizer: str | Tokenizer | None = None,
        on_picture: Callable[[Picture], object] | None = None,
        config: EpisodeConfig | None = None,
        compactor: Literal["recorded", "called", "both"] = "recorded",
    ) -> None:
        """`on_picture` is called with every picture of a result; `config` is the record's, if it has been read.

        `compactor` says where rewritings are from: the record, the compactor, or the record while the compactor is
        called, too, so that it remembers what it did.
        """
        self.recorded = [event for event in recorded if event["event"] not in NOT_REPLAYED]
        compacted = is_compacted(recorded)
        stand_in = _NotCalled() if compacted and compactor == "recorded" else None
        self._has_rewritings = stand_in is not None
        self.record = MemoryRecord()
        """The new record."""
        config = config or EpisodeConfig.from_event(recorded[0])
        Wording.recorded(recorded[0])  # otherwise the head would seem to differ
        carried = Carried.of(recorded[0])
        self.episode = Episode.from_config(
            config, tokenizer=tokenizer, transcript=self.record, is_recorded=True, carried=carried, strategy=stand_in
        )
        self.episode.ledger.strategies.calls_compactor = stand_in is None
        self._rewritings = self.episode.ledger.strategies.recorded_rewritings
        if compactor != "called":
            self._rewritings.extend(_rewritings(self.recorded))
        names: Iterator[str] = iter(())
        if not compares_pictures(recorded[0]):
            self.episode.ledger.names_pictures_by_pixels, names = False, picture_names(self.recorded)
        self.episode.ledger.session.on_picture = _naming(names, on_picture)
        self.conversation: Driven | None = None
        self.has_host_part = False
        """Whether a host added messages or tools to a head."""
        self._kind = kind
        self._protocol = config.protocol
        self._usages: dict[tuple[int, Purpose], deque[Mapping[str, Any]]] = {}

    def run(self, *, with_end: bool = True) -> None:
        """Replay all events; `with_end` also applies a recorded end that the game did not cause.

        An inconsistent record raises a `TranscriptError` that names the event and the field.
        """
        heads = [event for event in self.recorded if event["event"] == "head"]
        with record_named() as at:
            for at.number, at.event in enumerate(self.recorded, start=1):
                if at.event["event"] == "usage" and "reply" in at.event:
                    key = at.event["turn"], purpose_of(at.event)
                    self._usages.setdefault(key, deque()).append(at.event["provider"])
            if not heads:
                self._run_calls(at)
            for at.number, at.event in enumerate(self.recorded, start=1):
                if at.event["event"] != "end" or with_end:
                    self._feed(at.event)
            if self._rewritings and self.conversation is not None:
                self.conversation.prompt()  # its view was not recorded any more

    def _feed(self, event: Event) -> None:
        conversation = self.conversation
        match event["event"]:
            case "head" if conversation is None:
                self.conversation = self._converse(event)
            case "head":
                assert isinstance(conversation, Conversation | AgentSession)
                conversation.change_head(*self._host_part(event), keeps_first_view="since" in event)
            case "reveal":
                self.episode.privileged_game()
            case "picture":
                self.episode.picture()
            case "usage" if "reply" not in event:
                self._needed().spend(Usage(**event["provider"]))  # of a reply that never came
            case "view":
                self._needed().prompt()
            case "message" if event["by"] == "player":
                self._open(event, event["message"], "play")
            case "summary":
                self._open(event, event["message"], "summary")
            case "question" if event["reply"] is not None:
                self._open(event, event["reply"], "compaction")
            case "message" if event["by"] == "host":
                assert isinstance(conversation, Conversation | AgentSession)
                conversation.add(event["message"])
            case "choice":
                assert isinstance(conversation, PaperConversation)
                conversation.settle()
            case "call" if isinstance(conversation, Conversation | AgentSession):
                edited = event["arguments"] if event.get("host") == "edited" else None
                refusal = event["refusal"] if event.get("host") == "refused" else None
                key = event.get("call_id", "")
                conversation.answer_at(event["position"], refusal=refusal, edited=edited, key=key)
            case "end":
                if not self.episode.done:
                    self._end(event["result"])
                self.episode.ledger.finish_if_over()  # the host may have left calls of the last reply open

    def _open(self, event: Event, message: Message, purpose: Purpose) -> None:
        usages = self._usages.get((event["turn"], purpose))
        usage = usages.popleft() if usages else None
        sampled = event.get("sampled")
        reply = Reply(
            message,
            None if usage is None else Usage(**usage),
            None if sampled is None else SampledTokens.from_record(sampled),
        )
        self._needed().open_turn(CheckedReply.of(reply))

    def _needed(self) -> Driven:
        if self.conversation is None:
            raise ValueError("it comes before the head of a conversation")
        return self.conversation

    def _converse(self, head: Event) -> Driven:
        if self._protocol == "paper":
            return PaperConversation(self.episode)
        messages, foreign = self._host_part(head)
        if self._kind is AgentSession:
            return AgentSession(self.episode, head=messages, foreign_tools=foreign, summaries=True, pictures=True)
        return Conversation(self.episode, head=messages, foreign_tools=foreign)

    def _host_part(self, head: Event) -> tuple[list[Message], list[ToolSpec]]:
        """The host's messages and tools in a head."""
        foreign = [ToolSpec(**tool) for tool in head["tools"][len(self.episode.tools) :]]
        messages = head["messages"][len(self.episode.head) :]
        self.has_host_part = self.has_host_part or bool(messages or foreign)
        return messages, foreign

    def _run_calls(self, at: ErrorLocation) -> None:
        """Feed a record without a conversation: the calls of a turn are a batch. What its host sent is only counted."""

        def played() -> Iterator[Event]:
            for at.number, at.event in enumerate(self.recorded, start=1):
                if at.event["event"] in ("call", "sent"):
                    yield at.event

        self.episode.begin()
        for (kind, _), group in groupby(played(), key=lambda event: (event["event"], event["turn"])):
            if kind == "call":
                self.episode.call_batch([ToolCall(e["name"], e["arguments"], e.get("call_id")) for e in group])
            else:
                self.episode.ledger.record(*map(unchained, group))

    def _end(self, result: Mapping[str, Any]) -> None:
        reason = result["end_reason"]
        is_unknown = self._has_rewritings and not self._rewritings and reason in UNSENT_ENDS
        if reason in BUDGET_ENDS and self.conversation is not None and not is_unknown:
            self.conversation.prompt()
        elif reason in EXTERNAL_ENDS or is_unknown:
            self.episode.end(reason, detail=result.get("detail"))

    def differences(self, *, to_end: bool = True) -> Iterator[str]:
        """Yield a sentence for every field in which the two records differ; without `to_end`, in what was played."""
        recorded, again = self.recorded, self.record.events
        if not to_end:
            recorded = recorded[: len(again)]
        if not recorded or recorded[-1]["event"] != "end":
            # The process died; what it wrote is compared, what the replay adds at its own end is not.
            again = again[: len(recorded)]
        for number, (was, now) in enumerate(zip_longest(recorded, again), start=1):
            if was is None or now is None:
                event = was or now
                what = "is missing in the replay" if now is None else "is new in the replay"
                yield f"Event {number} ({event['event']}) {what}."
            elif was["event"] != now["event"]:
                yield f"Event {number} is {now['event']!r} in the replay, {was['event']!r} in the record."
            else:
                turn = f", turn {was['turn']}" if "turn" in was else ""
                where = f"Event {number} ({was['event']}{turn})"
                yield from _field_differences(where, unchained(was), unchained(now), was["event"])


class _NotCalled:
    """Stands for the compactor of a record, where its rewritings are taken from the record."""

    def compact(self, history: GivenHistory, room: Room) -> Any:
        """Nobody calls it."""
        raise NotImplementedError


def _rewritings(events: Iterable[Event]) -> Iterator[tuple[bool, list[Any] | None]]:
    """Yield what a compactor did, one after the other: whether it asked a question, and the messages."""
    for event in events:
        match event["event"]:
            case "rewrite":
                yield False, event["messages"]
            case "view" if purpose_of(event) == "compaction":
                yield True, event["messages"]
            case "question" if event["reply"] is None:
                yield True, event["messages"]


def picture_names(events: Iterable[Event]) -> Iterator[str]:
    """Yield the sha256 of every picture that a result of a record shows; files have these names."""
    for event in events:
        if "picture" in event.get("data", ()):
            name = str(event["data"]["picture"]["sha256"])
            if not SHA256.fullmatch(name):
                raise TranscriptError(f"The record has a picture whose name is not a sha256: {name!r}.")
            yield name


def _naming(names: Iterator[str], on_picture: Callable[[Picture], object] | None) -> Callable[[Picture], Picture]:
    """Return a function that gives each picture the next name, as long as there are any."""

    def named(picture: Picture) -> Picture:
        picture = replace(picture, recorded_sha256=next(names, None))
        if on_picture is not None:
            on_picture(picture)
        return picture

    return named


def unchained(event: Event) -> Event:
    """Return an event without its chain."""
    return {name: value for name, value in event.items() if name != "chain"}


def _field_differences(where: str, was: Mapping[str, Any], now: Mapping[str, Any], *path: str) -> Iterator[str]:
    for key in sorted(was.keys() ^ now.keys()):
        if key in now and (*path, key) in LATER:
            continue
        yield f"{where} {key} is missing in the {'replay' if key in was else 'record'}."
    for key in sorted(was.keys() & now.keys()):
        before, after = was[key], now[key]
        if (*path, key) in UNCOMPARED:
            continue
        if isinstance(before, dict) and isinstance(after, dict):
            yield from _field_differences(f"{where} {key}:", before, after, *path, key)
        elif canonical_text(before) != canonical_text(after):
            yield f"{where} {key} is {after!r} in the replay, {before!r} in the record."
