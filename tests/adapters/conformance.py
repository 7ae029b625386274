"""One conversation for every adapter: the script, a model that replies with it, and the expected results.

An adapter joins with a module of rows in `rows`, where `test_conformance.py` finds it, or for frameworks
`test_framework_conformance.py`. A row that owns its context
(`Window`) has the framework's own runner play the script, and returns what its model was sent. A row whose host owns
the context (`Host`) opens episodes in whatever way the framework has, and hands out a function for each that makes one
call. Nothing else is said of an adapter, so nothing else can be asked of it: every row is held to everything.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import re
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import pytest

import smartplay_tools as sp
from smartplay_tools.players import ModelPlayer
from smartplay_tools.players.conversion import function_call
from smartplay_tools.records.replays import comparable
from tests import checker

GAME, SEED = "Hanoi3Disk-v0", 7
WAY = ["A->C", "A->B", "C->B", "A->C", "B->A", "B->C", "A->C"]
"""The seven moves that solve it."""

Script = list[sp.Message]
Replies = Iterable[sp.Message]
"""What a model says, reply by reply."""


class Received(NamedTuple):
    """What a model was sent, in canonical form."""

    messages: Sequence[dict[str, Any]]
    tools: list[tuple[str, str, Any]]
    """Name, description and schema of each."""
    cap: int | None
    """The cap on the reply."""


Sent = list[Received]

EACH = sp.Usage(prompt=100, reply=7, cached=40)
"""What each reply of a model costs, as its provider reports it."""


class Held(NamedTuple):
    """How an episode was played."""

    sent: Sent
    usage: sp.Usage | None = None
    """The usage that the host was told; None if it is told none."""
    words: str = ""
    """The latest words that the host got from us in the model's place."""


class Hold(Protocol):
    """How an adapter plays an episode to its end with a model that says what a script says.

    `own_cap` is a cap on replies that the adapter's user has set, as its framework has users set one. `situation` is
    one of `situations.SITUATIONS` that the row does not lack, or nothing.
    """

    def __call__(
        self, episode: sp.Episode, script: Replies, /, *, own_cap: int | None = None, situation: str = ""
    ) -> Held: ...


@dataclass(frozen=True)
class Window:
    """An adapter that manages the context."""

    hold: Hold
    through: str
    """How its line in `docs/interfaces.md` begins."""
    broken_json: bool = True
    """Whether its format can transport arguments that are not JSON."""
    lacks: Mapping[str, str] = field(default_factory=dict)
    """The situations into which its host cannot get, and why."""
    refuses: Mapping[str, str] | None = None
    """With which words its user is refused a request that is not for a move; None if it is answered."""
    slow: bool = False
    """Whether only the slow tests play it, because it needs servers or repeats another row on an event loop."""
    repeats: bool = False
    """Whether it differs from another row in its wire or event loop alone, and is held to the checks of `REPEATED`."""


Send = Callable[[str, Any], Awaitable[tuple[str, bool | None]]]
"""Makes one call; returns the text that came back, and whether it was an error, if that can be seen."""


@dataclass(frozen=True)
class Host:
    """An adapter whose host manages the context."""

    open: Callable[[Sequence[int], Path], AbstractAsyncContextManager[list[Send]]]
    """Opens an episode for each seed, their transcripts somewhere in the folder."""
    through: str
    carries: Callable[[str, Any], bool] = lambda name, arguments: True
    """Which calls reach us. The framework answers, or refuses, the others itself."""
    slow: bool = False


def move(short: str) -> str:
    return f"Move the top disk of rod {short[0]} to the top of rod {short[-1]}"


def calling(*calls: tuple[str, Any], say: str = "") -> sp.Message:
    """An assistant message; its calls have the ids c0, c1, ... in every message, as some models send them."""
    tool_calls = [function_call(f"c{at}", name, sent) for at, (name, sent) in enumerate(calls)]
    message: dict[str, Any] = {"role": "assistant", "content": say}
    return {**message, "tool_calls": tool_calls} if calls else message  # type: ignore[return-value]


def act(short: str) -> tuple[str, Any]:
    return "act", {"action": move(short)}


def with_one_id(message: sp.Message) -> sp.Message:
    """The message with one id for all of its calls."""
    calls = [{**call, "id": "same"} for call in message["tool_calls"]]
    return {**message, "tool_calls": calls}  # type: ignore[return-value]


BASIC: Script = [
    calling(("read_manual", {}), say="First the rules."),
    calling(("observe", {})),
    calling(act(WAY[0]), ("observe", {}), act(WAY[1]), act(WAY[2])),
    calling(("act", {"action": "Fly"})),
    calling(("act", {"action": True}), ("act", {"actoin": "Rock"}), ("act", {"action": "1", "now": True}), say="Oops."),
    calling(("observe", {"deep": {"list": [1, "ä", None]}})),
    calling(("jump", {"how": "high"}), ("observe", {})),
    with_one_id(calling(*map(act, WAY[3:5]))),
    calling(("observe", {}), say="So?"),
    calling(*map(act, WAY[5:]), act(WAY[0])),
]
"""Every kind of call; the last act comes after the end."""

NO_NUMBERS = [True, 1.0, 1.5, None]
"""What stands where an action belongs, and is neither text nor a whole number."""

NUMBERS: Script = [
    *(calling(("act", {"action": sent})) for sent in (*NO_NUMBERS, 0, 99, -1)),
    *(calling(("act", {"action": sent})) for sent in (2, "1", 6, 2, 3, "4.", 2)),
]
"""An action's number as a number and as a text; the last seven calls solve the game."""

IDLE: Script = [calling(("observe", {})), calling(say="Let me think."), *BASIC[2:]]
"""A script with a reply without calls."""

BROKEN: Script = [
    calling(("observe", {})),
    calling(("act", '{"action": ')),
    calling(act(WAY[0]), ("act", "[1]"), ("act", "Rock")),
    calling(*map(act, WAY[1:])),
]
"""Arguments that are not JSON, or not an object: alone in a message, and after one that is."""

PLACE = {
    "$defs": {"place": {"type": "object", "properties": {"near": {"$ref": "#/$defs/place"}}}},
    "type": "object",
    "properties": {"city": {"type": "string"}, "near": {"$ref": "#/$defs/place"}, "when": True},
    "required": ["city"],
    "additionalProperties": False,
}
"""A schema as MCP servers write them: one part allows any value, another is recursive."""
WEATHER = sp.ToolSpec("weather", "Tell the weather.", PLACE)
"""A tool of the agent's own."""

REMEMBERING: Script = [
    calling(("memory", {"command": "view", "path": "/memories", "view_range": None}), say="Do I know anything?"),
    calling(("memory", {"command": "create", "path": "/memories/plan", "file_text": "First A->C.\nThen A->B.\n"})),
    calling(act(WAY[0]), ("read_result", {"page": "r1.2"}), act(WAY[1])),
    calling(("memory", {"command": "insert", "path": "/memories/plan", "insert_line": 0, "insert_text": "Hm."})),
    calling(("recall", {"query": "1"}), ("recall", {"query": "disk"}), ("recall", {"query": 5}), *map(act, WAY[2:4])),
    calling(("memory", {"command": "view", "path": "/memories/plan", "view_range": [1, 2]}), ("memory", {})),
    calling(("recall", {"query": "0-9"})),
    calling(*map(act, WAY[4:])),
]
"""Every tool that a strategy adds, beside `take_notes`."""
MEMORY = 50
REMEMBERS = sp.Budget(
    memory_tokens=MEMORY, recall_tokens=100, beyond_result="offload", result_tokens=40, history=1, notes_tokens=20
)
"""The budget that offers them."""

BUDGETS = {
    "free": sp.Budget(),
    "tight": sp.Budget(prompt_tokens=1400, history=2, result_tokens=150),
    "lazy": sp.Budget(prompt_tokens=1400, slack=0.5, result_tokens=150, episode_tokens=20_000, reply_tokens=300),
    "spent": sp.Budget(prompt_tokens=900, history=2),
    "poor": sp.Budget(episode_tokens=1500, reply_tokens=40),
    "thrifty": sp.Budget(episode_cost=1800, cost_rule="ours:read=0.25,output=5", reply_tokens=40),
}
"""With the first three the game is played to its end; with the second and third, turns leave the window."""
ENDS = {"spent": "prompt_tokens", "poor": "episode_tokens", "thrifty": "episode_cost"}
"""How the episode ends under a budget with which it is not."""


def fresh(budget: sp.Budget | None = None, seed: int = SEED, **options: Any) -> tuple[sp.Episode, list[Any]]:
    events: list[Any] = []
    return sp.Episode(GAME, seed=seed, budget=budget, transcript=events, **options), events


def by_conversation(episode: sp.Episode, script: Replies, *, own_cap: int | None = None, situation: str = "") -> Held:
    """The reference for all rows: `play` with a scripted player."""
    player = sp.ScriptedPlayer(script)
    sp.play(episode, player)
    return Held([received(prompt, own_cap) for prompt in player.prompts])


def received(prompt: sp.Prompt, own_cap: int | None = None) -> Received:
    settings = prompt.settings({} if own_cap is None else {"max_tokens": own_cap})
    return Received(
        one_system([dict(message) for message in prompt.messages]),
        [(tool.name, tool.description, dict(tool.parameters)) for tool in prompt.tools],
        settings.get("max_tokens"),
    )


Play = Callable[[sp.Episode, ModelPlayer], None]
"""Plays an episode with the player of a model."""


def waiting(episode: sp.Episode, player: ModelPlayer) -> None:
    with player:
        sp.play(episode, player)


def on_a_loop(episode: sp.Episode, player: ModelPlayer) -> None:
    async def play() -> None:
        async with player:
            await sp.aplay(episode, player)

    asyncio.run(play())


def by_session(episode: sp.Episode, script: Replies, *, own_cap: int | None = None, situation: str = "") -> Held:
    """An `AgentSession` whose host runs the last call of a message first."""
    session, replies, sent = sp.AgentSession(episode, summaries=True), iter(script), []
    while (prompt := session.prompt()) is not None:
        sent.append(received(prompt, own_cap))
        for call in reversed(session.receive(next(replies))):
            session.answer(call.id)
    return Held(sent)


def played_alike(
    row: Window, script: Script, budget: sp.Budget, turns: Turns | None = None
) -> tuple[sp.Episode, list[Any], Sent]:
    """Play a conversation through an adapter and again without it; both have to be equal."""
    episode, events = fresh(budget)
    with episode:
        sent, *_ = row.hold(episode, script if turns is None else turns.taken(script))
    if turns is not None:
        turns.leave()
    expected_episode, expected_events = fresh(budget)
    with expected_episode:
        expected, *_ = by_conversation(expected_episode, script)
    assert without_usage(episode.result).model_dump() == without_usage(expected_episode.result).model_dump()
    assert comparable(events) == comparable(expected_events)
    assert [spelled(prompt) for prompt in sent] == [spelled(prompt) for prompt in expected]
    return episode, events, sent


def judge(row: Window, script: Script, budget: sp.Budget, turns: Turns | None = None) -> sp.EpisodeResult:
    """The same, and what the model received is checked independently."""
    episode, events, sent = played_alike(row, script, budget, turns)
    independently(events, sent, episode)
    assert episode.result is not None
    return episode.result


def judge_interleaved(row: Window) -> None:
    """Play two episodes in two threads; their replies alternate."""

    async def both() -> None:
        mine = Turns()
        others = mine.other_side()
        one = asyncio.to_thread(judge, row, BASIC, BUDGETS["tight"], mine)
        other = asyncio.to_thread(judge, row, IDLE, BUDGETS["free"], others)
        await asyncio.gather(one, other)
        assert min(mine.taken_in_turn, others.taken_in_turn) == len(BASIC)

    asyncio.run(both())


def judge_end(row: Window, budget: str) -> None:
    """Play the script with every kind of call under one of `BUDGETS`."""
    result = judge(row, BASIC, BUDGETS[budget])
    assert result.end_reason == ENDS.get(budget, "terminated")
    assert result.refused_calls == (budget not in ENDS), "the last act comes after the end"


def judge_numbers(row: Window) -> None:
    """An action's number may be a number, which is recorded as it was said; booleans and fractions are mistakes."""
    check_numbers(judge(row, NUMBERS, BUDGETS["free"]))


def check_numbers(result: sp.EpisodeResult) -> None:
    """Check the result of an episode that was played with `NUMBERS`."""
    assert (result.end_reason, result.score) == ("terminated", 3)
    assert (result.malformed_calls, result.illegal_actions, result.steps) == (len(NO_NUMBERS), 3, 7)


class Asking:
    """A compactor that asks twice when the conversation is long: with calls, and so with tools, and without."""

    def compact(self, history, room):
        if len(history) < 8:
            return history
        system = {"role": "system", "content": "Be short."}
        first = yield [system, *history, {"role": "user", "content": "What was that?"}]
        second = yield [system, {"role": "user", "content": "And what now?"}]
        return [{"role": "user", "content": f"{first['content']} {second['content']}"}, *history[-2:]]


def judge_summaries(row: Window) -> None:
    """Play under budgets that ask for words through an adapter and again without it; both have to be equal.

    Every reply has words and a call: a summary or an answer is made of the words, and its call is refused.
    """
    sp.register_strategy("asking", Asking)
    shared = {"prompt_tokens": 1100, "tool_calls": 25, "stalled_turns": None}
    _judge_words(row, sp.Budget(**shared, summary_tokens=60, slack=0.5))
    _judge_words(row, sp.Budget(**shared, history=None, strategy="asking", question_tokens=3000))


def _judge_words(row: Window, budget: sp.Budget) -> None:
    script = [calling(("observe", {}), say="I have looked.")] * 60
    episode, events, _ = played_alike(row, script, budget)
    assert episode.result is not None
    assert episode.result.summaries + episode.result.questions == episode.result.refused_calls > 2
    assert sp.replay(events).identical


def judge_memory(row: Window) -> None:
    """The tools that strategies add reach the model as they are, and their answers, too."""
    result = judge(row, REMEMBERING, REMEMBERS)
    assert (result.end_reason, result.recalls, result.pages, result.malformed_calls) == ("terminated", 3, 1, 2)


def judge_mistakes_without_end(row: Window) -> None:
    """A model that makes one mistake for ever is asked until its turns have stalled, however often its host asks."""
    words, unknown, broken = calling(say="Hm."), calling(("jump", {})), calling(("act", '{"act'))
    mistakes: list[tuple[Script, str, int]] = [
        ([words], "no_tool_call", 3),
        ([calling()], "no_tool_call", 3),
        ([unknown], "stalled_turns", 10),
        ([words, words, unknown], "stalled_turns", 10),
        *([([broken], "stalled_turns", 10), ([unknown, broken], "stalled_turns", 10)] if row.broken_json else []),
    ]
    for replies, end, turns in mistakes:
        episode, events = fresh()
        with episode:
            sent, *_ = row.hold(episode, itertools.islice(itertools.cycle(replies), 99))
        assert episode.result is not None
        assert (episode.result.end_reason, episode.result.turns, len(sent)) == (end, turns, turns)
        assert sp.replay(events).identical


def judge_caps(row: Window) -> None:
    """Of a user's own cap on replies and the budget's, the smaller one applies; either may be missing."""
    script = [calling(act(short)) for short in WAY]
    for of_budget, own, smaller in ((300, 40, 40), (40, 300, 40), (None, 40, 40), (40, None, 40)):
        episode, _ = fresh(sp.Budget(reply_tokens=of_budget))
        with episode:
            sent, *_ = row.hold(episode, script, own_cap=own)
        assert [prompt.cap for prompt in sent] == [smaller] * len(WAY), f"{of_budget} of the budget, {own} of the user"


class Turns:
    """Makes two conversations interleave: each reply of one waits for the next reply of the other."""

    def __init__(self) -> None:
        self.mine, self.others = threading.Semaphore(1), threading.Semaphore(0)
        self.taken_in_turn = 0

    def other_side(self) -> Turns:
        other = Turns()
        other.mine, other.others = self.others, self.mine
        return other

    def taken(self, script: Replies) -> Iterator[sp.Message]:
        for message in script:
            assert self.mine.acquire(timeout=30), "the other conversation does not go on"
            self.others.release()
            self.taken_in_turn += 1
            yield message

    def leave(self) -> None:
        """Release the other conversation."""
        self.others.release(1000)


def without_usage(result: sp.EpisodeResult) -> sp.EpisodeResult:
    """A result without the provider's usage, which may differ."""
    return result.model_copy(update={"tokens": result.tokens.model_copy(update={"provider": None})})


def independently(events: list[Any], sent: Sent, episode: sp.Episode) -> None:
    """Check what the model received with `tests/checker.py`."""
    head = next(event for event in events if event["event"] == "head")
    judged = checker.Judge(
        head["messages"],
        head["tools"],
        checker.turns_of(events),
        episode.budget.model_dump(),
        episode.counter.tokenizer.count,
    )
    budget, spent = episode.budget.model_dump(), 0
    for turns, prompt in enumerate(sent):
        view = judged.view(turns)
        assert view is not None, "the pinned parts do not fit, and yet a prompt was sent"
        assert [plain(m) for m in prompt.messages] == [plain(m) for m in one_system(view["messages"])]
        checker.check_prompt(list(prompt.messages), head["tools"], judged, turns)
        assert prompt.tools == [(tool["name"], tool["description"], tool["parameters"]) for tool in head["tools"]]
        assert prompt.cap == checker.allowed(budget, spent, view["tokens"])
        spent += view["tokens"] + checker.message_tokens(judged.turns[turns]["messages"][0], judged.n)
    assert len(sent) == len(judged.turns)


def spelled(prompt: Received) -> tuple[Any, ...]:
    return [plain(message) for message in prompt.messages], prompt.tools, prompt.cap


def plain(message: dict[str, Any]) -> dict[str, Any]:
    """A message without what frameworks spell differently: ids, and no text as null or as nothing."""
    calls = [call["function"] for call in message.get("tool_calls", ())]
    spelled = [(call["name"], checker.arguments_text(call["arguments"])) for call in calls]
    return {"role": message["role"], "content": checker.plain_text(message["content"]), "calls": spelled}


def one_system(messages: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The messages with all system messages joined at the beginning, as frameworks with one system text send them."""
    system = [checker.plain_text(message["content"]) for message in messages if message["role"] == "system"]
    return [{"role": "system", "content": "\n\n".join(system)}, *(m for m in messages if m["role"] != "system")]


def calls_of(script: Script) -> list[tuple[str, Any]]:
    """A script for adapters whose host manages the context, where each call is a turn."""
    functions = [call["function"] for message in script for call in message.get("tool_calls", ())]
    return [(function["name"], json.loads(function["arguments"])) for function in functions]


OURS, HOSTS = "This package manages the context", "The host manages the context"
"""The sections of `docs/interfaces.md` with a line for each interface."""


def table(section: str) -> dict[str, dict[str, str]]:
    """The lines of a section's table in `docs/interfaces.md` by their first cell, each cell by its column."""
    page = Path(__file__).parents[2] / "docs" / "interfaces.md"
    (text,) = re.findall(rf"^### {section}\n(.*?)(?=^##)", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    lines = [line.strip("|").split("|") for line in text.splitlines() if line[:1] == "|"]
    columns, _, *rows = [[cell.strip() for cell in line] for line in lines]
    return {cells[0]: dict(zip(columns, cells, strict=True)) for cells in rows}


def line_of(row: Window | Host) -> dict[str, str]:
    section = OURS if isinstance(row, Window) else HOSTS
    (line,) = [cells for interface, cells in table(section).items() if interface.startswith(row.through)]
    return line


def check_line(row: Window) -> None:
    """Hold the table's line of an adapter to what its row shows."""
    assert line_of(row)["broken JSON"] == ("answered" if row.broken_json else "cannot occur")


BROKEN_JSON = "arguments that are no JSON"
INTERLEAVED = "two episodes interleaved"

CHECKS: Mapping[str, Callable[[Window], Any]] = {
    **{f"the budget `{name}`": partial(judge_end, budget=name) for name in BUDGETS},
    "the tools of memory": judge_memory,
    "numbers of actions": judge_numbers,
    "words without a call": partial(judge, script=IDLE, budget=BUDGETS["tight"]),
    BROKEN_JSON: partial(judge, script=BROKEN, budget=BUDGETS["tight"]),
    "mistakes without end": judge_mistakes_without_end,
    "prompts for a summary": judge_summaries,
    "the smaller of two caps": judge_caps,
    "the line of the table": check_line,
    INTERLEAVED: judge_interleaved,
}
"""What every row is held to, beside the situations; a wire that cannot carry broken JSON is not held to that."""
REPEATED = (
    "the budget `tight`",
    "words without a call",
    BROKEN_JSON,
    "prompts for a summary",
    "the smaller of two caps",
    INTERLEAVED,
)
"""What a row is held to that repeats another one."""


def checks_of(row: Window) -> list[str]:
    """What a row is held to."""
    return [name for name in (REPEATED if row.repeats else CHECKS) if row.broken_json or name != BROKEN_JSON]


class WindowConformance:
    """The tests of a framework with a separate environment: `CHECKS` for the row of its test file's class.

    Episodes are not interleaved: Inspect runs one evaluation at a time in a process.
    """

    row: Window

    @pytest.mark.parametrize("check", [name for name in CHECKS if name != INTERLEAVED])
    def test_the_game_cannot_tell_it_apart(self, check):
        if check == BROKEN_JSON and not self.row.broken_json:
            pytest.skip("its wire cannot carry them")
        CHECKS[check](self.row)


HOST_BUDGET = sp.Budget(history=3)


def host_episode(seed: int, folder: Path) -> sp.Episode:
    return sp.Episode(GAME, seed=seed, budget=HOST_BUDGET, context="host", transcript=folder / f"{seed}.jsonl")


@asynccontextmanager
async def direct(
    seeds: Sequence[int], folder: Path, send_to: Callable[[sp.Episode], Send]
) -> AsyncIterator[list[Send]]:
    """Episodes in this process."""
    with ExitStack() as stack:
        yield [send_to(stack.enter_context(host_episode(seed, folder))) for seed in seeds]


def is_of_the_game(name: str, arguments: Any) -> bool:
    return name in ("observe", "act", "read_manual")


async def judge_hosts(row: Host, folder: Path) -> None:
    """Play three episodes, their calls in turn, and each once more without the adapter."""
    plays = {7: calls_of(BASIC), 8: calls_of(IDLE), 9: [*calls_of(NUMBERS), ("observe", {})]}
    carried = {seed: [call for call in calls if row.carries(*call)] for seed, calls in plays.items()}
    shown: dict[int, list[tuple[str, bool | None]]] = {seed: [] for seed in plays}
    async with row.open([*plays], folder) as senders:
        send = dict(zip(plays, senders, strict=True))
        for calls in zip_longest(*carried.values()):
            for seed, call in zip(carried, calls, strict=True):
                if call is not None:
                    shown[seed].append(await send[seed](*call))
    records = [sp.read_transcript(path) for path in folder.glob("*.jsonl")]
    by_seed = {events[0]["config"]["seed"]: events for events in records}
    for seed, calls in carried.items():
        expected_events: list[Any] = []
        with sp.Episode(
            GAME, seed=seed, budget=HOST_BUDGET, context="host", transcript=expected_events
        ) as expected_episode:
            expected = [expected_episode.call(*call) for call in calls]
        assert [text for text, _ in shown[seed]] == [result.text for result in expected]
        assert all(error in (None, result.is_error) for (_, error), result in zip(shown[seed], expected, strict=True))
        assert comparable(by_seed[seed]) == comparable(expected_events)
        (end,) = [event for event in by_seed[seed] if event["event"] == "end"]
        assert end["result"] == expected_episode.result.model_dump()
        assert end["result"]["end_reason"] == "terminated"
        assert expected[-1].is_error, "the last call comes after the end"
        if seed == 9:
            check_numbers(expected_episode.result)
            said = [event["arguments"] for event in by_seed[seed] if event["event"] == "call"]
            assert said == [json.dumps(arguments) for _, arguments in calls[:-1]]
