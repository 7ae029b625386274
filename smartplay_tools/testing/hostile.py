"""Hostile episodes: random replies of every kind under random caps, and a judge of every prompt that is sent."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from typing import Any

from smartplay_tools.context.prompts.wording import in_any_version
from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.episode.budgets import refused_strategy
from smartplay_tools.episode.episode import Episode
from smartplay_tools.games.specs import get_spec
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import TOOL_NAMES, Budget, Prompt
from smartplay_tools.types.messages import Message

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0", "Hanoi3Disk-v0")
ARGUMENTS = (
    '{"action": "1"}',
    '{"action": "2."}',
    "{}",
    "",
    "{",
    "null",
    '{"action": "fly"}',
    '{"text": "one two"}',
    '{"query": "step 1"}',
    '{"query": "0-9"}',
    '{"page": "r1.2"}',
    '{"command": "create", "path": "/memories/a", "file_text": "one two"}',
    '{"command": "view", "path": "/memories"}',
)
WORDS = (None, "", "Let me see.", "word " * 60, "\ud83d\ude00 é\u0301")


class Judge:
    """Judges the prompts of one episode by the rules that hold under every strategy."""

    def __init__(self, conversation: Conversation) -> None:
        self._conversation = conversation
        self._step_of: dict[str, int] = {}
        """The observations that results show, by the ids of their calls."""

    def take(self) -> None:
        """Take note of the results of the latest reply."""
        turn = self._conversation.latest_turn
        for item in () if turn is None else turn.items:
            if item.observation_step is not None:
                self._step_of[item.message["tool_call_id"]] = item.observation_step

    def judge(self, prompt: Prompt) -> None:
        """Raise an `AssertionError` if a prompt is too long, breaks a turn, or does not show what it has to."""
        episode, view = self._conversation.episode, self._conversation.view
        cap, history = episode.budget.prompt_tokens, episode.budget.history
        tokens = episode.counter.prompt(prompt.messages, prompt.tools)
        require(view is not None and tokens == view.tokens, f"a prompt has {tokens} tokens, not those that it says")
        require(cap is None or tokens <= cap, f"a prompt has {tokens} tokens under a cap of {cap}")
        _require_pairs(prompt.messages)
        shown = {
            self._step_of[message["tool_call_id"]]
            for message in prompt.messages
            if message.get("tool_call_id") in self._step_of
            and message["content"] not in in_any_version("observation_left")
        }
        if prompt.purpose != "play" or not self._step_of:
            return
        newest = max(self._step_of.values())
        oldest = min(shown, default=newest)
        require(history is None or oldest >= newest - history, "a prompt shows an observation that is too old")
        if episode.ledger.strategies.compacts:
            return  # it may forget whatever it wants
        require(newest in shown, "a prompt does not show the newest observation")
        replies = [message for message in prompt.messages if message["role"] == "assistant"]
        latest = self._conversation.latest_turn
        require(latest is not None and replies[-1] == latest.shown, "a prompt does not show the newest turn")


def hostile_episode(budget: Budget, number: int) -> list[Event]:
    """Play a random episode under a strategy, judge every prompt, and return its record."""
    chance = random.Random(f"hostile {number}")
    events: list[Event] = []
    with Episode(**_episode(chance, budget), transcript=events) as episode:
        conversation = Conversation(episode)
        judge = Judge(conversation)
        for _ in range(chance.choice([14, 14, 40])):
            prompt = conversation.prompt()
            if prompt is None:
                break
            judge.judge(prompt)
            conversation.receive(_reply(chance, prompt))
            judge.take()
            if prompt.purpose == "play" and chance.random() < 0.2:
                conversation.add({"role": "user", "content": "Go on."})
        conversation.prompt()
    require(episode.end_reason != "strategy_error", f"{episode.result and episode.result.error}")
    recorded: list[Event] = json.loads(json.dumps(events))
    return recorded


def require(holds: bool, sentence: str) -> None:
    """Raise an `AssertionError` with a sentence unless something holds."""
    if not holds:
        raise AssertionError(f"{sentence[0].upper()}{sentence[1:].removesuffix('.')}.")


def _episode(chance: random.Random, budget: Budget) -> dict[str, Any]:
    """Draw a setting and the caps that the budget leaves open, near the smallest prompt, where they have an effect."""
    while True:
        game = chance.choice(GAMES)
        with Episode(game, seed=0) as episode:
            head = episode.counter.prompt(episode.head, episode.tools)
        caps = (budget.notes_tokens, budget.summary_tokens, budget.recall_tokens)
        reserve = 2 * sum(cap or 0 for cap in caps) + 250
        drawn = {
            "history": chance.choice([None, 0, 1, 2, 5]),
            "prompt_tokens": chance.choice([None, head + reserve + chance.randrange(600)]),
            "result_tokens": chance.choice(["auto", 30, 60]),
            "stalled_turns": chance.choice([None, 3, 10]),
        }
        given = budget.model_dump(exclude_unset=True)
        made = Budget(**{**drawn, **given})
        if refused_strategy(made, get_spec(game), context="window") is None:
            return {"game": game, "seed": chance.randrange(99), "budget": made}


def _reply(chance: random.Random, prompt: Prompt) -> Message:
    if prompt.purpose != "play":
        return {"role": "assistant", "content": chance.choice(WORDS)}
    added = [tool.name for tool in prompt.tools if tool.name not in TOOL_NAMES]
    names = ["act", "act", "act", "observe", "read_manual", "fly", *added]
    calls = [
        {
            "id": chance.choice(["a", "b", ""]),
            "type": "function",
            "function": {"name": chance.choice(names), "arguments": chance.choice(ARGUMENTS)},
        }
        for _ in range(chance.choice([0, 1, 1, 1, 2, 3]))
    ]
    reply: Message = {"role": "assistant", "content": chance.choice(WORDS)}
    if calls:
        reply["tool_calls"] = calls  # type: ignore[typeddict-item]
    return reply


def _require_pairs(messages: Sequence[Message]) -> None:
    """Require that every call is followed by its result, and every result answers a call before it."""
    waiting: list[str] = []
    for message in messages:
        if message["role"] == "tool":
            require(message["tool_call_id"] in waiting, "a prompt has a result without its call")
            waiting.remove(message["tool_call_id"])
        else:
            require(not waiting, "a prompt has a call without its result")
            waiting = [call["id"] for call in message.get("tool_calls") or ()]
    require(not waiting, "a prompt has a call without its result")
