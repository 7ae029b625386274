"""An attempt: one planned episode, played from its seed to its end, in any process or on any machine.

It always leaves a record: of the whole episode, of an episode that failed, that was stopped between two turns or that
was paused by a cap, or, if there was no episode yet, the exception. The record alone determines the outcome of the
attempt. The return value has times, and why the episode began again, which are not part of a result.
"""

from __future__ import annotations

import asyncio
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from smartplay_tools.context.strategies.custom import load_strategy
from smartplay_tools.conversation.agent_session import AgentSession, Conversation
from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.conversation.loop import AnyConversation, aplay, new_conversation, play, player_versions
from smartplay_tools.conversation.paper import PaperConversation
from smartplay_tools.episode.carried import Carried
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import SmartPlayError, TranscriptError, place_of
from smartplay_tools.evaluation.runs.agents import Agent, Held
from smartplay_tools.evaluation.runs.limits import Account, RunLimits
from smartplay_tools.evaluation.runs.plan import PlannedEpisode, check_playable, player_of
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.run_progress import StopFlag
from smartplay_tools.files.full_disk import DiskFullError, is_disk_full
from smartplay_tools.files.times import delete_record
from smartplay_tools.games.seeds import player_seed
from smartplay_tools.games.specs import load_game
from smartplay_tools.players import ModelPlayer, get_player, player_registry
from smartplay_tools.players.opening import aenter_player, enter_player
from smartplay_tools.players.player_registry import second_player, without_second
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.records.record import UNANSWERED, Record
from smartplay_tools.records.replays import recorded_pictures
from smartplay_tools.records.resumption import resume
from smartplay_tools.transcript.events import Event
from smartplay_tools.transcript.file import append_exception, read_transcript
from smartplay_tools.types import AsyncPlayer, Player, Prompt
from smartplay_tools.types.messages import assistant_message

Opened = TypeVar("Opened", bound="AnyConversation | Held | None")


OnRecord = Callable[[], None]


@dataclass(frozen=True)
class Task:
    """The input of an attempt. It is plain data, because it is sent to other processes."""

    planned: PlannedEpisode
    player: PlayerConfig
    record: Path
    """The file that it writes."""
    previous: Path | None = None
    """The record of an earlier attempt, from which the episode is continued if possible."""
    price: Price | None = None
    question_price: Price | None = None
    """The price of the player that answers a compactor's questions."""
    carried: Carried | None = None
    """What the episode takes over from the trial before it in its chain."""
    game_file: Path | None = None
    """The file of the game of its cell; None if that is not in a file."""
    strategy_file: Path | None = None
    """The file of the custom strategy of its cell; None if that is not in a file."""


@dataclass(frozen=True)
class Times:
    """The times of an attempt: elapsed seconds, processor seconds in the game, and in all of this thread."""

    seconds: float
    game_seconds: float
    processor_seconds: float
    began_again: str | None = None
    """Why the episode did not continue from the record of an earlier attempt; None if there was none, or it did."""
    after_the_end: str | None = None
    """What was raised after the episode had ended: a note, since the record has the result; None for nothing."""


class StoppedError(Exception):
    """The run is stopping: the episode ends between two turns."""


def make_player(task: Task) -> Player | AsyncPlayer:
    """Return a new player for an attempt."""
    cell, seed = task.planned.cell, player_seed(task.planned.seed, task.planned.repeat)
    options = {**without_second(cell.player_options), **task.player.secret_values()}
    if task.player.factory is not None:
        player: Player | AsyncPlayer = player_registry.make_player(task.player.factory, seed=seed, **options)
        return player
    return get_player(player_of(cell), seed=seed, **options)


class Players(NamedTuple):
    """The player of an attempt, and the one that answers a compactor's questions; None if the first does that, too."""

    first: Player | AsyncPlayer
    second: Player | AsyncPlayer | None

    @classmethod
    def of(cls, task: Task, shared: Player | AsyncPlayer | None = None) -> Players:
        """Return new players for an attempt; `shared` is the first one if several attempts have it."""
        planned = task.planned
        seed = player_seed(planned.seed, planned.repeat)
        return cls(shared or make_player(task), second_player(planned.cell.player_options, seed=seed))


def play_attempt(task: Task, limits: RunLimits | None, stop: StopFlag, on_record: OnRecord | None = None) -> Times:
    """Play on this thread; an asynchronous player runs in a new event loop.

    `on_record` is called before each call to the player and after each reply, once the record contains it.
    """
    attempt = _Attempt(task, limits, stop, on_record)
    with attempt.recording(), ExitStack() as stack:
        players = Players.of(task)
        if not isinstance(players.first, Player):
            asyncio.run(attempt.aplay(players))
        else:
            _open(players, stack)
            conversation = attempt.continued(players)
            if conversation is None and task.previous is not None:
                players = Players.of(task)
                _open(players, stack)
            conversation = conversation or attempt.begun(players.first)
            hooks = attempt.watch(conversation, stack)
            if play(conversation, players.first, compactor_player=players.second, **hooks).end_reason == "closed":
                stop.set()  # the person who plays has left, so no further episode begins
    return attempt.times()


async def aplay_attempt(
    task: Task, limits: RunLimits | None, stop: StopFlag, shared: AsyncPlayer | None = None
) -> Times:
    """Play on the running event loop, with slow games' steps in threads; a shared player is not closed afterwards."""
    attempt = _Attempt(task, limits, stop)
    with attempt.recording():
        if task.player.agent is not None:
            await attempt.hand_over(task.player.agent)
        else:
            await attempt.aplay(Players.of(task, shared), shared)
    return attempt.times()


@dataclass
class _Attempt:
    """An attempt that is under way; it measures its times from its construction on."""

    task: Task
    limits: RunLimits | None
    stop: StopFlag
    on_record: OnRecord | None = None
    episode: Episode | None = None
    began_again: str | None = None
    after_the_end: str | None = None

    def __post_init__(self) -> None:
        self._began, self._processor = time.perf_counter(), time.thread_time()

    def times(self) -> Times:
        game = 0.0 if self.episode is None else self.episode.game_seconds
        processor = time.thread_time() - self._processor
        return Times(time.perf_counter() - self._began, game, processor, self.began_again, self.after_the_end)

    @contextmanager
    def recording(self) -> Iterator[None]:
        """Record why the attempt did not reach the end of its episode; once it has, what is raised is a note."""
        try:
            yield
        except StoppedError:
            return
        except asyncio.CancelledError as error:
            _append(self.task.record, error, UNANSWERED)
        except (Exception, SystemExit) as error:  # a player that exits ends its episode, not the run
            why = f"{type(error).__name__}: {error}{place_of(error)}"
            if not _append(self.task.record, error, why, traceback.format_exc()):
                self.after_the_end = why

    async def hand_over(self, agent: Agent) -> None:
        """Have an agent play the episode."""
        held = await _in_thread(lambda: self._held(agent))
        self.episode = held.episode
        with held.episode, ExitStack() as stack:
            if self.limits is not None:
                account = stack.enter_context(Account(self.limits, held.episode, self.task.price))
                held.episode.ledger.on_view = account.reserve
            await agent.play(held)

    async def aplay(self, players: Players, shared: AsyncPlayer | None = None) -> None:
        """Play with an asynchronous player; one that is shared with other attempts is open, and stays open."""
        async with AsyncExitStack() as stack:
            await _aopen(players, stack, shared)
            conversation = await _in_thread(partial(self.continued, players))
            if conversation is None:
                if self.task.previous is not None:
                    players = Players.of(self.task, shared)
                    await _aopen(players, stack, shared)
                conversation = await _in_thread(partial(self.begun, players.first))
            assert conversation is not None
            hooks = self.watch(conversation, stack)
            await aplay(conversation, players.first, compactor_player=players.second, **hooks)

    def continued(self, players: Players) -> AnyConversation | None:
        """Return the conversation as an earlier attempt left it; None if the episode has to begin again.

        The earlier record is played again and compared in every event. A player with a state is asked the recorded
        prompts again, and has to give the recorded replies; a model, which gets everything in each prompt, is not
        asked. If either differs, or the record cannot be read, the episode cannot be continued, and the players must
        not be used any more; `began_again` then says why.
        """
        try:
            return self._continue(players) if self._has_begun else None
        except (SmartPlayError, _DifferentReplyError) as error:
            self._give_up(error)
            return None

    def begun(self, player: Player | AsyncPlayer) -> AnyConversation:
        """Return the conversation of a new episode."""
        protocol = self.task.planned.cell.protocol
        return new_conversation(self._new_episode(), player.name, protocol, player_versions(player))

    def watch(self, conversation: BaseConversation, stack: ExitStack | AsyncExitStack) -> dict[str, Any]:
        """Return the callbacks for `play`; the episode is closed with the stack."""
        episode = self.episode = stack.enter_context(conversation.episode)
        prices = self.task.price, self.task.question_price
        account = None if self.limits is None else stack.enter_context(Account(self.limits, episode, *prices))

        def before_a_call(conversation: BaseConversation, prompt: Prompt) -> None:
            if self.stop.is_set():
                raise StoppedError
            if account is not None:
                assert conversation.view is not None
                is_question = conversation.view.purpose == "compaction"
                account.reserve(conversation.view.tokens, prompt.max_tokens or 0, is_question=is_question)
            if self.on_record is not None:
                self.on_record()

        def after_a_reply(conversation: BaseConversation) -> None:
            if account is not None:
                account.settle()
            if self.on_record is not None:
                self.on_record()

        return {"on_prompt": before_a_call, "on_turn": after_a_reply}

    @property
    def _has_begun(self) -> bool:
        """Whether there is an earlier attempt that an exception has not ended before its episode began."""
        return self.task.previous is not None and Record.head(self.task.previous).start is not None

    def _continue(self, players: Players) -> AnyConversation:
        events = self._earlier()
        _ask_again(players, events)
        resumed = resume(events, transcript=self.task.record)
        resumed.episode.ledger.player_versions = player_versions(players.first)
        conversation = resumed.conversation
        if resumed.episode.done or not isinstance(conversation, Conversation | PaperConversation):
            resumed.episode.close()
            raise _DifferentReplyError("The record has no conversation that could go on.")
        return conversation

    def _give_up(self, error: Exception) -> None:
        """Begin again, because the earlier attempt cannot be continued."""
        delete_record(self.task.record)
        self.began_again = str(error)

    def _held(self, agent: Agent) -> Held:
        key = self.task.planned.key
        try:
            if self._has_begun and not agent.goes_on:
                self.began_again = "The record does not have the state of its agent."
            elif self._has_begun:
                resumed = resume(self._earlier(), transcript=self.task.record, session=True)
                session = resumed.conversation if isinstance(resumed.conversation, AgentSession) else None
                return Held(key, resumed.episode, session, self.stop)
        except SmartPlayError as error:
            self._give_up(error)
        episode = self._new_episode()
        episode.begin()
        return Held(key, episode, None, self.stop)

    def _new_episode(self) -> Episode:
        self._load_files()
        planned = self.task.planned
        config = planned.cell.with_seed(planned.seed, planned.repeat)
        return Episode.from_config(config, transcript=self.task.record, carried=self.task.carried)

    def _earlier(self) -> list[Event]:
        """The record of an earlier attempt, unless it began with something other than the trial before has left."""
        assert self.task.previous is not None
        self._load_files()
        check_playable(self.task.planned.cell)  # opens the plan's tokenizer and folders, which a record does not
        events = read_transcript(self.task.previous)
        if Carried.of(events[0]) != self.task.carried:
            raise TranscriptError("The earlier attempt was played after another record of the trial before it.")
        return events

    def _load_files(self) -> None:
        """Import the game and strategy that the plan names; a config or a record does not say where their files are."""
        cell = self.task.planned.cell
        if cell.game_file is not None:
            load_game(cell.game_file, cell.game_sha256, self.task.game_file)
        if cell.budget.strategy is not None:
            load_strategy(cell.budget.strategy, cell.strategy_sha256, self.task.strategy_file)


def remembers_nothing(player: Player | AsyncPlayer) -> bool:
    """Return whether a player's replies depend on its prompts alone, as a model's do; a person is not asked twice."""
    return isinstance(player, ModelPlayer) or any(
        getattr(player, name, False) for name in ("serves_many", "interactive")
    )


def _ask_again(players: Players, events: list[Event]) -> None:
    """Restore the state of players: ask them the recorded prompts, and compare their replies."""
    if all(remembers_nothing(player) for player in players if player is not None):
        return
    record = Record(events)
    prompts = sent_prompts(events, pictures=recorded_pictures(events))
    for sent, replied in record.with_replies(prompts, record.sent_replies):
        player = players.first
        if players.second is not None and sent.prompt.purpose == "compaction":
            player = players.second
        if replied is not None and not remembers_nothing(player):
            reply = player.reply(sent.prompt) if isinstance(player, Player) else asyncio.run(player.areply(sent.prompt))
            if assistant_message(reply.message) != replied:
                raise _DifferentReplyError(f"The player replies differently: in turn {sent.turn}.")


class _DifferentReplyError(Exception):
    """An attempt cannot continue an earlier record."""


def _open(players: Players, stack: ExitStack) -> None:
    for player in players:
        if player is not None:
            enter_player(stack, player)


async def _aopen(players: Players, stack: AsyncExitStack, shared: AsyncPlayer | None) -> None:
    for player in players:
        if player is not None and player is not shared:
            await aenter_player(stack, player)


async def _in_thread(open_one: Callable[[], Opened]) -> Opened:
    """Open an episode in a thread. The thread cannot be stopped, so an episode that it opens is always closed."""
    opening = asyncio.ensure_future(asyncio.to_thread(open_one))
    try:
        return await asyncio.shield(opening)
    except asyncio.CancelledError:
        opened = await opening
        if opened is not None:
            opened.episode.close()
        raise


def _append(record: Path, error: BaseException, *words: str) -> bool:
    """Record why an attempt has ended, and return whether it has no result without that.

    On a full disk no attempt can continue, so the run ends.
    """
    try:
        if not is_disk_full(error):
            return append_exception(record, *words)
    except (OSError, SmartPlayError) as second:
        if not is_disk_full(second):
            raise
    if not isinstance(error, asyncio.CancelledError):
        raise DiskFullError(f"There is no space left for {record}.") from None
    return True
