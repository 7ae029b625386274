"""Cells: configs without a seed, made from a user's arguments and checked before anything is played."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from smartplay_tools.context.prompts.wording import load_wording
from smartplay_tools.context.strategies.custom import load_strategy, name_on_record, refused_with
from smartplay_tools.context.tokens import Tokenizer, get_tokenizer
from smartplay_tools.context.tokens.counter import TokenCounter, picture_counter, shared_counter
from smartplay_tools.context.tokens.tokenizers import recorded_tokenizer, split_rule, with_pictures
from smartplay_tools.episode.budgets import check_strategies
from smartplay_tools.episode.carried import check_carry
from smartplay_tools.episode.config import RULES, USUAL_RULES, CellConfig, Rules, Setting, read_rules
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.games.specs import get_spec
from smartplay_tools.types import Budget

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame


def cell_config(
    game: str | GameSpec,
    *,
    budget: Budget | None = None,
    engine: str | None = None,
    counter: TokenCounter | None = None,
    player: str | None = None,
    player_options: Mapping[str, Any] | None = None,
    **given: Any,
) -> CellConfig:
    """Return a config without a seed from a user's arguments; `InvalidArgumentError` if one of them is invalid.

    `given` are rules (`Rules`) and the game's own options, by name.
    """
    spec = get_spec(game)
    kind = spec.load()
    rules = read_rules({name: value for name, value in given.items() if name in RULES})
    options = {name: value for name, value in given.items() if name not in RULES}
    if unknown := options.keys() - set(kind.options):
        offered = ", ".join(kind.options) or "none"
        raise InvalidArgumentError(f"{spec.id} has no option {', '.join(sorted(unknown))}; its options: {offered}.")
    if engine is not None and engine not in kind.engines:
        raise InvalidArgumentError(
            f"{spec.id} has no engine {engine!r}; its engines: {', '.join(kind.engines) or 'only one'}."
        )
    words = None if rules["wording"] is None else load_wording(rules["wording"])
    if words is not None and rules["protocol"] == "paper":
        raise InvalidArgumentError("The paper's protocol has its own words, so wording would do nothing; leave it out.")
    counter, budget = counter or shared_counter(), budget or Budget()
    which = {name: rules[name] for name in ("context", "protocol", "observation")}
    check_strategies(budget, spec, **which)
    check_carry(Rules(**rules), budget)
    if rules["budget_line"] == "on" and rules["protocol"] == "paper":
        raise InvalidArgumentError(
            'budget_line="on" adds a line to the results of tools, and the paper\'s protocol has none; leave it "off".'
        )
    check_first_prompt(Rules(**rules), budget)
    strategy = None if budget.strategy is None else load_strategy(budget.strategy)
    if strategy is not None and (reason := refused_with(strategy.make, budget)):
        raise InvalidArgumentError(reason)
    engine = engine or next(iter(kind.engines), None)
    if rules["observation"] != "text":
        _check_pictures(spec, kind, engine, options, rules)
        counter = picture_counter(counter)
    plain = {name: str(value) if isinstance(value, Path) else value for name, value in options.items()}
    plain = kind.options_to_record(plain)
    try:
        cell = CellConfig(
            game=spec.id,
            game_file=spec.file,
            game_sha256=spec.sha256,
            setting=Setting.of(spec),
            engine=engine,
            options=plain,
            budget=budget,
            tokenizer=counter.tokenizer.name,
            tokenizer_sha256=sha256_of(counter),
            strategy_sha256=None if strategy is None else strategy.sha256,
            player=player,
            player_options=dict(player_options or {}),
            sentences={} if words is None else words.changed,
            **{**rules, "wording": words and words.name},
        )
    except TypeError as error:
        raise InvalidArgumentError(f"Options are recorded, so they must be JSON ({error}).") from None
    return with_recorded_name(cell)


def check_first_prompt(rules: Rules, budget: Budget) -> None:
    """Raise an `InvalidArgumentError` if the first prompt cannot be what the rules ask for.

    A compactor may rewrite the task, which then has no age.
    """
    unusual = [name for name in ("first_observation", "offered_tools") if getattr(rules, name) != USUAL_RULES[name]]
    if unusual and (rules.protocol == "paper" or rules.context == "host"):
        raise InvalidArgumentError(
            f'{unusual[0]} is a rule of prompts with tools that this library makes; use protocol="tools" and '
            'context="window".'
        )
    if rules.first_observation == "prompt" and rules.observation != "text":
        raise InvalidArgumentError('first_observation="prompt" is in words; leave observation at "text".')
    if rules.first_observation == "prompt" and budget.strategy is not None and budget.history is not None:
        raise InvalidArgumentError(
            f"Under the strategy {budget.strategy} the task does not age, so that the first observation would outlive "
            "history; give history=None."
        )


def with_recorded_name(cell: CellConfig) -> CellConfig:
    """Return a cell that names a strategy's file without its folders; earlier versions recorded them."""
    if cell.budget.strategy is None:
        return cell
    budget = cell.budget.model_copy(update={"strategy": name_on_record(cell.budget.strategy)})
    return cell.model_copy(update={"budget": budget})


def _check_pictures(
    spec: GameSpec, kind: type[TextGame], engine: str | None, options: Mapping[str, Any], rules: Mapping[str, Any]
) -> None:
    """Raise an `InvalidArgumentError` if the observations of a setting cannot be pictures."""
    asked = f'observation="{rules["observation"]}"'
    if reason := kind.refused_pictures(engine, options):
        raise InvalidArgumentError(
            f'{spec.id} cannot be played with {asked}, since {reason}; leave it at "text". Crafter and Minecraft on '
            "the engine voxel have pictures."
        )
    if rules["protocol"] == "paper":
        raise InvalidArgumentError(f'{asked} needs tool calls: the paper\'s protocol is words; leave it at "text".')


def most_calls(cell: CellConfig) -> int:
    """Return the calls to the player in the longest episode that the game allows, one of them for the manual."""
    rollout = cell.setting.rollout
    return 2 * rollout if cell.protocol == "paper" else rollout + 1


def counter_of(config: CellConfig, given: str | Tokenizer | None = None, *, is_recorded: bool) -> TokenCounter:
    """Return the counter of a config; `given` is the tokenizer that a user names for it, where it is another object.

    A config that `is_recorded` opens no tokenizer: see `recorded_tokenizer`.
    """
    if given is not None and (rule := split_rule(config.tokenizer)[1]) is not None:
        given = with_pictures(get_tokenizer(given), rule)
    if given is None:
        named = config.tokenizer, config.tokenizer_sha256
        given = recorded_tokenizer(*named) if is_recorded else config.tokenizer
    counter = shared_counter(given, config.prompts)
    # The file may have been moved; only its content matters.
    asked, found = config.tokenizer, counter.tokenizer.name
    if config.tokenizer_sha256 is not None:
        asked, found = config.tokenizer_sha256, sha256_of(counter) or found
    if asked != found:
        raise InvalidArgumentError(
            f"The record was counted with the tokenizer {config.tokenizer!r} ({asked}), "
            f"not with {counter.tokenizer.name!r} ({found})."
        )
    return counter


def sha256_of(counter: TokenCounter) -> str | None:
    """Return the digest of a counter's vocabulary, if its tokenizer has one."""
    sha256: str | None = getattr(counter.tokenizer, "sha256", None)
    return sha256
