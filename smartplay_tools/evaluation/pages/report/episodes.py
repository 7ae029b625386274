"""A transcript in the form that the page needs: messages, calls and results by turn, and what each prompt showed.

Texts are kept as recorded. Everything that the page can compute itself (the prompts, the running sums) is left to it,
which keeps ten thousand steps small.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_tools import prompts
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.turns import Turn, TurnBuilder
from smartplay_tools.conversation import paper
from smartplay_tools.episode.config import RULES
from smartplay_tools.games.specs import GAMES
from smartplay_tools.messages import text_of
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.records.record import FAILURES, UNFINISHED
from smartplay_tools.tokens import TokenCounter
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import ResolvedBudget

FACTS = ("game", "player", "seed", "engine", "options", *RULES, "tokenizer", "budget")
"""The fields of a start event that the page shows."""

MOST_REBUILT = 200_000
"""The most turns, over all prompts of an episode, that are rebuilt for the check; more would take minutes."""

WORDS = {
    "observation_left": prompts.OBSERVATION_LEFT,
    "manual_is_above": prompts.MANUAL_IS_ABOVE,
    "system": paper.SYSTEM,
    "observation": paper.OBSERVATION,
    "question": paper.QUESTION,
    "choice": paper.CHOICE,
    "summary": prompts.text("summary"),
}
"""The fixed texts that are part of prompts."""


def episode_data(
    key: str, start: Mapping[str, Any], events: Sequence[Event], facts: Mapping[str, Any]
) -> dict[str, Any]:
    """Return an episode in the form that the page's script reads; `start` are its recorded facts, `facts` its run's."""
    built = () if _is_paper(events) else TurnBuilder.of(events).all_turns
    head = next((event for event in events if event["event"] == "head"), {})
    end = next((event for event in events if event["event"] == "end"), {})
    exception = next((event for event in events if event["event"] == "exception"), {})
    spec = GAMES.get(start["game"])
    asking = Strategies(ResolvedBudget(**start["budget"]), TokenCounter("approximate")).summaries
    return {
        "key": key,
        **{name: start.get(name) for name in FACTS},
        "limits": ResolvedBudget(**start["budget"]).words(),
        "family": spec.family if spec else None,
        "rollout": start["setting"]["rollout"],
        "trial": facts.get("trial"),
        "cost": facts.get("cost"),
        "status": status(end, exception, finished_later=facts.get("finished_later", False)),
        "head": head.get("messages", []),
        "tools": head.get("tools", []),
        "summary_request": None if asking is None else text_of(asking.question),
        "first_observations": [*head.get("before", []), head.get("observation")],
        "turns": turns(events, built),
        "result": end.get("result"),
        "error": exception.get("error") or end.get("result", {}).get("error"),
        "traceback": exception.get("traceback") or end.get("traceback"),
        "check": check(events, built),
    }


def status(end: Event, exception: Event, *, finished_later: bool = False) -> str:
    """Return the state of an attempt: finished, failed, or unfinished if it was stopped from outside or still runs.

    An attempt that was stopped and whose episode a later attempt has finished is "interrupted": nothing is missing.
    """
    reason = end["result"]["end_reason"] if end else None
    if exception or reason in FAILURES:
        return "failed"
    if reason is None or reason in UNFINISHED:
        return "interrupted" if finished_later else "unfinished"
    return "finished"


def turns(events: Sequence[Event], built: Sequence[Turn]) -> list[dict[str, Any]]:
    """Return the contents of every turn, in the order of the prompts and with their call ids and arguments.

    `built` are the turns of its conversation, none in the paper's protocol. A turn may lack its message (there was no
    reply) or its view (none was recorded).
    """
    found: list[dict[str, Any]] = []
    heads: list[Event] = []
    for event in events:
        if event["event"] == "head":
            heads.append(event)
        if "turn" not in event:
            continue
        while len(found) <= event["turn"]:
            found.append({"items": []})
        turn = found[event["turn"]]
        match event["event"]:
            case "view" if event.get("purpose") == "summary":
                turn["request"] = {name: value for name, value in event.items() if name not in _KNOWN}
            case "summary":
                turn["summary"] = {name: event[name] for name in ("covers", "message", "text", "cut", "empty")}
            case "usage" if event.get("purpose") == "summary":
                turn["summary"]["usage"] = {name: event.get(name) for name in ("reply", "overrun", "provider")}
            case "view":
                turn["view"] = {name: value for name, value in event.items() if name not in _KNOWN}
                if len(heads) > 1:  # the host has changed its part
                    turn["head"] = heads[-1]["messages"]
            case "message" if event["by"] == "player":
                turn["message"] = event["message"]
            case "message":
                turn["items"].append(
                    {"message": event["message"], "by": event["by"], "position": event.get("position")}
                )
            case "usage":
                turn["usage"] = {name: event.get(name) for name in ("reply", "overrun", "provider")}
            case "choice":
                turn["choice"] = {"action": event["action"], "fallback": event["fallback"]}
            case "call":
                turn["items"].append({"call": _call(event)})
    for shown in built:
        turn = found[shown.number]
        turn["message"] = shown.assistant
        turn["items"].sort(key=_place)
    return found


def _is_paper(events: Sequence[Event]) -> bool:
    return bool(events[0]["config"].get("protocol") == "paper")


def _place(item: Mapping[str, Any]) -> float:
    """The position of an item in its turn: results in the order of their calls, everything else after them."""
    position = item["call"]["position"] if "call" in item else item["position"]
    return math.inf if position is None else position


_KNOWN = ("event", "turn", "sha256")
"""Fields of a view that the page does not need: `check` compares hashes when the page is made."""


def _call(event: Event) -> dict[str, Any]:
    call = {name: event[name] for name in ("position", "name", "arguments", "text")}
    kept = {name: value for name, value in event["data"].items() if name != "state_hash"}
    return {**call, **kept, **({"is_error": True} if event["is_error"] else {})}


def check(events: Sequence[Event], built: Sequence[Turn]) -> dict[str, Any]:
    """Rebuild every prompt and compare its sha256 with the record's; return their number, and those that differ."""
    views = [event for event in events if event["event"] == "view"]
    work = sum(
        view["step"] - view["first"] if _is_paper(events) else sum(last - first for first, last in view["turns"])
        for view in views
    )
    if work > MOST_REBUILT:
        return {"prompts": len(views), "differ": None}
    differ = [sent.turn for sent in sent_prompts(events, built) if sent.sha256 != sent.recorded_sha256]
    return {"prompts": len(views), "differ": differ}
