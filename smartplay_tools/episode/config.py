"""EpisodeConfig: everything that determines an episode, in one frozen model.

The start event of a record contains the config, the key of an episode is its digest, a cell of a run is a config
without a seed, and a row of results is a config with its result. Replay, `resume` and the replay page create the same
episode again from it.

To add a rule:

1. Add its field to `Rules`. Its default is the rule that every earlier record was played with.
2. Write the code that obeys it.
3. Add its command-line option to `RULES` in `cli/episode_options.py`.
4. Add its keyword to `RunKeywords` in `evaluation/runs/run_options.py`, which type checkers read.

`Episode`, runs, rows, tables, figures and the list of deviations take the rules from the fields. A rule
whose default is not the paper's is named in `_PAPER_RULES`, too.

`deviations` lists everything in which an episode differs from the protocol of the SmartPlay paper. The paper's prompts
hold the manual and the past observations of the setting, ask in free text, lead to one action, and have no caps. All of
it follows from the config, the budget in numbers and the game, so the result of a single episode lists it completely.
How many trials a cell had is a fact about a run, which `evaluation.analysis.summary` adds.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError

from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.episode.budgets import usual_tool_calls
from smartplay_tools.errors import InvalidArgumentError, TranscriptError, check_choice, in_one_line
from smartplay_tools.games.game_registry import GameSpec, Scoring
from smartplay_tools.games.specs import GAMES, recorded_game
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import Budget, Cap, CarriedStore, ObservationForm, Recorded, RecordedBudget, ResolvedBudget

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame


ManualMode = Literal["tool", "pinned", "none"]
BatchPolicy = Literal["all", "first_act"]
ContextOwner = Literal["window", "host"]
ProtocolName = Literal["tools", "paper"]
BudgetLine = Literal["off", "on"]
FirstObservation = Literal["call", "prompt"]
OfferedTools = Literal["all", "useful"]


def _plain(value: Any) -> Any:
    """Return JSON data in the form in which a record is read back: tuples become lists."""
    try:
        return {} if isinstance(value, dict) and not value else json.loads(canonical_json(value))
    except RecursionError:
        raise ValueError("it is nested too deep, or contains itself") from None


PlainData = Annotated[dict[str, Any], BeforeValidator(_plain)]


class Setting(BaseModel):
    """The numbers of a setting. A record contains them because the registry may change."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    history: int
    rollout: int
    kwargs: PlainData = Field(default_factory=dict)

    @classmethod
    def of(cls, spec: GameSpec) -> Self:
        """Return the numbers of a setting."""
        return cls(history=spec.history, rollout=spec.rollout, kwargs=dict(spec.kwargs))


class Rules(Recorded):
    """The rules of an episode: how calls are played and what a prompt contains, the same in every game."""

    later: ClassVar[Mapping[str, Any]] = {
        "budget_line": "off", "first_observation": "call", "offered_tools": "all", "carry": None, "chain": None,
        "wording": None,
    }  # fmt: skip

    manual: ManualMode = "tool"
    """"tool": the agent may read it; "pinned": it is part of every prompt; "none": it is withheld."""
    batch: BatchPolicy = "all"
    """"all": every `act` of a message is played; "first_act": all but the first are refused."""
    context: ContextOwner = "window"
    """Who decides what the model sees: "window", a conversation of this library; "host", the host's agent."""
    protocol: ProtocolName = "tools"
    """Tool calls, or the paper's free text."""
    observation: ObservationForm = "text"
    """What an observation is: "text"; "picture", one that the game makes of itself; "both"."""
    budget_line: BudgetLine = "off"
    """"on": the last line of each result says what is left of the budget; "off": results have no such line."""
    first_observation: FirstObservation = "call"
    """"call": a call of `observe` shows it; "prompt": the task ends with it until it is older than `history`."""
    offered_tools: OfferedTools = "all"
    """"all": the three tools, whatever they can say; "useful": those of them that can say something new."""
    carry: CarriedStore | None = None
    """What a trial of a run takes over from the one before it in its chain: "notes", "memory"; None: nothing."""
    chain: Cap | None = None
    """How many trials a chain has, with `carry`; None: all trials of the cell."""
    wording: str | None = None
    """The sentences that the model is sent, by a name that ends with their digest; None: those of `prompts`."""


RULES = tuple(Rules.model_fields)
"""The names of the rules."""

USUAL_RULES = dict(Rules())
"""The rules where nothing else is asked for."""


def read_rules(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rules that a user asks for, with their values checked; `InvalidArgumentError` names a wrong one."""
    for name, value in given.items():
        kind = Rules.model_fields[name].annotation
        kinds = (kind, *get_args(kind)) if value is not None else (kind,)
        for choices in (get_args(each) for each in kinds if get_origin(each) is Literal):
            check_choice(name, value, choices)
    try:
        return dict(Rules(**given))
    except ValidationError as error:
        first = error.errors()[0]
        raise InvalidArgumentError(f"{first['loc'][0]} {first['input']!r}: {first['msg']}.") from None


class CellConfig(Rules):
    """An `EpisodeConfig` without a seed: what the trials of a cell share."""

    later: ClassVar[Mapping[str, Any]] = {**Rules.later, "sentences": {}}

    game: str
    """The id of a setting."""
    game_file: str | None = None
    """The file and the name in it that the setting was read from, as `FILE.py:NAME` without folders; None without."""
    game_sha256: str | None = None
    """The sha256 of that file."""
    setting: Setting
    """The numbers of the setting."""
    engine: str | None = None
    """The engine that runs the game; None for games that have only one."""
    options: PlainData = Field(default_factory=dict)
    """The game's own options (`TextGame.options`)."""
    budget: RecordedBudget = Field(default_factory=lambda: Budget.from_record({}))
    """The budget as the user gave it, before "game" and "auto" are resolved."""
    tokenizer: str = "o200k_base"
    """The name of the tokenizer that counts budget tokens."""
    tokenizer_sha256: str | None = None
    """The sha256 of the tokenizer's vocabulary; None if the tokenizer does not give one."""
    strategy_sha256: str | None = None
    """The sha256 of the file of the budget's strategy; None if it is not in a file."""
    prompts: str = VERSION
    """The version of the prompts around the games."""
    sentences: PlainData = Field(default_factory=dict)
    """The sentences of `wording` that are not those of the version."""
    player: str | None = None
    """The player's name; None if it was not given."""
    player_options: PlainData = Field(default_factory=dict)
    """The options with which the player was created."""

    def describe(self) -> str:
        """Return what the player is given, in a few words; what is as by default is not mentioned."""
        given = {name: getattr(self, name) for name in RULES}
        unusual = (f"{name} {value}" for name, value in given.items() if value != USUAL_RULES[name])
        return ", ".join(filter(None, [*unusual, self.budget.describe()]))

    def chain_of(self, trial: int) -> int:
        """Return the number of a trial's chain; without `carry` every trial is its own chain."""
        if self.carry is None:
            return trial
        return 0 if self.chain is None else trial // self.chain

    def with_seed(self, seed: int, repeat: int = 0) -> EpisodeConfig:
        """Return the config of one episode."""
        return EpisodeConfig(**dict(self), seed=seed, repeat=repeat)

    @property
    def words(self) -> Wording:
        """What the model is told."""
        version = self.prompts
        return Wording.of(version) if self.wording is None else Wording.own(version, self.wording, self.sentences)

    @property
    def spec(self) -> GameSpec:
        """The setting: the rules as registered here, with the numbers of this config."""
        setting = self.setting
        return replace(self.registered, history=setting.history, rollout=setting.rollout, kwargs=setting.kwargs)

    @property
    def registered(self) -> GameSpec:
        """The setting as it is here: registered under its id, or read from the file of this digest."""
        return GAMES[self.game] if self.game_file is None else recorded_game(self.game_file, self.game_sha256)

    def make_game(self, spec: GameSpec, *, is_recorded: bool = False) -> TextGame:
        """Build the game, before its first reset. `spec` is the setting, which need not be registered.

        A config that `is_recorded` can come from a stranger: the places that its options name are not opened.
        """
        engine = {} if self.engine is None else {"engine": self.engine}
        history = spec.history if self.budget.history == "game" else self.budget.history
        kind = spec.load()
        hidden = kind.places if is_recorded else ()
        options = kind.options_from_record({name: v for name, v in self.options.items() if name not in hidden})
        game = spec.make(**options, **engine, history=history)
        game.shows_pictures = self.observation != "text"
        return game

    def to_json(self) -> dict[str, Any]:
        """Return the config as plain data, without fields at their defaults."""
        dumped: dict[str, Any] = self.model_dump(mode="json", exclude_defaults=True)
        return {**dumped, "prompts": self.prompts}

    @property
    def digest(self) -> str:
        """16 hex digits of the sha256 of `to_json`. Fields added later leave older digests unchanged."""
        return hashlib.sha256(canonical_json(self.to_json())).hexdigest()[:16]


SCORING = TypeAdapter(Scoring)
"""Reads what a record or a row says of scores."""


class EpisodeConfig(CellConfig):
    """Everything that determines an episode. Its `digest` is the episode's key in a run."""

    seed: int
    """The only source of the game's randomness."""
    repeat: int = 0
    """Which time this world is played; the player's randomness differs."""

    @property
    def key(self) -> str:
        """The `digest`, as runs name it. Episodes with the same key have the same configuration in every field."""
        return self.digest

    @classmethod
    def from_event(cls, start: Mapping[str, Any]) -> Self:
        """Return the config in the start event of a record; `TranscriptError` if it is not valid.

        The event's other two objects are checked, too: the budget in numbers, and the bounds of scores.
        """
        try:
            config = cls(**start["config"])
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise TranscriptError(f"The record's start event has no valid config: {in_one_line(error)}.") from None
        try:
            ResolvedBudget.from_record(start["budget"])
            if (scoring := start.get("scoring")) is not None:
                SCORING.validate_python(scoring)
        except (KeyError, TypeError, ValueError) as error:
            raise TranscriptError(f"The record's start event has no valid budget: {in_one_line(error)}.") from None
        return config


def recorded_facts(start: Mapping[str, Any], config: EpisodeConfig | None = None) -> dict[str, Any]:
    """Return the configuration in a start event as plain data: the config's fields, defaults included.

    `budget` is the budget in numbers, `asked` the part of it that the user gave, `scoring` what scores can be, None
    where the record does not say; `config` is the event's, if it has been read already.
    """
    config = config or EpisodeConfig.from_event(start)
    asked = config.budget.model_dump(exclude_defaults=True)
    facts = {"budget": start["budget"], "asked": asked, "scoring": start.get("scoring")}
    return {**vars(config), "setting": vars(config.setting).copy(), **facts}


Deviations = dict[str, dict[str, Any]]
"""name -> {"paper": ..., "played": ...}; None stands for no cap."""

CAPS = ("prompt_tokens", "reply_tokens", "episode_tokens", "episode_cost", "result_tokens")
"""Fields of a budget that the paper does not limit."""


def deviations(config: EpisodeConfig, spec: GameSpec, budget: ResolvedBudget, *, is_privileged: bool) -> Deviations:
    """Return what differs from the paper in setting, protocol, budget and player; what a game adds is not included."""
    player = {"player": differs("sees its prompts", "privileged: sees the game's state")} if is_privileged else {}
    return {**_of_setting(spec, budget), **_of_protocol(config), **_of_caps(config, budget), **player}


def differs(paper: Any, played: Any) -> dict[str, Any]:
    """Return a deviation: what the paper has, and what was played."""
    return {"paper": paper, "played": played}


def _of_setting(spec: GameSpec, budget: ResolvedBudget) -> Deviations:
    """Compare with the paper's setting; a setting that the paper does not have is compared with its own numbers."""
    paper = GAMES.get(spec.id, spec)
    played = {"history": budget.history, "rollout": spec.rollout}
    return {name: differs(getattr(paper, name), n) for name, n in played.items() if n != getattr(paper, name)}


_PAPER_RULES: Mapping[str, Any] = {**USUAL_RULES, "manual": "pinned", "batch": "first_act", "protocol": "paper"}
"""The rules of the paper; one that is not named here is in the paper as it is by default."""


def _of_protocol(config: EpisodeConfig) -> Deviations:
    # A chain says nothing in addition to `carry`.
    played = {name: getattr(config, name) for name in RULES if name != "chain"}
    if config.protocol == "paper":
        # All of its prompts hold the manual, whether or not there is a tool that could read it, and lead to one action.
        played |= {"manual": "none" if config.manual == "none" else "pinned", "batch": "first_act"}
    unlike = (name for name in played if played[name] != _PAPER_RULES[name])
    differences = {name: differs(_PAPER_RULES[name], played[name]) for name in unlike}
    if "batch" in differences:
        differences["batch"]["paper"] = "one action a prompt"
    # The options of a player that change what counts as a call.
    for name, usual in (("parse_calls", None), ("tool_choice", "auto")):
        if config.protocol == "tools" and (chosen := config.player_options.get(name, usual)) != usual:
            differences[name] = differs(usual, chosen)
    return differences


def _of_caps(config: EpisodeConfig, budget: ResolvedBudget) -> Deviations:
    """The usual cap on tool calls is far beyond the calls that a rollout takes, so only a lower one counts."""
    caps = {name: getattr(budget, name) for name in CAPS}
    differences = {name: differs(None, cap) for name, cap in caps.items() if cap is not None}
    if budget.slack:
        differences["slack"] = differs(0.0, budget.slack)
    fields = Budget.model_fields
    differences |= {name: differs(fields[name].default, getattr(budget, name)) for name in budget.strategies}
    if budget.tool_calls is not None and budget.tool_calls < usual_tool_calls(config.setting.rollout):
        differences["tool_calls"] = differs(None, budget.tool_calls)
    if budget.stalled_turns is not None and budget.stalled_turns < fields["stalled_turns"].default:
        differences["stalled_turns"] = differs(None, budget.stalled_turns)
    return differences
