"""What a model still saw of the observations and rules that it needed, counted from the record of an episode.

A game may say which observations its next right action depends on, and which actions break its rules (`TextGame.needs`,
`breaks`). Both are on record with each action and were never shown, so they measure what the window, a strategy or a
compactor has kept, whoever played.

An observation is visible in a prompt if the prompt holds the message that shows it, unchanged and not masked. An
*eviction* is a prompt that lacks an observation which the prompt before it showed. An answer is right if its action has
a positive reward.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import CallEvent
from smartplay_tools.types import MEMORY_TOOL, PAGES_TOOL, RECALL_TOOL
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import text_of

Shares = dict[str, list[int]]
"""By name, how many of how many."""

EVICTIONS: Mapping[int, str] = {8: "8+", 4: "4-7", 2: "2-3", 1: "1", 0: "0"}
"""The groups of answers, by the fewest evictions that the needed observation has survived."""

SEEN, UNSEEN, LOOKED, RULED, UNRULED = "in view", "out of view", "looked", "rules", "rules lost"
"""Right answers whose needed observations were all visible, and others; of the others those before which a tool was
asked; actions that broke no rule while the manual was visible, and after it had left."""

LOOKING = frozenset({RECALL_TOOL, PAGES_TOOL, MEMORY_TOOL})
"""The tools that bring back what has left the view."""


@dataclass(frozen=True)
class _Visible:
    """What a prompt showed."""

    steps: frozenset[int]
    """Its observations."""
    manual: bool | None
    """Whether it held the manual; None before the manual was read."""
    evictions: int
    """How many there have been, this prompt included."""


def remembered(record: Record) -> Shares | None:
    """Return the shares of an episode; None if its game declares nothing, or its prompts are not on record."""
    if not record.declares or record.is_paper or not record.views:
        return None
    first: dict[int, int] = {}
    shown = dict(_prompts(record, first))
    can_look = any(tool["function"]["name"] in LOOKING for tool in record.tools)
    shares: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])

    def count(name: str, holds: bool) -> None:
        shares[name][0] += holds
        shares[name][1] += 1

    has_looked = False
    for call in record.calls:
        has_looked |= _looks(call)
        data, prompt = call["data"], shown[call["turn"]]
        if "reward" not in data:
            continue
        if needs := data.get("needs"):
            is_right, is_seen = data["reward"] > 0, prompt.steps.issuperset(needs)
            count(SEEN if is_seen else UNSEEN, is_right)
            if can_look and not is_seen:
                count(LOOKED, has_looked)
            if all(step in first for step in needs):
                survived = prompt.evictions - min(first[step] for step in needs)
                count(next(name for least, name in EVICTIONS.items() if survived >= least), is_right)
        if data.get("breaks") and prompt.manual is not None:
            count(RULED if prompt.manual else UNRULED, data["action"] not in data["breaks"])
        has_looked = False
    return dict(shares)


def _looks(call: CallEvent) -> bool:
    if call["name"] == MEMORY_TOOL:
        return (read(call["arguments"]).values or {}).get("command") == "view"
    return call["name"] in LOOKING


def _prompts(record: Record, first: dict[int, int]) -> Iterator[tuple[int, _Visible]]:
    """Yield what the prompts of an episode showed, with the turns to which they led.

    `first` gets the evictions there had been when each observation was first shown.
    """
    originals = {
        item.message["tool_call_id"]: (item.observation_step, text_of(item.message))
        for turn in record.turns
        for item in turn.items
        if item.observation_step is not None and "tool_call_id" in item.message
    }
    manual = next((call for call in record.calls if call["data"].get("manual")), None)
    before: frozenset[int] = frozenset()
    evictions = 0
    for sent in record.sent_prompts():
        if sent.prompt.purpose != "play":
            continue
        results = [message for message in sent.prompt.messages if message["role"] == "tool"]
        found = (originals.get(message["tool_call_id"], (-1, None)) for message in results)
        pairs = zip(found, results, strict=True)
        steps = frozenset(step for (step, text), message in pairs if text == text_of(message))
        evictions += not before <= steps
        before = steps
        for step in steps:
            first.setdefault(step, evictions)
        told: bool | None = None
        if record.config.manual == "pinned":
            told = True
        elif manual is not None and sent.turn > manual["turn"]:
            told = any(manual["text"] in text_of(message) for message in sent.prompt.messages)
        yield sent.turn, _Visible(steps, told, evictions)
