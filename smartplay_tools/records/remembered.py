"""What a model still saw of the observations and rules that it needed, counted from the record of an episode.

A game may say which observations its next right action depends on, and which actions break its rules (`TextGame.needs`,
`breaks`). Both are on record with each action and were never shown, so they measure what the window, a strategy or a
compactor has kept, whoever played.

What is needed is in view if it stands in the prompt, wherever that is (`records.contents`): as an observation, in the
model's own words, in a summary or in a memory. Where a prompt shows neither the newest observation nor its words, all
is out of view: what is asked cannot be told. An *eviction* is a prompt that lacks an observation, unchanged and not
masked, which the prompt before it showed. An answer is right if its action has a positive reward.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from smartplay_tools.players.prompt_reading import first_observation
from smartplay_tools.records.contents import NOWHERE, PLACES, Places
from smartplay_tools.records.prompts import SentPrompt
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import CallEvent
from smartplay_tools.types import MEMORY_TOOL, PAGES_TOOL, RECALL_TOOL
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import text_of

Shares = dict[str, list[int]]
"""By name, how many of how many."""

EVICTIONS = ((0, "0"), (1, "1"), (2, "2-3"), (4, "4-7"), (8, "8+"))
"""The groups of answers, by the fewest evictions that the needed observation has survived."""

SEEN, UNSEEN, LOOKED, RULED, UNRULED = "in view", "out of view", "looked", "rules", "rules lost"
"""Right answers for which all that is needed stood in the prompt, and others; of the others those before which a tool
was asked; actions that broke no rule while the manual was visible, and after it had left."""

IN_PLACE = "in view: "
"""Begins the names of the right answers of each place. With several contents, it is that of the last of `PLACES`."""

LOOKING = frozenset({RECALL_TOOL, PAGES_TOOL, MEMORY_TOOL})
"""The tools that bring back what has left the view."""


@dataclass(frozen=True)
class _Visible:
    """What a prompt showed."""

    sent: SentPrompt
    steps: frozenset[int]
    """The observations that it showed."""
    manual: bool | None
    """Whether it held the manual; None before the manual was read."""
    evictions: int
    """How many there have been, this prompt included."""
    newest: int
    """The newest observation before it, which the model is asked about."""


@dataclass(frozen=True)
class Answer:
    """An action that a game says something about, with what its prompt held."""

    turn: int
    position: int
    """That of its call in the turn."""
    places: dict[int, str]
    """Where what it needs stood, by the steps that showed it: one of `PLACES`. Empty if it needed nothing."""
    is_right: bool
    has_looked: bool
    survived: int | None
    """The evictions that the oldest needed observation had survived; None if one was never shown."""
    manual: bool | None
    keeps_rules: bool | None
    """None if no action would have broken a rule."""

    @property
    def place(self) -> str:
        """The place of all that it needs: the last one in the order of `PLACES`."""
        return max(self.places.values(), key=PLACES.index)


def answers(record: Record) -> list[Answer]:
    """Return every action about which the game declares something; none if the prompts are not on record."""
    if not record.declares or record.is_paper or not record.views:
        return []
    first: dict[int, int] = {}
    shown, places = dict(_prompts(record, first)), Places(record)
    observed = {
        step: call["text"] for call in record.calls if (step := call["data"].get("observation_step")) is not None
    }
    said = Counter(observed.values())
    contents = {step: text if said[text] == 1 else None for step, text in observed.items()}
    has_looked, found = False, []
    for call in record.calls:
        has_looked |= _looks(call)
        data, prompt = call["data"], shown[call["turn"]]
        if "reward" not in data:
            continue
        needs, breaks = data.get("needs") or (), data.get("breaks")
        contents |= {int(step): text for step, text in data.get("contents", {}).items()}
        never_shown = any(step not in first for step in needs)
        stood = places.of(prompt.sent, prompt.steps, {step: contents.get(step) for step in needs})
        asked = {prompt.newest: observed[prompt.newest]} if needs and prompt.newest in observed else {}
        if NOWHERE in places.of(prompt.sent, prompt.steps, asked).values():
            stood = dict.fromkeys(needs, NOWHERE)
        found += [
            Answer(
                turn=call["turn"],
                position=call["position"],
                places=stood,
                is_right=data["reward"] > 0,
                has_looked=has_looked,
                survived=None if never_shown or not needs else prompt.evictions - min(first[step] for step in needs),
                manual=prompt.manual,
                keeps_rules=data["action"] not in breaks if breaks else None,
            )
        ]
        has_looked = False
    return found


def remembered(record: Record) -> Shares | None:
    """Return the shares of an episode; None if its game declares nothing, or its prompts are not on record."""
    if not record.declares or record.is_paper or not record.views:
        return None
    can_look = any(tool["function"]["name"] in LOOKING for tool in record.tools)
    shares: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])

    def count(name: str, holds: bool) -> None:
        shares[name][0] += holds
        shares[name][1] += 1

    for answer in answers(record):
        if answer.places:
            is_seen = answer.place != NOWHERE
            count(SEEN if is_seen else UNSEEN, answer.is_right)
            if is_seen:
                count(IN_PLACE + answer.place, answer.is_right)
            if can_look and not is_seen:
                count(LOOKED, answer.has_looked)
        if answer.survived is not None:
            count([name for least, name in EVICTIONS if answer.survived >= least][-1], answer.is_right)
        if answer.keeps_rules is not None and answer.manual is not None:
            count(RULED if answer.manual else UNRULED, answer.keeps_rules)
    return dict(shares)


def _looks(call: CallEvent) -> bool:
    if call["name"] == MEMORY_TOOL:
        return (read(call["arguments"]).values or {}).get("command") == "view"
    return call["name"] in LOOKING


def _prompts(record: Record, first: dict[int, int]) -> Iterator[tuple[int, _Visible]]:
    """Yield what the prompts of an episode showed, with the turns to which they led.

    `first` gets the evictions there had been when each observation was first shown.
    """
    turns = record.turns
    originals = {
        item.message["tool_call_id"]: (item.observation_step, text_of(item.message))
        for turn in turns
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
        if record.config.first_observation == "prompt" and any(map(first_observation, sent.prompt.messages)):
            steps |= {0}
        evictions += not before <= steps
        before = steps
        for step in steps:
            first.setdefault(step, evictions)
        told: bool | None = None
        if record.config.manual == "pinned":
            told = True
        elif manual is not None and sent.turn > manual["turn"]:
            told = any(manual["text"] in text_of(message) for message in sent.prompt.messages)
        yield sent.turn, _Visible(sent, steps, told, evictions, turns[sent.turn - 1].step if sent.turn else -1)
