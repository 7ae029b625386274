"""The edits of providers at random, judged: `python -m tests.provider_edits_judge --histories 20000 --seed 0`.

Two episodes are played with the same replies. One has an edit and a cap; the other shows everything, and what the edit
has to make of it is decided here from the providers' public definitions (docs/provider-edits.md) and from
`tests/counting.py`, without code of the package. Every prompt is a history: it has to be what was decided, to the
token, or under a cap its newest part, with whole pairs of calls and results, and never longer than the cap.
"""

from __future__ import annotations

import argparse
import json
import random
from collections import Counter
from typing import Any

import smartplay_tools as sp
from smartplay_tools.context.strategies.custom import load_strategy
from smartplay_tools.players.prompt_reading import call
from smartplay_tools.records import replay
from tests.counting import Json, message_tokens, tools_tokens
from tests.scripts import GAMES, Words

COUNT = Words().count
TOOLS = ("act", "observe", "act", "act", "unknown")
WORDS = (None, "", "He likes Rock.", "word " * 30)
SUMMARIES = ("He likes Rock.", "so <summary>He likes\nRock.</summary> yes", "<summary> </summary>", "", "<summary>Cut")
MEANT = ("He likes Rock.", "He likes\nRock.", "", "", "Cut")
THOUGHTS: tuple[Json, ...] = (
    {},
    {"reasoning_content": "He likes Rock."},
    {"provider_items": [{"type": "thinking", "thinking": "So Paper.", "signature": "s"}]},
    {"provider_items": [{"type": "reasoning", "summary": [], "encrypted_content": "opaque"}]},
)
BEFORE = "A summary stands in place of the conversation before this message:\n"


USES, THINKING, BOTH = "clear_tool_uses_20250919", "clear_thinking_20251015", "context_management"


def edit(chance: random.Random, least: int) -> tuple[str, Json]:
    """Draw an edit with its options."""
    trigger = least + chance.choice([0, 60, 150, 400, 900])
    kind = chance.choice([USES, USES, THINKING, BOTH, "compact_20260112", "compaction"])
    if kind == "compaction":
        return kind, {"compact_threshold": trigger}
    if kind in (THINKING, BOTH):
        turns: list[Json] = [{"keep": {"type": "thinking_turns", "value": number}} for number in (1, 2)]
        kept: Json = chance.choice([{}, {"keep": "all"}, *turns])
        if kind == THINKING:
            return kind, kept
        name, uses = edit(chance, least)
        while name != USES:
            name, uses = edit(chance, least)
        if isinstance(uses["trigger"], int):  # in the provider's list it is an object
            uses["trigger"] = {"type": "input_tokens", "value": uses["trigger"]}
        return kind, {"edits": [{"type": THINKING, **kept}, {"type": USES, **uses}]}
    options: Json = {"trigger": trigger}
    if kind == "compact_20260112":
        return kind, options | chance.choice([{}, {"instructions": "Say what matters."}])
    if chance.random() < 0.3:
        options["trigger"] = {"type": "tool_uses", "value": chance.choice([1, 2, 5])}
    if chance.random() < 0.8:
        options["keep"] = {"type": "tool_uses", "value": chance.choice([0, 1, 2, 4])}
    if chance.random() < 0.4:
        options["clear_at_least"] = {"type": "input_tokens", "value": chance.choice([1, 40, 200])}
    options["exclude_tools"] = chance.choice([None, [], ["observe"], ["act", "unknown"]])
    options["clear_tool_inputs"] = chance.choice([None, False, True, [], ["act"], ["observe"]])
    return kind, options


class Judge:
    """What an edit has to make of an episode's messages."""

    def __init__(self, kind: str, options: Json, tools: list[Json]) -> None:
        self.kind, self.options, self.tools = kind, options, tools
        self.kept: list[Json] = []
        self.covered = 0
        """What stands in place of the first messages, and how many these are."""

    def tokens(self, messages: list[Json]) -> int:
        return 3 + tools_tokens(self.tools, COUNT) + sum(message_tokens(message, COUNT) for message in messages)

    def now(self, every: list[Json]) -> list[Json]:
        """The conversation after its system message."""
        return self.kept + every[1 + self.covered :]

    def edited(self, every: list[Json]) -> list[Json]:
        """The messages after the edits."""
        if self.kind == BOTH:
            thinking, uses = self.options["edits"]
            every = Judge(THINKING, thinking, self.tools).edited(every)
            return Judge(USES, uses, self.tools).edited(every)
        return {USES: self.cleared, THINKING: self.without_thoughts}.get(self.kind, self.current)(every)

    def current(self, every: list[Json]) -> list[Json]:
        return [every[0], *self.now(every)]

    def without_thoughts(self, every: list[Json]) -> list[Json]:
        """The messages with the thoughts of old turns cleared; the words of a user end a turn."""
        if self.options.get("keep") == "all":
            return every
        keep, turns = self.options.get("keep", {"value": 1})["value"], list[list[Json]]()
        made = json.loads(json.dumps(every))
        for message in made:
            if message["role"] == "user" or not turns:
                turns.append([])
            turns[-1].append(message)
        thinking = [turn for turn in turns if any(FIELDS & message.keys() for message in turn)]
        for message in (message for turn in thinking[:-keep] for message in turn):
            for field in FIELDS:
                message.pop(field, None)
        return made if self.tokens(made) < self.tokens(every) else every

    def is_over(self, every: list[Json]) -> bool:
        trigger: Any = self.options.get("trigger", self.options.get("compact_threshold"))
        if isinstance(trigger, dict) and trigger["type"] == "tool_uses":
            return [message["role"] for message in every].count("tool") > int(trigger["value"])
        return self.tokens([every[0], *self.now(every)]) > int(
            trigger["value"] if isinstance(trigger, dict) else trigger
        )

    def cleared(self, every: list[Json]) -> list[Json]:
        """The messages with old tool uses cleared."""
        if not self.is_over(every):
            return every
        of = {each["id"]: each["function"]["name"] for message in every for each in message.get("tool_calls", ())}
        uses = [message["tool_call_id"] for message in every if message["role"] == "tool"]
        keep = self.options.get("keep", {"value": 3})["value"]
        gone = set(uses[: len(uses) - keep if keep < len(uses) else 0])
        gone = {use for use in gone if of[use] not in (self.options["exclude_tools"] or [])}
        made = json.loads(json.dumps(every))
        for message in made:
            if message.get("tool_call_id") in gone:
                message["content"] = "[cleared]"
            for each in message.get("tool_calls", ()):
                inputs = self.options["clear_tool_inputs"]
                if each["id"] in gone and (inputs is True or (inputs and each["function"]["name"] in inputs)):
                    each["function"]["arguments"] = "{}"
        saved = self.tokens(every) - self.tokens(made)
        least = (self.options.get("clear_at_least") or {"value": 0})["value"]
        return made if saved > 0 and saved >= least else every

    def question(self, every: list[Json]) -> list[Json] | None:
        """The history of the question for a summary; None if none is due."""
        return self.now(every) if self.kind in ("compact_20260112", "compaction") and self.is_over(every) else None

    def summarised(self, every: list[Json], summary: str) -> None:
        if not summary:
            return
        users = [each for each in self.now(every) if each["role"] == "user" and not is_summary(each)]
        self.kept = [*(users if self.kind == "compaction" else []), {"role": "user", "content": BEFORE + summary}]
        self.covered = len(every) - 1


FIELDS = {"reasoning_content", "provider_items"}
"""The fields of thoughts."""


def is_summary(message: Json) -> bool:
    return isinstance(message["content"], str) and message["content"].startswith(BEFORE)


def plain(message: Any) -> Json:
    """What of a message a provider reads; ids that the window has replaced stay."""
    fields = ("role", "content", "tool_calls", "tool_call_id", *FIELDS)
    made: Json = {name: message[name] for name in fields if message.get(name) not in (None, [])}
    return {**made, "content": made.get("content") or ""}


def is_too_long(judge: Judge, every: list[Json], cap: int | None) -> bool:
    """Whether the newest turn does not fit beside the system message and the task."""
    newest = max((at for at, message in enumerate(every) if message["role"] == "assistant"), default=2)
    return cap is not None and judge.tokens(every[:2] + every[newest:]) > cap


def check_pairs(messages: list[Json]) -> None:
    waiting: list[str] = []
    for message in messages:
        if message["role"] == "tool":
            waiting.remove(message["tool_call_id"])
        else:
            assert not waiting
            waiting = [each["id"] for each in message.get("tool_calls", ())]
    assert not waiting


def play(seed: int, found: Counter[str]) -> None:
    """Play one episode with an edit, and judge its prompts."""
    chance = random.Random(f"provider edits {seed}")
    game, result_tokens = chance.choice(GAMES), chance.choice([None, 60])
    given: Json = {"history": None, "result_tokens": result_tokens, "stalled_turns": None}
    options: Json = {"seed": seed, "tokenizer": Words(), "manual": "pinned"}
    whole = sp.Conversation(sp.Episode(game, budget=sp.Budget(**given), **options))
    least = whole.episode.counter.prompt(whole.episode.head, whole.episode.tools)
    kind, parameters = edit(chance, least)
    judge = Judge(kind, parameters, [tool.to_json() for tool in whole.episode.tools])
    cap = chance.choice([None, least + 250, least + 600, least + 2000])
    sp.register_strategy(f"edit-{seed}", lambda: load_strategy(kind).make(**parameters))
    budget = sp.Budget(**given, prompt_tokens=cap, question_tokens=100_000, strategy=f"edit-{seed}")
    record: list[Any] = []
    edited = sp.Conversation(sp.Episode(game, budget=budget, transcript=record, **options))
    for _ in range(chance.randrange(4, 30)):
        every = [plain(message) for message in getattr(whole.prompt(), "messages", ())]
        prompt = edited.prompt()
        if not every or prompt is None:
            assert not every or is_too_long(judge, every, cap), "The episode ends although the newest turn fits."
            found["too long" if every else "games that were over"] += 1
            break
        found["histories"] += 1
        asked = judge.question(every)
        if prompt.purpose != "play":
            assert asked is not None, "A question is asked too early."
            messages = [plain(message) for message in prompt.messages]
            assert messages[:-1] == asked
            if "instructions" in parameters:
                assert messages[-1]["content"] == parameters["instructions"]
            pick = chance.randrange(len(SUMMARIES))
            edited.receive({"role": "assistant", "content": SUMMARIES[pick]})
            judge.summarised(every, MEANT[pick])
            found["summaries"] += bool(MEANT[pick])
            prompt = edited.prompt()
        else:
            assert asked is None, "No question is asked."
        if prompt is None:
            assert is_too_long(judge, every, cap), "The episode ends although the newest turn fits."
            found["too long"] += 1
            break
        wanted = judge.edited(every)
        found[f"cleared by {kind}"] += wanted is not every and kind in (USES, THINKING, BOTH)
        messages = [plain(message) for message in prompt.messages]
        check_pairs(messages)
        view = edited.view
        assert view is not None
        assert view.tokens == judge.tokens(messages)
        assert cap is None or view.tokens <= cap
        if cap is None or judge.tokens(wanted) <= cap:
            assert messages == wanted
        else:
            found["cut to the cap"] += 1
            rest = iter(wanted if every[1] in wanted else [every[0], every[1], *wanted[1:]])
            assert all(message in rest for message in messages), "What is shown is not a part in its order."
            assert messages[-1] == wanted[-1]
        reply = draw(chance)
        whole.receive(reply)
        edited.receive(reply)
    edited.episode.close()
    replayed = replay(record, tokenizer=Words())
    assert replayed.identical, replayed.differences


def draw(chance: random.Random) -> sp.Message:
    calls = [call(chance.choice(TOOLS), say=chance.choice(WORDS), action="1") for _ in range(chance.choice([1, 1, 3]))]
    for each in calls:
        if each["tool_calls"][0]["function"]["name"] == "observe":
            each["tool_calls"][0]["function"]["arguments"] = "{}"
    message = {**calls[0], "tool_calls": [each["tool_calls"][0] for each in calls]}
    if chance.random() < 0.2:
        message = {"role": "assistant", "content": chance.choice(WORDS)}
    return message | chance.choice(THOUGHTS)  # type: ignore[return-value]


def main(histories: int, seed: int = 0) -> Counter[str]:
    """Judge at least this many histories."""
    found: Counter[str] = Counter()
    while found["histories"] < histories:
        play(seed, found)
        found["episodes"] += 1
        seed += 1
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--histories", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    print(dict(main(chosen.histories, chosen.seed)))
