"""Every cap and count of docs/budgets.md at its edge: exactly full, and one token, turn or call more."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context import ContextOverflowError
from smartplay_tools.context.strategies.choices import Choice
from smartplay_tools.context.strategies.offload import Pages
from smartplay_tools.conversation.paper import PaperConversation
from smartplay_tools.types.messages import calls_of, text_of
from tests.test_compaction import named

RPS = "RockPaperScissorBasic-v0"
DEFINITION = (Path(__file__).parents[1] / "docs" / "budgets.md").read_text(encoding="utf-8")


class Words:
    """A token for every word."""

    name = "words"

    def count(self, text: str) -> int:
        return len(text.split())


def reply(words: str | None = "one", name: str = "act", /, **arguments: Any) -> sp.Message:
    return sp.call(name, say=words, **(arguments or {"action": "Rock"}))


def begin(game: str = RPS, **budget: Any) -> sp.Conversation:
    given = {"result_tokens": None, "history": None, "stalled_turns": None, **budget}
    options = {"observation": "both"} if "newest_pictures" in budget else {}
    return sp.Conversation(sp.Episode(game, seed=1, tokenizer=Words(), budget=sp.Budget(**given), **options))


def play(replies: list[sp.Message], **budget: Any) -> sp.Conversation:
    """Play replies as long as there is a prompt, and take one more prompt."""
    conversation = begin(**budget)
    for each in replies:
        if conversation.prompt() is not None:
            conversation.receive(each)
    conversation.prompt()
    return conversation


def tokens_of(**budget: Any) -> tuple[int, int]:
    """The tokens of the head, with schemas and priming, and of a turn of `reply()`."""
    conversation = play([reply()], **budget)
    counter, episode = conversation.episode.counter, conversation.episode
    return counter.prompt(episode.head, episode.tools), sum(map(counter.message, conversation.turns[0].messages))


HEAD, TURN = tokens_of()
COUNTER, WORDING = begin().episode.counter, begin().episode.words
RECALL = tokens_of(recall_tokens=50, history=1)[0] - HEAD


def end(conversation: Any) -> str | None:
    return conversation.result and conversation.result.end_reason


def last_call(conversation: sp.Conversation) -> Any:
    return conversation.turns[-1].messages[-1]["content"]


class Everything:
    """A strategy that shows all turns."""

    def choose(self, past: sp.Past, room: int | None) -> Choice:
        return Choice(turns=range(len(past.turns)))


class Nothing:
    """A strategy that shows what has to be shown."""

    def choose(self, past: sp.Past, room: int | None) -> Choice:
        return Choice()


sp.register_strategy("exact-everything", Everything)
sp.register_strategy("exact-nothing", Nothing)
SAME = named(lambda self, history, room: history)
LONG = reply("word " * 100)  # of 100 words, where `reply()` has one
NOTES = reply(None, "take_notes", text="word " * 20)
FOUR, TWO = [reply()] * 4, [reply(), LONG]


def chosen(spare: int) -> str | None:
    return end(play(FOUR, prompt_tokens=HEAD + 4 * TURN + spare, strategy="exact-everything"))


def chosen_pins(spare: int) -> str | None:
    return end(play(TWO, prompt_tokens=HEAD + TURN + 99 + spare, strategy="exact-nothing"))


def compacted(replies: list[sp.Message], room: int) -> Any:
    conversation = play(replies, prompt_tokens=HEAD + room, strategy=SAME)
    return end(conversation) or len([each for each in conversation.view.forms if each.message["role"] == "tool"])


def asked(spare: int) -> tuple[int, int]:
    def compact(self: Any, history: Any, room: Any) -> Any:
        with suppress(ContextOverflowError):
            yield [{"role": "user", "content": "word " * 50}]
        return history

    conversation = begin(strategy=named(compact), question_tokens=3 + 3 + 1 + 50 + spare)
    if conversation.prompt().purpose == "compaction":
        conversation.receive({"role": "assistant", "content": "An answer."})
    return conversation.episode.stats.questions, conversation.episode.stats.refused_questions


def cut(spare: int, name: str) -> int:
    whole = last_call(play([reply("one", name)]))
    return play([reply("one", name)], result_tokens=Words().count(whole) + spare).episode.stats.cut_results


def automatic(spare: int) -> tuple[int | None, int | None]:
    episode = begin(prompt_tokens=HEAD - 3 + 480 + spare, result_tokens="auto").episode
    return episode.budget.result_tokens, episode.budget.manual_tokens


def masked(history: int) -> int:
    return len(play([reply()] * 6, history=history, beyond_history="mask").view.masked_results)


def bare(own_words: int) -> int:
    shown = play([reply()] * 6, own_words=own_words).prompt().messages
    return sum(message["role"] == "assistant" and message["content"] is None for message in shown)


def refused(spare: int) -> tuple[int, int]:
    file = reply(None, "memory", command="create", path="/memories/a", file_text="word " * 20)
    noted = play([NOTES], notes_tokens=20 + spare, prompt_tokens=2_000).episode.stats.refused_notes
    return noted, play([file], memory_tokens=21 + spare).episode.stats.refused_memory


def summarised(spare: int) -> int:
    conversation = begin(prompt_tokens=HEAD + 400, summary_tokens=20 + spare, slack=0.5)
    while conversation.prompt().purpose != "summary":
        conversation.receive(reply())
    conversation.receive({"role": "assistant", "content": "word " * 19 + "word"})
    return conversation.episode.stats.cut_summaries


def pushed_out(spare: int) -> int:
    replies = [*[reply()] * 9, reply("word " * (5 * TURN + 1))]
    return play(replies, prompt_tokens=HEAD + 9 * TURN + spare).view.dropped_turns


def kept_with_notes(spare: int) -> int:
    replies, free = [NOTES, *FOUR], {"notes_tokens": 50, "prompt_tokens": 5_000}
    tokens = play(replies, **free).view.tokens
    return play(replies, **{**free, "prompt_tokens": tokens + spare}).view.dropped_turns


def notes_beside_the_newest_turn(spare: int) -> bool:
    """Whether notes stay where there is room for them and the newest turn alone."""
    conversation = play([NOTES, reply(), reply()], notes_tokens=50, prompt_tokens=5_000)
    counter, episode = conversation.episode.counter, conversation.episode
    shown = [message for number in (0, 2) for message in conversation.turns[number].messages]
    cap = counter.prompt([*episode.head, *shown], [*episode.tools])
    shown = play([NOTES, reply(), reply()], notes_tokens=50, prompt_tokens=cap + spare).prompt().messages
    return any(call["function"]["name"] == "take_notes" for message in shown for call in calls_of(message))


def turns_in_view(count: int, room: int = 5 * (TURN + 1)) -> list[int]:
    replies = [reply(f"turn {number}") for number in range(9)]
    shown = play(replies, first_turns=count, prompt_tokens=HEAD + room).prompt().messages
    return [int(text_of(message).split()[1]) for message in shown if message["role"] == "assistant"]


def first_turns_that_fit(spare: int) -> list[int]:
    return turns_in_view(5, 3 * (TURN + 1) + spare)


def recalled(spare: int) -> int:
    """The observations in an answer of a cap that two take exactly."""
    recall = reply(None, "recall", query="1-3")
    conversation = play([*[reply()] * 6, recall], history=0, recall_tokens=2_000)
    two = Words().count("\n\n".join(last_call(conversation).split("\n\n")[:2]))
    return len(last_call(play([*[reply()] * 6, recall], history=0, recall_tokens=two + spare)).split("\n\n"))


def recalled_alone(spare: int) -> bool:
    replies = [*[reply()] * 6, reply(None, "recall", query="1")]
    one = Words().count(last_call(play(replies, history=0, recall_tokens=2_000)))
    return "cut" in last_call(play(replies, history=0, recall_tokens=one + spare))


def of_a_host(spare: int) -> bool:
    """Whether the history that `observe` gives a host is cut to a cap of exactly its tokens."""

    def observed(result_tokens: int | None) -> str:
        budget = sp.Budget(result_tokens=result_tokens)
        with sp.Episode(RPS, seed=1, tokenizer=Words(), budget=budget, context="host") as episode:
            for _ in range(3):
                episode.call("act", {"action": "Rock"})
            return episode.call("observe", {}).text

    return "tokens cut" in observed(Words().count(observed(None)) + spare)


def second_page(spare: int) -> bool:
    """Whether the second page is the last where its cap is exactly what the first has left."""
    text = " ".join(["word"] * 60)

    def pages(cap: int) -> Pages:
        return Pages(1, text, 20, cap, Words().count, WORDING)

    rest = (pages(100).page(2) or "").split()
    made = pages(len(rest) + spare)
    return made.page(2) is not None and made.page(3) is None


def pictures(count: int) -> int:
    moves = [reply(None, action="Move West")] * 4
    return len(play(moves, game="Crafter-v0", newest_pictures=count).prompt().pictures)


def replied(spare: int) -> int:
    """The replies that are over a cap of exactly their tokens."""
    conversation = begin(reply_tokens=COUNTER.message(reply()) + spare)
    conversation.prompt()
    conversation.receive(reply())
    return conversation.episode.stats.tokens.overruns


def left(spare: int, reply_tokens: int | None) -> Any:
    """The cap on the first reply, where the episode has tokens for the prompt and the least reply, exactly."""
    prompt = begin(episode_tokens=HEAD + (reply_tokens or 1) + spare, reply_tokens=reply_tokens).prompt()
    return prompt and prompt.max_tokens


def left_of_money(spare: int, reply_tokens: int | None) -> Any:
    """The same in money, where a token of a prompt costs 2 and one of a reply 3."""
    cost = 2 * HEAD + 3 * (reply_tokens or 40) + spare
    prompt = begin(episode_cost=cost, cost_rule="ours:input=2,output=3", reply_tokens=reply_tokens).prompt()
    return prompt and prompt.max_tokens


def answer(length: int = 50, depth: int = 1) -> str:
    """The answer to a call whose arguments have a length or a depth."""
    deep = "[" * (depth - 1) + "]" * (depth - 1)
    arguments = f'{{"action": {deep or 1}{" " * (length - 13)}}}'
    conversation = begin()
    call = {"id": "c", "type": "function", "function": {"name": "act", "arguments": arguments}}
    conversation.receive({"role": "assistant", "content": None, "tool_calls": [call]})
    return last_call(conversation)


def on_paper(prompt_tokens: int | None, history: int | None = None) -> Any:
    budget = sp.Budget(history=history, prompt_tokens=prompt_tokens, result_tokens=None)
    conversation = PaperConversation(sp.Episode(RPS, seed=1, tokenizer=Words(), budget=budget))
    for number in range(8):
        conversation.prompt()
        conversation.receive({"role": "assistant", "content": "Rock" if number % 2 else "I wonder."})
    conversation.prompt()
    return conversation


def of_the_history(spare: int) -> int:
    return on_paper(on_paper(None).view.tokens + spare).view.dropped_turns


def idle(replies: int) -> str | None:
    return end(play([{"role": "assistant", "content": f"Number {number}."} for number in range(replies)]))


def stalled(turns: int) -> str | None:
    return end(play([reply(action="Lizard")] * turns, stalled_turns=4))


def without_a_step(history: int) -> int:
    """The turns that stay of ten in a row that play no step."""
    return 10 - play([reply(action="Lizard")] * 10, history=history, stalled_turns=20).view.dropped_turns


def after_steps(mistakes: int, slack: float = 0) -> int:
    """The turns that leave after two that play a step, the newer of which is pinned, and some that play none."""
    replies = [reply(), reply(), *[reply(action="Lizard")] * mistakes]
    return play(replies, history=2, stalled_turns=20, slack=slack).view.dropped_turns


def made(**budget: Any) -> str:
    try:
        begin(**budget)
    except sp.InvalidArgumentError as error:
        return str(error).partition(" ")[0]
    return "made"


def seen(history: int) -> int:
    return play([reply()] * 6, history=history).view.shown_steps


EXACTLY_FULL: dict[str, tuple[Callable[[int], Any], Any, Any]] = {
    # A cap and what it is on: the case, with exactly as many tokens as there are, and with one fewer.
    "prompt_tokens": (lambda n: play([reply()] * 5, prompt_tokens=HEAD + 4 * TURN + n).view.dropped_turns, 1, 2),
    "prompt_tokens and a turn that pushes out many": (pushed_out, 6, 7),
    "prompt_tokens and notes": (kept_with_notes, 0, 1),
    "prompt_tokens and notes beside the newest turn": (notes_beside_the_newest_turn, True, False),
    "prompt_tokens with slack": (
        lambda n: play(FOUR, prompt_tokens=HEAD + 4 * TURN + n, slack=0.5).view.dropped_turns,
        0,
        2,
    ),
    "prompt_tokens and pins": (lambda n: end(play(TWO, prompt_tokens=HEAD + TURN + 99 + n)), None, "prompt_tokens"),
    "prompt_tokens and the head": (lambda n: made(prompt_tokens=HEAD + n), "made", f"prompt_tokens={HEAD - 1}"),
    "prompt_tokens and a choice": (chosen, None, "strategy_error"),
    "prompt_tokens and pins beside a choice": (chosen_pins, None, "prompt_tokens"),
    "prompt_tokens and what a compactor returns": (lambda n: compacted(FOUR, 4 * TURN + n), 4, 3),
    "prompt_tokens and what stays of that": (lambda n: compacted([reply()] * 6, 4 * TURN + n), 4, 3),
    "prompt_tokens and a compactor's newest turn": (lambda n: compacted(TWO, TURN + 99 + n), 1, "prompt_tokens"),
    "prompt_tokens and first_turns": (first_turns_that_fit, [0, 1, 8], [0, 8]),
    "prompt_tokens in the paper's protocol": (of_the_history, 0, 1),
    "question_tokens": (asked, (1, 0), (1, 1)),
    "reply_tokens": (replied, 0, 1),
    "episode_tokens": (lambda n: left(n, None), 1, None),
    "episode_tokens and reply_tokens": (lambda n: left(n, 30), 30, None),
    "episode_cost by cost_rule": (lambda n: left_of_money(n, None), 40, None),
    "episode_cost and reply_tokens": (lambda n: left_of_money(n, 30), 30, None),
    "result_tokens": (lambda n: cut(n, "act"), 0, 1),
    "result_tokens of the manual": (lambda n: cut(n, "read_manual"), 0, 1),
    "result_tokens of a host's history": (of_a_host, False, True),
    "result_tokens auto": (automatic, (120, 160), (119, 159)),
    "notes_tokens and memory_tokens": (refused, (0, 0), (1, 1)),
    "summary_tokens": (summarised, 0, 1),
    "recall_tokens": (recalled, 2, 1),
    "recall_tokens and one observation": (recalled_alone, False, True),
    "recall_tokens beside a result": (
        lambda n: made(recall_tokens=50, result_tokens=40, history=1, prompt_tokens=HEAD + RECALL + 90 + n),
        "made",
        "recall_tokens=50",
    ),
    "beyond_result": (second_page, True, False),
}

EXACTLY_N: dict[str, tuple[Callable[[int], Any], dict[int, Any]]] = {
    # A count: what there is with some numbers.
    "history": (seen, {0: 1, 1: 2, 3: 4}),
    "history in the paper's protocol": (lambda n: on_paper(None, n).view.shown_steps, {0: 1, 1: 2, 3: 4}),
    "history with masking": (masked, {0: 5, 1: 4, 3: 2}),
    "history of turns without a step": (without_a_step, {0: 1, 2: 3, 8: 9}),
    "history before turns without a step": (after_steps, {3: 0, 4: 2}),
    "history before turns without a step, with slack": (lambda n: after_steps(n, slack=0.5), {3: 0, 4: 3}),
    "tool_calls": (lambda n: end(play(FOUR, tool_calls=n)), {4: "tool_calls", 5: None}),
    "tool_calls of which the last is played": (lambda n: play(FOUR, tool_calls=n).episode.stats.steps, {3: 3, 4: 4}),
    "stalled_turns": (stalled, {3: None, 4: "stalled_turns"}),
    "replies without a call": (idle, {2: None, 3: "no_tool_call"}),
    "own_words": (bare, {0: 5, 1: 4, 3: 2}),
    "first_turns": (turns_in_view, {1: [0, 5, 6, 7, 8], 2: [0, 1, 6, 7, 8], 3: [0, 1, 2, 7, 8]}),
    "newest_pictures": (pictures, {1: 1, 2: 2, 3: 3}),
    "characters of arguments": (lambda n: "longer" in answer(length=n), {10_000: False, 10_001: True}),
    "depth of arguments": (lambda n: "too deep" in answer(depth=n), {100: False, 101: True}),
}
ELSEWHERE = {
    "strategy": "no limit",
    "beyond_history": "no limit",
}


@pytest.mark.parametrize("case", EXACTLY_FULL)
def test_what_is_exactly_full(case: str):
    measure, full, over = EXACTLY_FULL[case]
    assert (measure(0), measure(-1)) == (full, over)


@pytest.mark.parametrize("case", EXACTLY_N)
def test_what_is_exactly_n(case: str):
    measure, expected = EXACTLY_N[case]
    assert {number: measure(number) for number in expected} == expected


def test_every_field_of_the_definition_has_its_edge():
    table = DEFINITION.partition("| field |")[2].partition("\n\n")[0]
    cells = re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE)
    fields = {name for cell in cells for name in re.findall(r"\w+", cell)}
    assert fields == set(sp.Budget.model_fields)
    cases = " ".join([*EXACTLY_FULL, *EXACTLY_N]).split()
    assert fields - {*cases} == ELSEWHERE.keys()
