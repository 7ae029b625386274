"""Deviations: everything in which an episode differs from the protocol of the SmartPlay paper.

The paper's prompts hold the manual and the past observations of the setting, ask in free text, lead to one action, and
have no caps. All of it follows from the config, the budget in numbers and the game, so the result of a single episode
lists it completely. How many trials a cell had is a fact about a run, which `evaluation.analysis.summary` adds.
"""

from __future__ import annotations

from typing import Any

from smartplay_tools.episode.budgets import usual_tool_calls
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.games.specs import GAMES, GameSpec
from smartplay_tools.types import Budget, ResolvedBudget

Deviations = dict[str, dict[str, Any]]
"""name -> {"paper": ..., "played": ...}; None stands for no cap."""

CAPS = ("prompt_tokens", "reply_tokens", "episode_tokens", "result_tokens")
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


def _of_protocol(config: EpisodeConfig) -> Deviations:
    differences = {} if config.context == "window" else {"context": differs("window", config.context)}
    if config.protocol == "paper":
        # The manual is part of all of its prompts, whether or not there is a tool that could read it.
        return {**differences, **({"manual": differs("pinned", "none")} if config.manual == "none" else {})}
    differences["protocol"] = differs("paper", config.protocol)
    if config.manual != "pinned":
        differences["manual"] = differs("pinned", config.manual)
    if config.observation != "text":
        differences["observation"] = differs("text", config.observation)
    if config.carry is not None:
        differences["carry"] = differs(None, config.carry)
    if config.batch != "first_act":
        differences["batch"] = differs("one action a prompt", config.batch)
    # The options of a player that change what counts as a call.
    for name, usual in (("parse_calls", None), ("tool_choice", "auto")):
        if (chosen := config.player_options.get(name, usual)) != usual:
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
