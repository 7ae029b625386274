"""resume and fork: continue an episode from its record, or begin another one with a part of it.

The record is played again on a new game, and every new event is compared with the recorded one, state hashes included.
The episode is then in its recorded state, and further events are appended to the record. Servers use this after a
restart, runs after an interruption, and the replay page to draw a game's states.

For chains of trials in a run (`Rules.carry`), `left_by` reads what a trial leaves, and `chain_fault` says whether the
next one has begun with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from smartplay_tools.context.strategies.files import FileError
from smartplay_tools.context.tokens import Tokenizer
from smartplay_tools.conversation.agent_session import AgentSession, Conversation
from smartplay_tools.episode.carried import STORES, Carried
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import SENSELESS, InvalidArgumentError, TranscriptError, in_one_line
from smartplay_tools.games.game_registry import close_game
from smartplay_tools.records.driver import EXTERNAL_ENDS, Driven, Driver, unchained
from smartplay_tools.records.record import Record
from smartplay_tools.records.replays import broken_links, read_events
from smartplay_tools.transcript.events import Event
from smartplay_tools.transcript.file import TranscriptWriter
from smartplay_tools.types import EpisodeResult


@dataclass(frozen=True)
class Resumed:
    """An episode in the state at the end of its record."""

    episode: Episode
    conversation: Driven | None
    """Its conversation; None if the record has none, because the host owns the context."""
    events: int
    """How many events of the record were played again."""

    def __enter__(self) -> Resumed:
        return self

    def __exit__(self, *error: object) -> None:
        self.episode.close()


def resume(
    source: str | Path | Sequence[Event],
    *,
    transcript: str | Path | list[Event] | None = None,
    session: bool = False,
    tokenizer: str | Tokenizer | None = None,
) -> Resumed:
    """Continue an episode from its record, a file or its events.

    Arguments:
        source: the record. New events are appended to a file, unless `transcript` is given.
        transcript: a new file, or a list, that begins with all events so far. It is required to continue an episode
            that was ended from outside (an error of the player, a cap of the run, a limit of the host, `close`).
        session: the conversation is an `AgentSession`, for a host that runs calls one by one.
        tokenizer: required if the record was counted with one that does not ship with this package: a name in a record
            opens nothing, unless the program has named the same tokenizer before.

    An episode that the game or its budgets have ended is returned in its final state. A record that was changed, or
    that plays differently here, raises a `TranscriptError`.
    """
    recorded = read_events(source)
    if broken := next(broken_links(recorded), None):
        raise TranscriptError(f"The record cannot be continued: event {broken}, or an event before it, was changed.")
    end = recorded[-1]["result"] if recorded[-1]["event"] == "end" else None
    goes_on = end is None or (transcript is not None and end["end_reason"] in EXTERNAL_ENDS)
    kind: type[Conversation] | type[AgentSession] = AgentSession if session else Conversation
    driver = Driver(recorded, kind=kind, tokenizer=tokenizer, compactor="both")
    try:
        driver.run(with_end=not goes_on)
        kept = [event for event in driver.recorded if not (goes_on and event["event"] == "end")]
        driver.recorded = kept
        if difference := next(driver.differences(), None):
            raise TranscriptError(f"The record plays differently here than it was recorded. {difference}")
        if goes_on:
            _continue_record(driver, recorded, source, transcript)
        elif end is not None:
            driver.episode.ledger.result = EpisodeResult(**end)  # unchanged, with the versions of the recording
    except BaseException:
        close_game(driver.episode.game)
        raise
    return Resumed(driver.episode, driver.conversation, len(recorded))


def fork(
    source: str | Path | Sequence[Event],
    turn: int,
    *,
    transcript: str | Path | list[Event] | None = None,
    session: bool = False,
    tokenizer: str | Tokenizer | None = None,
) -> Resumed:
    """Begin an episode with the first turns of a recorded one, for groups of rollouts and trees of them.

    The game is in the state in which that turn began, with all its randomness, so forks that reply alike play alike.
    The recorded episode is left as it is, and may be one that is still played.

    Arguments:
        source: the record, a file or its events.
        turn: how many turns are shared; the next prompt is the one of this turn, counted from 0.
        transcript: a new file, or a list, for the record of the new episode; by default it is in memory.
        session: as for `resume`.
        tokenizer: as for `resume`.

    A turn that the record does not have is an `InvalidArgumentError`.
    """
    recorded = read_events(source)
    turns = {event["turn"] for event in recorded if event["event"] in ("message", "call")}
    if not 0 <= turn <= len(turns):
        raise InvalidArgumentError(f"The record has {len(turns)} turns, so it cannot be forked at turn {turn}.")
    past = ("end", "exception")
    at = next((n for n, event in enumerate(recorded) if event["event"] in past or event.get("turn", -1) >= turn), None)
    own = [] if transcript is None else transcript
    return resume(recorded[:at], transcript=own, session=session, tokenizer=tokenizer)


def _continue_record(
    driver: Driver,
    recorded: Sequence[Event],
    source: str | Path | Sequence[Event],
    transcript: str | Path | list[Event] | None,
) -> None:
    """Make the episode write to its record again: the new events beyond the recorded ones, and all that follow."""
    episode = driver.episode
    before = [event for event in recorded if event["event"] not in ("end", "exception")]
    beyond = driver.record.events[len(driver.recorded) :]
    if transcript is None and isinstance(source, str | Path):
        writer = TranscriptWriter.resume(source, before)
    elif transcript is None:
        raise InvalidArgumentError("A list of events has no file to continue; name one with `transcript`.")
    else:
        writer = TranscriptWriter(transcript)
        writer.append(*map(unchained, before))
    writer.append({"event": "resume", "versions": episode.ledger.versions()}, *map(unchained, beyond))
    episode.ledger.writer = writer


def left_by(path: Path) -> Carried:
    """Return what the trial of a finished record leaves to the next one of its chain.

    A call that came after the end of the game was not played, so its answer is not the last result.
    """
    record = Record.read(path)
    carry, before = record.config.carry, carried_in(record)
    if carry is None:
        raise TranscriptError(f"{path} is of an episode that leaves nothing to another one.")
    played = [call for call in record.calls if call["data"].get("mistake") != "over"]
    store, words = STORES[carry], record.config.words
    try:
        held = store.after(record.calls, None if before is None else getattr(before, store.kept), words)
    except (*SENSELESS, FileError) as error:
        raise TranscriptError(f"{path} has calls with answers that are impossible: {in_one_line(error)}.") from error
    result = played[-1]["text"] if played else None
    return Carried(record=record.events[-1]["chain"], result=result, **{store.kept: held})


def carried_in(record: Record) -> Carried | None:
    """Return what the episode of a record began with."""
    return None if record.start is None else Carried.of(record.start)


def chain_fault(record: Record, before: Path | None) -> str | None:
    """Return why a record does not follow in its chain, None if it does; `before` is the record of the trial before.

    The first trial of a chain begins with nothing, and so does every trial of a run that carries nothing.
    """
    began_with = carried_in(record)
    if before is None:
        return None if began_with is None else "It has something carried, and there is no trial before it in its chain."
    if not before.exists():
        return f"The trial before it in its chain, {before.stem}, has no record."
    if began_with is None:
        return f"It has nothing carried from the trial before it in its chain, {before.stem}."
    left = left_by(before)
    if began_with.record != left.record:
        return (
            f"It was played after another record of {before.stem}, the trial before it in its chain "
            f"({began_with.record[:8]}, not {left.record[:8]})."
        )
    return None if began_with == left else f"What it has carried is not what {before.stem} left."
