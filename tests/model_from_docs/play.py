"""Random episodes under random budgets, every prompt and every answer compared with the model's, to the byte."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import smartplay_tools as sp
from smartplay_tools.games import get_spec
from smartplay_tools.transcript import Event

from . import choosing
from .babble import BABBLE
from .counting import PRIMING, Counting
from .model import Expected, Model
from .refusals import in_numbers, is_refused
from .replies import Speaker

SMALL: tuple[str | sp.GameSpec, ...] = (
    BABBLE,
    "RockPaperScissorBasic-v0",
    "BanditTwoArmedHighLowFixed-v0",
    "Hanoi3Disk-v0",
    "MessengerL1-v0",
    "MessengerL2-v0",
    "MessengerL3-v0",
)
TOOLED = ("notes_tokens", "recall_tokens", "beyond_result", "memory_tokens")
"""The strategies that add a tool."""
OPEN: dict[str, Any] = {"history": 1, "result_tokens": 1_000}
"""Limits under which none of these is refused."""
FOREIGN = sp.ToolSpec(
    "weather", "Say what the weather is.", {"type": "object", "properties": {"x": {"type": "string"}}}
)


class Words:
    """One token a word."""

    name = "words"

    def count(self, text: str) -> int:
        """Count words."""
        return len(text.split())


class Characters:
    """One token a character."""

    name = "characters"

    def count(self, text: str) -> int:
        """Count characters."""
        return len(text)


TOKENIZERS: tuple[Any, ...] = ("o200k_base", "o200k_base", "approximate", Words(), Words(), Characters())


@dataclass
class Counts:
    """What was compared."""

    episodes: int = 0
    refused: int = 0
    prompts: int = 0
    requests: int = 0
    answers: int = 0
    ends: Counter[str] = field(default_factory=Counter)
    strategies: Counter[str] = field(default_factory=Counter)


def random_budget(rng: random.Random, head: int, form: str) -> dict[str, Any]:
    """Return a budget around a head of `head` tokens: caps, slack, history, strategies alone and together.

    `form` is of what observations are: a strategy for pictures is seldom asked for where they are words.
    """
    budget: dict[str, Any] = {}

    def sometimes(share: float, name: str, *values: Any) -> None:
        if rng.random() < share:
            budget[name] = rng.choice(values)

    sometimes(0.8, "prompt_tokens", *(head + room for room in (60, 150, 250, 400, 400, 700, 1_000, 1_500, 3_000)))
    sometimes(0.7, "history", None, 0, 1, 2, 3, 4, 6, 10)
    sometimes(0.5, "slack", 0.1, 0.25, 0.3, 0.5, 0.7, 0.9, 1.0)
    sometimes(0.6, "result_tokens", None, None, 5, 12, 20, 33, 50, 100)
    sometimes(0.2, "stalled_turns", None, 2, 4, 20)
    sometimes(0.1, "tool_calls", 3, 10, 40)
    sometimes(0.1, "reply_tokens", 5, 60)
    sometimes(0.15, "episode_tokens", head, head * 3, head * 20, head * 60)
    alone = rng.random() < 0.4
    strategies: list[tuple[str, tuple[Any, ...]]] = [
        ("beyond_history", ("mask",)),
        ("notes_tokens", (1, 5, 12, 40)),
        ("summary_tokens", (1, 5, 20, 60)),
        ("own_words", (0, 1, 2, 5, "never")),
        ("first_turns", (1, 2, 3, 8)),
        ("recall_tokens", (1, 8, 30, 60, 200)),
        ("beyond_result", ("offload",)),
        ("memory_tokens", (1, 8, 20, 60, 200)),
    ]
    if form != "text" or rng.random() < 0.02:
        strategies.append(("newest_pictures", (1, 2, 3, 6)))
    if alone:
        strategies = [rng.choice(strategies)]
    for name, values in strategies:
        if alone or rng.random() < 0.4:
            budget[name] = rng.choice(values)
    if rng.random() < 0.12:
        decide = ("beyond_history", "summary_tokens", "first_turns", "slack")
        budget = {name: value for name, value in budget.items() if name not in decide}
        budget["strategy"] = f"{choosing.NAME}:seed={rng.randrange(1_000)}"
    if budget.get("summary_tokens") and not budget.get("slack"):
        budget["slack"] = rng.choice((0.3, 0.5, 0.8))
    if budget.get("beyond_result") == "offload" and rng.random() < 0.8:
        budget["result_tokens"] = rng.choice((5, 8, 12, 20, 33))
    return budget


@dataclass
class _Setting:
    """What an episode is made of, drawn at random."""

    game: str | sp.GameSpec
    tokenizer: Any
    limits: dict[str, Any]
    rules: dict[str, Any]
    foreign: tuple[sp.ToolSpec, ...]
    n: Counting
    head: int

    def __str__(self) -> str:
        tokenizer = getattr(self.tokenizer, "name", self.tokenizer)
        foreign = ", a foreign tool" if self.foreign else ""
        return f"{get_spec(self.game).id}, {tokenizer}, {self.limits}, {self.rules}{foreign}"

    @classmethod
    def drawn(cls, rng: random.Random, seed: int, games: Sequence[str | sp.GameSpec]) -> _Setting:
        game, tokenizer = rng.choice(games), rng.choice(TOKENIZERS)
        manual, batch = rng.choice(("tool", "tool", "tool", "pinned", "none")), rng.choice(("all", "all", "first_act"))
        rules = {"manual": manual, "batch": batch}
        if game == "Crafter-v0":
            rules["observation"] = rng.choice(("text", "picture", "both"))
        probe = sp.Episode(game, seed=seed, tokenizer=tokenizer, **{**rules, "manual": "tool"})  # type: ignore[arg-type]
        n = Counting(probe.counter.text, probe.counter.image)
        head = n.messages(probe.head) + n.tools(probe.tools) + PRIMING
        foreign = (FOREIGN,) if rng.random() < 0.15 else ()
        limits = random_budget(rng, head, rules.get("observation", "text"))
        return cls(game, tokenizer, limits, rules, foreign, n, head)


def _begin(setting: _Setting, seed: int, record: list[Event]) -> tuple[sp.Conversation, Model] | None:
    """Begin an episode and its model, if the budget is not refused; it must be refused exactly where it should be."""
    spec, n, rules = get_spec(setting.game), setting.n, setting.rules
    picture = n.picture(252, 252) if rules.get("observation", "text") != "text" else 0
    budget = sp.Budget(**setting.limits)
    numbers = in_numbers(budget, spec, setting.head - PRIMING, picture)
    form = rules.get("observation", "text")
    tooled = [name for name in TOOLED if name in setting.limits and (name, form) != ("recall_tokens", "picture")]
    unlimited = sp.Budget(**{name: setting.limits[name] for name in tooled} | OPEN)
    tools = sp.Episode(setting.game, seed=seed, tokenizer=setting.tokenizer, budget=unlimited, **rules).tools
    try:
        episode = sp.Episode(
            setting.game, seed=seed, tokenizer=setting.tokenizer, budget=budget, transcript=record, **rules
        )
        conversation = sp.Conversation(episode, foreign_tools=setting.foreign)
    except sp.InvalidArgumentError as error:
        head = sp.Episode(setting.game, seed=seed, tokenizer=setting.tokenizer, **rules).head
        if not is_refused(numbers, n, head, (*tools, *setting.foreign), picture, form):
            raise AssertionError(f"{setting}: refused") from error
        return None
    assert not is_refused(numbers, n, episode.head, (*tools, *setting.foreign), picture, form), (
        f"{setting}: not refused"
    )
    assert episode.budget == numbers, f"{setting}: {episode.budget}, expected {numbers}"
    copy = spec.make()
    facts = {"head": episode.head, "tools": (*tools, *setting.foreign), "budget": numbers, "rollout": spec.rollout}
    facts |= {"picture": picture, "observation": form}
    return conversation, Model(copy, seed, {**facts, **rules}, n)


def play(seed: int, counts: Counts, games: Sequence[str | sp.GameSpec] = SMALL, most_turns: int = 60) -> list[Event]:
    """Play one random episode and compare everything; return its record, which is empty where the budget is refused."""
    rng = random.Random(seed)
    setting = _Setting.drawn(rng, seed, games)
    record: list[Event] = []
    begun = _begin(setting, seed, record)
    if begun is None:
        counts.refused += 1
        return []
    conversation, model = begun
    episode = conversation.episode
    where = f"seed {seed}, {setting}"
    counts.episodes += 1
    for name in sp.Budget(**setting.limits).strategies:
        counts.strategies[name] += 1
    speaker = Speaker(rng, model.tools, model.game.actions, FOREIGN.name)
    skips = model.budget.summary_tokens is model.budget.strategy is None and rng.random() < 0.1
    for turn in range(most_turns):
        prompt = None if skips and rng.random() < 0.5 else conversation.prompt()
        model.close_turn()
        expected = model.prompt()
        if expected is None:
            assert conversation.prompt() is None, f"{where}: turn {turn}: expected {model.end}"
            break
        assert skips or prompt is not None, f"{where}: turn {turn}: {episode.progress}"
        if prompt is not None:
            counts.prompts += 1
            if skips:  # it compares with the prompt that was taken last
                expected.prefix_messages = prompt.prefix_messages
            assert not model.window.wrong, f"{where}: turn {turn}: {model.window.wrong}"
            _compare(prompt, conversation, expected, f"{where}: turn {turn}")
        if expected.purpose == "summary":
            counts.requests += 1
            conversation.receive(reply := speaker.summary())
            model.receive(reply, (), {})  # type: ignore[arg-type]
            continue
        results = conversation.receive(speaker.reply())
        counts.answers += len(results)
        speaker.heard += [word for result in results for word in result.text.split()]
        wrong = _follow(conversation, model, results, setting.foreign, rng)
        assert not wrong, f"{where}: turn {turn}: " + "; ".join(wrong)
    _compare_totals(episode, model, where)
    episode.close()
    counts.ends[str(episode.progress.end_reason)] += 1
    return record


def _follow(
    conversation: sp.Conversation,
    model: Model,
    results: Sequence[sp.ToolResult],
    foreign: Sequence[sp.ToolSpec],
    rng: random.Random,
) -> list[str]:
    """Let the model follow a reply, add what the host adds, and return what is wrong."""
    latest = conversation.message
    assert latest is not None
    foreign_results = {tool.name: "sunny" for tool in foreign}
    wrong = model.receive(latest, results, foreign_results)
    for call in latest.get("tool_calls", ()):
        if (content := foreign_results.get(call["function"]["name"])) is not None:
            conversation.add({"role": "tool", "tool_call_id": call["id"], "content": content})
    if rng.random() < 0.05 and conversation.progress.end_reason is None:
        conversation.add(message := {"role": "user", "content": "Go on. 🂡"})
        model.add(message)  # type: ignore[arg-type]
    return wrong


def replay_is_identical(record: Sequence[Event]) -> bool:
    """Replay the record of an episode that was played here, of a game that is known by its name."""
    own = {tokenizer.name: tokenizer for tokenizer in TOKENIZERS if not isinstance(tokenizer, str)}
    words, _, _ = record[0]["config"].get("tokenizer", "").partition("+")  # behind it is a rule that counts pictures
    return sp.replay(record, tokenizer=own.get(words)).identical


def _compare(prompt: sp.Prompt, conversation: sp.Conversation, expected: Expected, where: str) -> None:
    view = conversation.view
    assert view is not None
    numbers = {
        "purpose": (prompt.purpose, expected.purpose),
        "tokens": (view.tokens, expected.tokens),
        "dropped_turns": (view.dropped_turns, expected.dropped_turns),
        "shown_steps": (view.shown_steps, expected.shown_steps),
        "prefix_tokens": (view.prefix_tokens, expected.prefix_tokens),
        "prefix_messages": (prompt.prefix_messages, expected.prefix_messages),
        "max_tokens": (prompt.max_tokens, expected.max_tokens),
    }
    wrong: dict[str, Any] = {name: pair for name, pair in numbers.items() if pair[0] != pair[1]}
    shown, wanted = (list(map(_as_text, messages)) for messages in (prompt.messages, expected.messages))
    if shown != wanted:
        at = next(
            (i for i, (a, b) in enumerate(zip(shown, wanted, strict=False)) if a != b), min(len(shown), len(wanted))
        )
        wrong["messages"] = (len(shown), len(wanted))
        wrong[f"message {at}"] = (shown[at : at + 2], wanted[at : at + 2])
    assert not wrong, f"{where}: (shown, expected) {wrong}"


def _as_text(message: sp.Message) -> str:
    return json.dumps(message, sort_keys=True)


def _compare_totals(episode: sp.Episode, model: Model, where: str) -> None:
    stats, totals = episode.stats, model.totals
    names = ("prompt", "reply", "prefix", "overruns", "summary_prompt", "summary_reply")
    wrong = {name: (getattr(stats.tokens, name), getattr(totals, name)) for name in names}
    counted = ("illegal_actions", "malformed_calls", "refused_calls", "idle_replies", "cut_results", "refused_notes")
    more = ("refused_memory", "recalls", "pages", "summaries", "cut_summaries", "empty_summaries")
    wrong |= {name: (getattr(stats, name), totals.counts.get(name, 0)) for name in (*counted, *more)}
    wrong |= {"steps": (stats.steps, model.steps), "tool_calls": (stats.tool_calls, model.tool_calls)}
    if model.end is not None:
        wrong["end"] = (episode.progress.end_reason, model.end)
    wrong = {name: pair for name, pair in wrong.items() if pair[0] != pair[1]}
    assert not wrong, f"{where}: (counted, expected) {wrong}"
