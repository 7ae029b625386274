"""An independent judge of context windows: slow, obvious, and written from the documents' text alone.

It imports nothing of the package; `tests/judge.py` decides the views, and what tools of strategies have to answer is
in `tests/model_from_docs`. Its input is plain data: a transcript's events
(what happened, in numbers), the prompts as they were sent (JSON), and `n`, which counts the tokens of a text.
Everything else is computed again, at every prefix, by brute force. Where judge and package disagree, one of them
misreads the documents.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from typing import Any

from tests.counting import arguments_text, message_tokens, picture_tokens, plain_text, tools_tokens
from tests.judge import FRAME, MARKER, PICTURE, Judge
from tests.model_from_docs.counting import as_sent
from tests.model_from_docs.cutting import Pages, cut
from tests.model_from_docs.files import Files
from tests.model_from_docs.recalling import answer, matching

__all__ = ["Judge", "allowed", "arguments_text", "check_episode", "check_prompt", "message_tokens", "plain_text"]
__all__ += ["tools_tokens", "turns_of"]

MANUAL_IS_ABOVE = "The manual stands at the end of the system message."
GIVEN = re.compile(r"[A-Za-z0-9]{9}")
"""The format of an id that the conversation assigned."""
Json = dict[str, Any]
Count = Callable[[str], int]

# --- What happened ---------------------------------------------------------------------------------------------------


def turns_of(events: Sequence[Json]) -> list[Json]:
    """Turns as plain data: `messages`, and for each which observation it shows and the current step.

    Observations are numbered anew here: an action that was played shows the next one, `observe` the current one.
    """
    turns: list[Json] = []
    ids = {
        call["id"]
        for event in events
        if event["event"] == "head"
        for one in event["messages"]
        for call in one.get("tool_calls", ())
    }
    steps = shown = 0
    form = events[0]["config"].get("observation", "text")
    for event in events:
        if event["event"] == "message" and event["by"] == "player":
            reply = with_ids(event, ids)
            turns.append(
                {"messages": [as_sent(reply)], "shows": [None], "made": [shown], "manual": None, "places": [-1]}
            )
            turns[-1]["dates"] = [None]
            turns[-1]["reply"] = reply
        elif event["event"] in ("message", "call"):
            observation, message, place = None, event.get("message"), event.get("position", 1_000)
            date = None
            if event["event"] == "call":
                tool = event["name"]
                text, played = event["text"], not event["is_error"]
                steps += played and tool == "act"
                observation = steps if played and tool in ("act", "observe") else None
                assert event["data"].get("observation_step") == observation
                date = shown if played and tool in ("recall", "read_result") else observation
                if played and tool == "take_notes":
                    turns[-1].setdefault("notes", []).append(json.loads(event["arguments"])["text"])
                if played and tool == "read_manual" and event["data"].get("manual"):
                    turns[-1]["manual"], text = text, MANUAL_IS_ABOVE
                if event.get("host") == "edited":
                    turns[-1]["messages"][0] = as_sent(edited(turns[-1]["messages"][0], event))
                call = turns[-1]["messages"][0]["tool_calls"][event["position"]]
                message = {
                    "role": "tool",
                    "content": with_picture(event, text, form, observation),
                    "tool_call_id": call["id"],
                }
                shown = shown if observation is None else max(shown, observation)
            # Results are in the order of their calls, other messages come after them.
            at = sum(other <= place for other in turns[-1]["places"])
            values = {"messages": message, "shows": observation, "dates": date, "made": shown, "places": place}
            for name, value in values.items():
                turns[-1][name].insert(at, value)
    return turns


def with_picture(event: Json, text: str, form: str, observation: int | None) -> Any:
    """What a result shows: its text and, if its observation is a picture, that too; nothing else has a picture."""
    picture = event["data"].get("picture")
    assert (picture is not None) == (form != "text" and observation is not None)
    if picture is None:
        return text
    if form == "picture" and not event["cut"]:
        assert text in (PICTURE, f"{PICTURE}\nThe game is over.")
    return [{"type": "text", "text": text}, {"type": "image", **picture}]


def with_ids(event: Json, taken: set[str]) -> Json:
    """A reply with its ids in the conversation: those of the model, unless they are empty or taken."""
    calls = event["message"].get("tool_calls", ())
    ids = event.get("ids", [call["id"] for call in calls])
    for call, shown in zip(calls, ids, strict=True):
        is_free = call["id"] and call["id"] not in taken
        if is_free:
            assert shown == call["id"], f"the usable id {call['id']!r} was replaced by {shown!r}"
        else:
            assert GIVEN.fullmatch(shown), f"{shown!r} was given in place of {call['id']!r}"
            assert shown not in taken, f"{shown!r} was given twice"
        taken.add(shown)
    listed = [{**call, "id": shown} for call, shown in zip(calls, ids, strict=True)]
    return {**event["message"], "tool_calls": listed} if calls else event["message"]


def edited(message: Json, call: Json) -> Json:
    """A reply as it is shown once the host has changed the arguments of one of its calls."""
    calls = [{**one, "function": dict(one["function"])} for one in message["tool_calls"]]
    calls[call["position"]]["function"]["arguments"] = call["arguments"]
    return {**message, "tool_calls": calls}


# --- The rules that must hold in every case --------------------------------------------------------------------------


def check_prompt(messages: list[Json], tools: list[Json], judge: Judge, k: int, purpose: str = "play") -> None:
    """Judge a sent prompt by the rules themselves: its size, its pairs, its observations, its manual.

    `k` counts the turns that the model has seen in it.
    """
    n, t = judge.n, judge.newest(k)
    size = sum(message_tokens(one, n) for one in messages) + 3 + tools_tokens(tools, n)
    assert judge.cap is None or size <= judge.cap, f"{size} tokens exceed the cap {judge.cap}"
    waiting: list[str] = []
    for one in messages:
        if one["role"] == "assistant":
            assert not waiting, f"calls without a result: {waiting}"
            waiting = [call["id"] for call in one.get("tool_calls", ())]
        elif one["role"] == "tool":
            assert one["tool_call_id"] in waiting, "a result without a call"
            waiting.remove(one["tool_call_id"])
    assert not waiting, f"calls without a result: {waiting}"
    kept = [i for i, _ in judge.shown(k, judge.first(k + 1) if purpose == "summary" else None)]
    body = messages[len(judge.original_head) :]
    if summary := judge.summary(k):
        front = sum(len(judge.turns[i]["messages"]) for i in range(min(judge.anchors(k), judge.first(k))))
        assert [body.pop(front)] == summary, "the summary stands after the head and the anchors"
    texts = judge.texts(k)
    for at, i in enumerate(i for i in kept if i in texts):
        place = sum(len(judge.turns[j]["messages"]) for j in kept if j < i)
        assert body.pop(place) == {"role": "user", "content": texts[i]}, f"text {at}"
    if purpose == "summary":
        assert body.pop() == judge.question
    expected = [(i, m) for i in kept for m in range(len(judge.turns[i]["messages"]))]
    assert len(body) == len(expected)
    pictures = sum(
        part["type"] == "image" for one in body if isinstance(one["content"], list) for part in one["content"]
    )
    assert judge.pictures_kept is None or pictures <= judge.pictures_kept, f"{pictures} pictures"
    shown = set()
    for one, (i, m) in zip(body, expected, strict=True):
        observation = judge.turns[i]["shows"][m]
        if observation is not None and one["content"] != MARKER:
            assert judge.history is None or observation >= t - judge.history, "an observation outlives its limit"
            shown.add(observation)
        date = judge.turns[i]["dates"][m]
        if date is not None and one["content"] != MARKER:
            assert judge.history is None or date >= t - judge.history, "an answer outlives its limit"
    if judge.choices is None:
        run = [i for i in kept if i >= judge.first(k)]
        assert run == list(range(run[0], run[-1] + 1)) if run else True, "the run has a gap"
        assert judge.first_turns or shown <= {*range(min(shown, default=0), max(shown, default=0) + 1)}
    if purpose == "play":
        observed = {o for turn in judge.turns[:k] for o in turn["shows"]} - {None}
        assert not observed or t in shown, "the current observation is missing"
        assert k == 0 or kept[-1] == k - 1, "the newest turn is missing"


def check_episode(
    events: Sequence[Json],
    sent: Sequence[Json],
    n: Count,
    choices: dict[int, Any] | None = None,
    whole: Sequence[str] | None = None,
) -> Judge:
    """Check a whole conversation: every prompt that was sent, every result, every number, and its end.

    `choices` are those of a custom strategy, as it returned them; `whole` are the observations that were shown, in
    their order, as a game without caps shows them.
    """
    budget = events[0]["budget"]
    [head] = [event for event in events if event["event"] == "head"]
    summaries = [event for event in events if event["event"] == "summary"]
    texts = [(event["turn"], event["text"]) for event in summaries]
    judge = Judge(head["messages"], head["tools"], turns_of(events), budget, n, texts, choices)
    check_summaries(summaries, judge)
    spent, k, asked = 0, 0, 0
    for prompt in sent:
        is_request = prompt.get("purpose") == "summary"
        assert is_request == (judge.asks(k) and asked == sum(1 for turn, _ in texts if turn < k)), "a summary is due"
        view = judge.request(k) if is_request else judge.view(k)
        assert view is not None, "the pinned parts do not fit, and yet a prompt was sent"
        check_prompt(prompt["messages"], prompt["tools"], judge, k - is_request, prompt.get("purpose", "play"))
        assert prompt["tools"] == head["tools"]
        for key, value in view.items():
            assert key == "covers" or prompt[key] == value, f"{key} of prompt {k}: {prompt[key]!r}, judged {value!r}"
        assert prompt["max_tokens"] == allowed(budget, spent, view["tokens"])
        assert prompt["max_tokens"] is None or prompt["max_tokens"] >= max(1, budget["reply_tokens"] or 1)
        spent += view["tokens"]
        if is_request:
            if asked < len(summaries):
                assert (summaries[asked]["turn"], summaries[asked]["covers"]) == (k, view["covers"])
                spent += message_tokens(summaries[asked]["message"], judge.n)
            asked += 1
        else:
            spent += message_tokens(judge.turns[k]["reply"], judge.n) if k < len(judge.turns) else 0
            k += 1
    check_calls(events, budget, n)
    check_recalls(events, judge, budget)
    check_pages(events, n, budget, whole)
    check_memory(events, n, budget)
    check_end(events, judge, spent, len(texts))
    check_stalls(events)
    return judge


def check_summaries(summaries: Sequence[Json], judge: Judge) -> None:
    """Judge what is shown of every reply to a request: all of it, its beginning with a notice, or the earlier one."""
    before = ""
    for event in summaries:
        reply, text, cap = plain_text(event["message"]["content"]), event["text"], judge.summary_cap

        def added(words: str) -> int:
            return judge.n(FRAME + words) - judge.n(FRAME)

        assert added(text) <= cap
        judged = cut(reply, judge.n(FRAME) + cap, judge.n, FRAME) if reply.strip() else ""
        assert event["cut"] == (bool(reply.strip()) and judged != reply)
        assert event["empty"] == (not judged.strip())
        assert text == (judged if judged.strip() else before)
        assert event["tokens"] == (judge.tokens([{"role": "user", "content": FRAME + text}]) if text else 0)
        before = text


def check_calls(events: Sequence[Json], budget: Json, n: Count) -> None:
    """Judge every result's length, and whether notes were accepted as their length says."""
    for event in events:
        if event["event"] == "call":
            cap = budget["manual_tokens" if event["data"].get("manual") else "result_tokens"]
            if event["name"] == "recall" and not event["is_error"]:
                cap = budget["recall_tokens"]
            shown = [{"type": "image", **event["data"]["picture"]}] if "picture" in event["data"] else []
            size = n(event["text"]) + picture_tokens(shown)
            assert cap is None or size <= cap, f"a result exceeds its cap: {event['text']!r}"
            is_long = event["data"].get("mistake") == "notes"
            assert is_long <= (event["name"] == "take_notes")
            if event["name"] == "take_notes" and (is_long or not event["is_error"]):
                text = json.loads(event["arguments"])["text"]
                assert is_long == (n(well_formed(text)) > budget["notes_tokens"])


def check_recalls(events: Sequence[Json], judge: Judge, budget: Json) -> None:
    """Judge every answer of `recall`: the longest beginning that fits of all that its query matches."""
    for event in events:
        if event["event"] != "call" or event["name"] != "recall" or event["is_error"]:
            continue
        query, having = json.loads(event["arguments"])["query"], documents(judge, event["turn"])
        judged = answer(query, having, budget["recall_tokens"], lambda text: judge.n(well_formed(text)))
        assert (event["text"], event["cut"]) == judged, f"the answer to {query!r} is {event['text']!r}, judged {judged}"
        asked = matching(query, having)
        assert event["data"]["recalled"] == asked[: max(1, len(event["data"]["recalled"]))]


def documents(judge: Judge, k: int) -> dict[int, str]:
    """The documents of a reply to the prompt of k turns: what these have shown and the prompt does not, by step."""
    visible = set()
    for i, hidden in judge.shown(k):
        turn = judge.turns[i]
        for was, now, step in zip(turn["messages"], judge.seen(i, k, hidden), turn["shows"], strict=True):
            if step is not None and not judge.is_marked(i, turn["messages"].index(was), now):
                visible.add(step)
    texts: dict[int, str] = {}
    for turn in judge.turns[:k]:
        for message, step in zip(turn["messages"], turn["shows"], strict=True):
            if step is not None and step not in texts:
                texts[step] = f"Step {step}, after {_played(turn, message)}:\n{plain_text(message['content'])}"
    return {step: texts[step] for step in sorted(texts) if step not in visible}


def _played(turn: Json, result: Json) -> str:
    [call] = [call for call in turn["messages"][0]["tool_calls"] if call["id"] == result["tool_call_id"]]
    if call["function"]["name"] == "observe":
        return "observe()"
    return 'act("' + str(json.loads(call["function"]["arguments"])["action"]).strip() + '")'


def check_memory(events: Sequence[Json], n: Count, budget: Json) -> None:
    """Judge every answer of `memory`, from the calls in their order on record."""
    if budget.get("memory_tokens") is None:
        return
    files, refused = Files(budget["memory_tokens"], lambda text: n(well_formed(text))), 0
    for event in events:
        if event["event"] == "end":
            assert event["result"].get("refused_memory", 0) == refused
        if event["event"] != "call" or event["name"] != "memory" or event.get("host") == "refused":
            continue
        mistake = event["data"].get("mistake")
        if mistake == "over" or (mistake == "malformed" and not is_object(event["arguments"])):
            continue
        text, judged = files.call(json.loads(event["arguments"]))
        assert (mistake or "", event["is_error"]) == (judged, judged != ""), f"{event['arguments']}: {event['text']}"
        refused += judged == "memory"
        if text is not None:
            shown = cut(text, budget["result_tokens"], lambda text: n(well_formed(text)))
            assert (event["text"], event["cut"]) == (shown, shown != text)
        assert files.size() <= budget["memory_tokens"]


def is_object(arguments: str) -> bool:
    """Whether arguments are the text of a JSON object that can be read."""
    try:
        return isinstance(json.loads(arguments), dict) and arguments_text(arguments) != "" and "NaN" not in arguments
    except (ValueError, RecursionError):
        return False


def check_pages(events: Sequence[Json], n: Count, budget: Json, whole: Sequence[str] | None) -> None:
    """Judge every observation that was too long, and every page of it that was read, from their whole texts."""
    if whole is None or budget.get("beyond_result", "cut") != "offload" or budget["result_tokens"] is None:
        return
    left, pages = iter(whole), Pages(budget["result_tokens"], lambda text: n(well_formed(text)))
    for event in events:
        if event["event"] != "call" or event["is_error"]:
            continue
        if event["name"] in ("act", "observe"):
            rest = next(left)
            shown = [{"type": "image", **event["data"]["picture"]}] if "picture" in event["data"] else []
            judged = pages.offload(rest, picture_tokens(shown))
            assert (event["text"], event["cut"]) == (judged, judged != rest)
        if event["name"] == "read_result":
            page = json.loads(event["arguments"])["page"]
            assert (event["text"], event["cut"], event["data"]["page"]) == (pages.read(page), False, page)


def check_end(events: Sequence[Json], judge: Judge, spent: int, answered: int) -> None:
    """Judge why an episode ended, where a budget is said to be the reason, and what the result counts."""
    for event in events:
        if event["event"] != "end":
            continue
        k, result = len(judge.turns), event["result"]
        assert (result["end_reason"] == "prompt_tokens") <= (not judge.pins_fit(k))
        if result["end_reason"] == "strategy_error":
            assert judge.size_of_view(k) > judge.cap
        if result["end_reason"] == "episode_tokens":
            due = judge.asks(k) and all(turn < k for turn, _ in judge.summaries)
            view = judge.request(k) if due else judge.view(k)
            assert view is not None
            left = allowed(events[0]["budget"], spent, view["tokens"])
            assert left is not None
            assert left < max(1, events[0]["budget"]["reply_tokens"] or 1)
        assert result.get("summaries", 0) == answered
        notes = sum(1 for event in events if event["event"] == "call" and event["data"].get("mistake") == "notes")
        assert result.get("refused_notes", 0) == notes
        recalls = [event for event in events if event["event"] == "call" and event["name"] == "recall"]
        assert result.get("recalls", 0) == sum(not event["is_error"] for event in recalls)
        pages = [event for event in events if event["event"] == "call" and event["name"] == "read_result"]
        assert result.get("pages", 0) == sum(not event["is_error"] for event in pages)


def stalled(events: Sequence[Json]) -> list[int]:
    """After every turn, how many turns in a row have shown nothing new: no step, and nothing that had not been seen."""
    counts: list[int] = []
    observed, manuals, accepted = set(), 0, {}
    for number in range(
        1 + max((event["turn"] for event in events if event["event"] in ("message", "call")), default=-1)
    ):
        news, foreign = False, False
        for event in events:
            if event.get("turn") != number:
                continue
            if event["event"] == "message" and event["by"] == "host" and "position" in event:
                foreign = True
            if event["event"] != "call" or event["is_error"]:
                continue
            match event["name"]:
                case "act":
                    news = True
                    observed.add(event["data"]["observation_step"])
                case "observe":
                    news |= event["data"]["observation_step"] not in observed
                    observed.add(event["data"]["observation_step"])
                case "read_manual":
                    manuals += bool(event["data"].get("manual"))
                    news |= manuals == 1 and bool(event["data"].get("manual"))
                case tool:
                    sent = json.loads(event["arguments"])
                    news |= accepted.get(tool) != sent
                    accepted[tool] = sent
        before = counts[-1] if counts else 0
        counts.append(0 if news else before if foreign else before + 1)
    return counts


def check_stalls(events: Sequence[Json]) -> None:
    """Judge whether the episode ended at the turn at which too many had shown nothing new, and at no other."""
    cap, counts, end = events[0]["budget"].get("stalled_turns"), stalled(events), events[-1]
    if end["event"] == "end" and end["result"]["end_reason"] == "stalled_turns":
        assert cap is not None
        assert counts[-1] == cap
        counts.pop()
    elif counts and (end["event"] != "end" or end["result"]["end_reason"] != "closed"):
        counts.pop()  # the last turn ended the episode for another reason, or is not complete
    assert cap is None or all(count < cap for count in counts), f"{counts} under a cap of {cap}"


def well_formed(text: str) -> str:
    """A text as it is counted: half a character is a replacement character."""
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")


def allowed(budget: Json, spent: int, prompt: int) -> int | None:
    """`max_tokens` of a reply."""
    limits = [budget["reply_tokens"]]
    if budget["episode_tokens"] is not None:
        limits.append(budget["episode_tokens"] - spent - prompt)
    return min((limit for limit in limits if limit is not None), default=None)
