"""A transcript in the form that the page needs: messages, calls and results by turn, and what each prompt showed.

Texts are kept as recorded. Everything that the page can compute itself (the prompts, the running sums) is left to it,
which keeps ten thousand steps small.
"""

from __future__ import annotations

import functools
import json
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.summaries import summaries_of
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.context.turns import BROUGHT_BACK, Form
from smartplay_tools.context.view import Selection
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.conversation import paper
from smartplay_tools.episode.config import RULES
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.accounts import Accounts
from smartplay_tools.records.prompts import is_compacted, rewritten_prompts
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import CallEvent, concerns_summary, purpose_of
from smartplay_tools.types import ResolvedBudget
from smartplay_tools.types.messages import text_of

FACTS = ("game", "player", "seed", "engine", "options", *RULES, "tokenizer", "prompts", "budget")
"""The fields of a start event that the page shows."""

MOST_REBUILT = 200_000
"""The most turns, over all prompts of an episode, that are rebuilt for the check; more would take minutes."""


def fixed_texts(version: str) -> dict[str, str]:
    """Return the fixed texts that are part of prompts, by the names that the page's script has for them."""
    words = {
        name: Wording.of(version)(name) for name in ("observation_left", "manual_is_above", "picture_shown", "summary")
    }
    of_paper = {"system": paper.SYSTEM, "observation": paper.OBSERVATION, "question": paper.QUESTION}
    return {**words, **of_paper, "choice": paper.CHOICE}


def episode_data(key: str, record: Record, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return an episode in the form that the page's script reads; `facts` are those of its run."""
    start = record.facts
    head: Mapping[str, Any] = record.heads[0] if record.heads else {}
    spec = GAMES.get(record.game)
    return {
        "key": key,
        **{name: start.get(name) for name in FACTS},
        **_budget_facts(json.dumps(record.budget), record.config.words.name),
        "prompts": record.config.words.name,
        "family": spec.family if spec else None,
        "rollout": start["setting"]["rollout"],
        "trial": facts.get("trial"),
        "cost": facts.get("cost"),
        "status": status(record, finished_later=facts.get("finished_later", False)),
        "head": head.get("messages", []),
        "tools": head.get("tools", []),
        "first_observations": [*head.get("before", []), head.get("observation")],
        **accounts(record, turns(record)),
        "result": record.result_data,
        "error": record.error,
        "traceback": record.traceback,
        "check": check(record),
    }


@functools.lru_cache(64)
def _budget_facts(numbers: str, version: str) -> Mapping[str, Any]:
    """What the page says of a budget; a run has few of them."""
    budget = ResolvedBudget(**json.loads(numbers))
    asking = summaries_of(budget, shared_counter("approximate"), Wording.of(version))
    return {
        "limits": budget.words(),
        "summary_request": None if asking is None else text_of(asking.question.message),
    }


def status(record: Record, *, finished_later: bool = False) -> str:
    """Return the state of an attempt: finished, failed, or unfinished if it was stopped from outside or still runs.

    An attempt that was stopped and whose episode a later attempt has finished is "interrupted": nothing is missing.
    """
    if record.outcome in ("finished", "failed"):
        return record.outcome
    return "interrupted" if finished_later else "unfinished"


def turns(record: Record) -> list[dict[str, Any]]:
    """Return the contents of every turn, in the order of the prompts and with their call ids and arguments.

    A turn may lack its message (there was no reply) or its view (none was recorded). `sent` is the reply as later
    prompts hold it, where that is not what the model said.
    """
    contents: dict[int, dict[str, Any]] = defaultdict(lambda: {"items": []})
    for view in record.views:
        if purpose_of(view) == "compaction":
            continue  # a turn can have several questions, of which the page has the tokens alone
        kind = "request" if concerns_summary(view) else "view"
        contents[view["turn"]][kind] = {name: value for name, value in view.items() if name not in _LEFT_OUT}
        if (head := record.head_of[view["turn"]]) is not record.heads[0]:  # the host has changed its part
            contents[view["turn"]]["head"] = head["messages"]
    for shown_by, window, chosen in rewritten_prompts(record.events, [] if record.is_paper else record.turns):
        contents[shown_by["turn"]]["view"]["messages"] = _on_page(window, chosen)
    for summary in record.summaries:
        shown = {name: summary[name] for name in ("covers", "message", "text", "cut", "empty")}
        contents[summary["turn"]]["summary"] = shown
    for usage in record.usages:
        turn = contents[usage["turn"]]
        if purpose_of(usage) == "compaction":
            turn["questions"] = turn.get("questions", 0) + usage.get("prompt", 0) + usage.get("reply", 0)
            continue
        owner = turn["summary"] if concerns_summary(usage) else turn
        owner["usage"] = {name: usage.get(name) for name in ("reply", "overrun", "provider")}
        if "spent" in usage:
            turn["spent"] = usage["spent"]
    for choice in record.choices:
        contents[choice["turn"]]["choice"] = {"action": choice["action"], "fallback": choice["fallback"]}
    for number, reply in (record.sent_replies | record.replies).items():
        contents[number]["message"] = reply
    compacts, pinned = is_compacted(record.events), None
    for played in () if record.is_paper else record.turns:
        if compacts and played.manual != pinned:  # the newest notes
            pinned = contents[played.number]["pinned"] = played.manual
        if played.shown != played.assistant:
            contents[played.number]["sent"] = played.shown
    for number, seconds in record.seconds.items():
        contents[number]["seconds"] = round(seconds, 3)
    for event in record.messages:
        if event["by"] != "player":
            item = {"message": event["message"], "by": event["by"], "position": event.get("position")}
            contents[event["turn"]]["items"].append(item)
    for call in record.calls:
        contents[call["turn"]]["items"].append({"call": _call(call, compacts=compacts)})
    for turn in contents.values():
        turn["items"].sort(key=_place)
    return [contents[number] for number in range(max(contents, default=-1) + 1)]


def accounts(record: Record, turns: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the turns with the tokens of each and of the parts of its prompts, and why turns left.

    A record that has no accounts, or does not add up, has the turns alone.
    """
    counted = Accounts.of(record)
    if counted is None:
        return {"turns": turns, "departures": None}
    for view, parts in zip(record.views, counted.prompts(), strict=True):
        if purpose_of(view) == "compaction":
            continue
        if sum(parts) != view["tokens"]:
            return {"turns": turns, "departures": None}
        turns[view["turn"]]["request" if concerns_summary(view) else "view"]["parts"] = parts
    for turn, size in zip(turns, counted.sizes(), strict=False):
        turn["size"] = size
    return {"turns": turns, "departures": [asdict(departure) for departure in counted.departures()]}


def _on_page(window: ContextWindow, chosen: Selection) -> list[Any]:
    """Return what a compactor's prompt shows: rows of messages by their numbers, and its own as they are shown."""
    return [
        window.text(piece).message if isinstance(piece, Form) else [piece.start, piece.stop - 1]
        for piece in chosen.pieces
    ]


def _place(item: Mapping[str, Any]) -> float:
    """The position of an item in its turn: results in the order of their calls, everything else after them."""
    position = item["call"]["position"] if "call" in item else item["position"]
    return math.inf if position is None else position


_LEFT_OUT = ("event", "turn", "sha256", "chain")
"""Fields of a view that the page does not need: `check` compares hashes when the page is made."""


def _call(event: CallEvent, *, compacts: bool) -> dict[str, Any]:
    call = {name: event[name] for name in ("position", "name", "arguments", "text")}
    kept = {name: value for name, value in event["data"].items() if name != "state_hash"}
    if not BROUGHT_BACK.isdisjoint(kept):  # an answer of a tool of memory ages as the observation at its time does
        kept["date"] = kept["step"]
    if compacts and "manual" in kept:
        kept["manual"] = "result"  # and not a part of the system message
    return {**call, **kept, **({"is_error": True} if event["is_error"] else {})}


def check(record: Record) -> dict[str, Any]:
    """Rebuild every prompt and compare its sha256 with the record's; return their number, and those that differ."""
    views = record.views
    work = sum(
        view["step"] - view["first"] if record.is_paper else sum(last - first for first, last in view["turns"])
        for view in views
    )
    if work > MOST_REBUILT:
        return {"prompts": len(views), "differ": None}
    differ = [sent.turn for sent in record.sent_prompts() if sent.sha256 != sent.recorded_sha256]
    return {"prompts": len(views), "differ": differ}
