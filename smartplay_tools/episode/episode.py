"""Episode: one game played once, through `call`, which answers every call that a model can send.

A valid action is played, a mistake is reported to the model and counted, and nothing is repaired or guessed. `call`
never raises for anything that JSON or text can express. The stages of a call:

    lock -> answered before? -> over? -> `Tools.parse` -> the game's step -> cut to its cap -> transcript -> result

There is no tool to reset, to seed or to read the score: the agent and its harness have different interfaces.

`episode.ledger` holds what happened in the game: the record, the counts and the end. A listener is called with every
event of an episode as it is recorded, with a transcript or without, because tracing needs to know when events happen.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Self, get_args

from smartplay_tools.context.tokens import TokenCounter, Tokenizer
from smartplay_tools.context.tokens.counter import picture_counter, shared_counter
from smartplay_tools.episode.carried import Carried
from smartplay_tools.episode.cells import cell_config, counter_of
from smartplay_tools.episode.config import (
    BatchPolicy,
    ContextOwner,
    EpisodeConfig,
    ManualMode,
    ProtocolName,
)
from smartplay_tools.episode.game_session import GameSession
from smartplay_tools.episode.ledger import Ledger, Listener
from smartplay_tools.errors import GameValueError, InvalidArgumentError, check_choice
from smartplay_tools.games.game_registry import GameSpec, close_game
from smartplay_tools.games.seeds import check_seed
from smartplay_tools.games.specs import get_spec
from smartplay_tools.tool_formats.functions import tool_functions
from smartplay_tools.transcript.events import Event
from smartplay_tools.transcript.file import Sink, TranscriptWriter
from smartplay_tools.transcript.hashing import head_bytes, prompt_sha256, tools_bytes
from smartplay_tools.types import (
    Budget,
    EndReason,
    EpisodeResult,
    Progress,
    Prompt,
    ToolCall,
    ToolResult,
    ToolSpec,
)
from smartplay_tools.types.arguments import as_text, read, well_formed
from smartplay_tools.types.messages import Message

if TYPE_CHECKING:
    from smartplay_tools.context.compaction import Compactor
    from smartplay_tools.games.base import TextGame


NewListener = Callable[["Episode"], Listener]
"""Called with each new episode; returns the listener of its events."""

_LISTENERS: list[NewListener] = []


def add_listener(new_listener: NewListener) -> Callable[[], None]:
    """Listen to every episode that this process makes from now on; return a function that stops it for later ones."""
    _LISTENERS.append(new_listener)
    return lambda: _LISTENERS.remove(new_listener)


class Episode:
    """One playthrough of a setting.

    Arguments:
        game: the id of a setting in `GAMES`, or a `GameSpec` of your own.
        seed: the only source of the game's randomness, an integer of at least 0.
        budget: what may be seen and spent; "game" and "auto" are resolved to numbers at once (`Episode.budget`).
        engine: the engine, for games that have several.
        manual: "tool", the agent may read it; "pinned", it is part of every prompt; "none", it is withheld.
        batch: "all" plays every `act` of a message in order; "first_act" refuses all but the first.
        context: "window", a `Conversation` decides what the model sees; "host", the agent of a host does.
        tokenizer: a name or an object (`smartplay_tools.context.tokens`).
        transcript: a new file, or a list, for the record.
        options: the game's own keyword arguments (`TextGame.options`), and rules (`Rules`) that have no argument here.

    An episode is thread-safe and shares no state with other episodes. `with` closes it at the end of the block.
    Its `ledger` belongs to this package: conversations and the readers of records write it.
    """

    def __init__(
        self,
        game: str | GameSpec,
        *,
        seed: int,
        budget: Budget | None = None,
        engine: str | None = None,
        manual: ManualMode = "tool",
        batch: BatchPolicy = "all",
        context: ContextOwner = "window",
        tokenizer: str | Tokenizer | None = None,
        transcript: str | Path | list[Event] | None = None,
        **options: Any,
    ) -> None:
        if "protocol" in options:
            raise InvalidArgumentError(
                'The protocol is not an argument of Episode; `play` takes it (protocol="paper").'
            )
        if "carry" in options or "chain" in options:
            raise InvalidArgumentError("carry and chain are rules of a run of several trials; `evaluate` takes them.")
        spec, counter = get_spec(game), shared_counter(tokenizer)
        cell = cell_config(
            spec, budget=budget, engine=engine, manual=manual, batch=batch, context=context, counter=counter, **options
        )
        counter = counter if cell.observation == "text" else picture_counter(counter)
        self._open(cell.with_seed(check_seed(seed)), spec, counter, transcript)

    @classmethod
    def from_config(
        cls,
        config: EpisodeConfig,
        *,
        tokenizer: str | Tokenizer | None = None,
        transcript: Sink | None = None,
        is_recorded: bool = False,
        carried: Carried | None = None,
        strategy: Compactor | None = None,
    ) -> Self:
        """Return the episode of a config; `tokenizer` is required if the config names a custom tokenizer object.

        A config that `is_recorded` opens and imports nothing that the user has not named: see `recorded_strategy` and
        `recorded_tokenizer`. `carried` is what the episode takes over from the trial before it, where its rules have
        `carry`. `strategy` stands for the custom strategy that the config names, which is then not imported.
        """
        if carried is not None and config.carry is None:
            raise InvalidArgumentError("An episode whose rules do not have carry takes nothing over from another one.")
        counter = counter_of(config, tokenizer, is_recorded=is_recorded)
        episode = cls.__new__(cls)
        episode._open(
            config, config.spec, counter, transcript, is_recorded=is_recorded, carried=carried, strategy=strategy
        )
        return episode

    def _open(
        self,
        config: EpisodeConfig,
        spec: GameSpec,
        counter: TokenCounter,
        transcript: Sink | None,
        *,
        is_recorded: bool = False,
        carried: Carried | None = None,
        strategy: Compactor | None = None,
    ) -> None:
        self.carried = carried
        """What it takes over from the trial before it in its chain; None for nothing."""
        self.spec, self.counter = spec, counter
        began = time.perf_counter()
        self.game, failed = config.make_game(spec, is_recorded=is_recorded), None
        try:
            try:
                self.game.reset(seed=config.seed)
            except GameValueError as error:
                failed = error
            session = GameSession(spec, self.game, config, counter, carried)
            if failed is None:
                session.note_score()
            else:
                session.end("game_error", failed)
            if strategy is None:
                session.strategies.load_custom(config.strategy_sha256, is_recorded=is_recorded)
            else:
                session.strategies.custom = strategy
            writer = None if transcript is None else TranscriptWriter(transcript)
        except BaseException:
            close_game(self.game)
            raise
        session.game_seconds = time.perf_counter() - began
        self.words = session.words
        """What the model is told, in the version of the config."""
        self.budget = session.budget
        """The budget in numbers."""
        self.head = session.head
        """The first messages of every prompt: system and task."""
        self.ledger = Ledger(config, session, writer, carried)
        """What conversations of this package write: the record, the counts and the end. Its members may change."""
        self.stats = self.ledger.stats
        """What has been counted so far."""
        self.lock = self.ledger.lock
        """Held while a call or a reply is processed."""
        self.ledger.listeners = [new_listener(self) for new_listener in _LISTENERS]

    # For the agent.

    @property
    def tools(self) -> tuple[ToolSpec, ...]:
        """The tools as they are described to the model: three, and those of the strategies."""
        return self.ledger.session.tools.specs

    def call(self, name: str, arguments: Any = None, call_id: str | None = None) -> ToolResult:
        """Answer one call, as its own turn. A mistake gives a result with `is_error`, never an exception.

        `call_id` is the transport's idempotency key: the same key with the same call returns the recorded result again
        (`data["replayed"]`) without counting it; with another call it returns an error. Keys are kept to the end.
        """
        return self.call_batch([ToolCall(name, arguments, call_id)])[0]

    def call_batch(self, calls: Sequence[ToolCall]) -> list[ToolResult]:
        """Answer the calls of one message in their order, as one turn."""
        with self.lock:
            self.begin()
            turn, acted, results = self.stats.turns, False, []
            for position, call in enumerate(calls):
                # A model's JSON can hold anything where a name belongs.
                name, key = as_text(call.name), as_text(call.call_id)
                arguments = read(call.arguments)
                result = self.ledger.recall(key, name, arguments)
                if result is None:
                    may_act = not acted or self.config.batch == "all"
                    result = self.ledger.answer(turn, position, name, arguments, may_act=may_act, key=key)
                acted = acted or name == "act"
                results.append(result)
            self.ledger.complete_turn()
            if results and self.done:
                results[-1] = replace(results[-1], done=True)
            # A mistake quotes what the model wrote; half a character is on record, and no request can hold it.
            return [replace(result, text=well_formed(result.text)) for result in results]

    async def acall(self, name: str, arguments: Any = None, call_id: str | None = None) -> ToolResult:
        """Answer one call in a shared thread; the calls of an episode are answered in the order of their arrival."""
        return await self.ledger.queue.run(lambda: self.call(name, arguments, call_id))

    def functions(self) -> tuple[Callable[[], str], Callable[[str], str], Callable[[], str]]:
        """Return the game's tools as plain annotated, documented functions: observe, act, read_manual."""
        self.refuse_pictures("A function")
        return tool_functions(self)

    # For the harness.

    @property
    def config(self) -> EpisodeConfig:
        """Everything that determines this episode, except what it takes over from another one."""
        return self.ledger.config

    @property
    def result(self) -> EpisodeResult | None:
        """The result, once the episode is over."""
        return self.ledger.result

    @property
    def if_closed(self) -> tuple[EndReason, Exception | None, str | None] | None:
        """What to record if the episode is closed now, as reason, error and detail; set by hosts that stop early."""
        return self.ledger.if_closed

    @property
    def manual_text(self) -> str:
        """The game's manual, cut to its cap."""
        return self.ledger.session.manual_text

    @property
    def end_reason(self) -> EndReason | None:
        """Why the episode is over; None while it runs."""
        return self.ledger.session.end_reason

    @property
    def done(self) -> bool:
        """Whether the episode is over."""
        return self.ledger.done

    @property
    def progress(self) -> Progress:
        """The state of the episode: score, reward, steps and, once it is over, the reason."""
        score = self.ledger.session.score
        normalized = self.spec.normalize(score) if self.game.comparable else None
        return Progress(score, normalized, self.stats.reward, self.stats.steps, self.end_reason)

    @property
    def game_seconds(self) -> float:
        """Seconds spent so far in the game's reset and steps in this process; not part of the record."""
        return self.ledger.session.game_seconds

    def privileged_game(self) -> TextGame:
        """Return the game itself, for a player that needs more than its messages; record and result note the access."""
        with self.lock:
            self.begin()
            if not self.ledger.is_privileged:
                self.ledger.is_privileged = True
                self.ledger.record({"event": "reveal"})
            return self.game

    def picture(self) -> Any:
        """Return the picture that a game makes of itself, an array of RGB pixels; record and result note that.

        A person may ask for it, where the game has the option `render_mode="rgb_array"`. No prompt has a picture.
        """
        with self.lock:
            if self.game.render_mode != "rgb_array":
                raise InvalidArgumentError(f'{self.spec.id} draws itself only with render_mode="rgb_array".')
            self.begin()
            self.ledger.has_shown_pictures = True
            self.ledger.record({"event": "picture", "turn": self.stats.turns, "step": self.stats.steps})
            return self.game.render()

    def note_prompt(self, prompt: Prompt, reply: Message) -> None:
        """Record a prompt that a host with `context="host"` has sent to its model, and the reply.

        Both are counted as usual; a prompt over `prompt_tokens` is noted as such and not cut. After the end nothing is
        noted. With a window this library makes the prompts itself, so a call is an `InvalidArgumentError`.
        """
        if self.config.context != "host":
            raise InvalidArgumentError('Prompts are noted with context="host" only: a window records its own.')
        with self.lock:
            self.begin()
            tokens, cap = self.counter.prompt(prompt.messages, prompt.tools), self.budget.prompt_tokens
            self.ledger.record(
                {
                    "event": "sent",
                    "turn": self.stats.turns,
                    "tokens": tokens,
                    "reply": self.counter.message(reply),
                    "over": cap is not None and tokens > cap,
                    "sha256": prompt_sha256(map(head_bytes, prompt.messages), tools_bytes(prompt.tools)),
                }
            )

    def refuse_pictures(self, host: str, *, has_option: bool = False) -> None:
        """Raise an `InvalidArgumentError` if observations are pictures, for a host that shows its model words only.

        `has_option`: the host shows pictures with its option `pictures=True`.
        """
        if self.config.observation != "text":
            remedy = "pass pictures=True if the model sees them" if has_option else 'leave it at "text" here'
            raise InvalidArgumentError(
                f'{host} gives its model results in words only, and observation="{self.config.observation}" has '
                f"pictures; {remedy}."
            )

    def begin(self, *, player: str | None = None, protocol: ProtocolName = "tools") -> None:
        """Write the record's first event. The first call sets player and protocol, unless the config has them."""
        self.ledger.begin(player=player, protocol=protocol)

    def end(self, reason: EndReason, error: BaseException | None = None, *, detail: str | None = None) -> None:
        """End the episode, unless it is over; an error is recorded with its traceback.

        For a host's own limit the reason is "host", with the limit's name in `detail`.
        """
        check_choice("The reason of an end", reason, get_args(EndReason))
        with self.lock:
            self.begin()
            self.ledger.session.end(reason, error, detail)
            self.ledger.finish_if_over()

    def close(self) -> None:
        """End the episode if it is still running, and release its resources. May be called twice.

        The end is `closed`, unless the host has said why it stopped (`if_closed`).
        """
        with self.lock:
            try:
                reason, error, detail = self.if_closed or ("closed", None, None)
                self.end(reason, error, detail=detail)
            finally:
                if self.ledger.writer is not None:
                    self.ledger.writer.close()
                close_game(self.game)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "An Episode holds a running game and cannot be pickled; pickle its `config` and make it again with "
            "`Episode.from_config`, or continue its record with `resume`."
        )
