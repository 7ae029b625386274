"""The edits of providers at the endpoint, judged: `python -m tests.adapters.endpoint_edits_judge --histories 5000`.

Random conversations go through `ContextEndpoint` with random edits and caps, over the three routes, streamed and whole.
What the upstream has to be sent, and what the answer has to report, is decided by the definitions alone
(`provider_edits_judge.Judge`), on tokens that `tests/manager/judge.py` counts.
"""

from __future__ import annotations

import argparse
import json
import random
from collections import Counter
from dataclasses import dataclass
from typing import Any

import httpx2
from smartplay_gateway import ContextEndpoint

import smartplay_tools as sp
from smartplay_tools.compactors.provider_edits import INSTRUCTIONS
from tests.adapters.test_context_endpoint import JSON, MESSAGE, RESPONSE, STREAM, Upstream, events
from tests.counting import Json
from tests.manager.histories import FORMS, Messages, chat
from tests.manager.judge import Letters, is_broken, total
from tests.provider_edits_judge import BEFORE, BOTH, FIELDS, USES, Judge, edit

BETAS = "context-management-2025-06-27, compact-2026-01-12"
SUMMARY = "Page 3 is next."
PARTS = {"anthropic": {"type": "text", "text": SUMMARY}, "responses": {"type": "output_text", "text": SUMMARY}}
SAID = {"id": "x", "type": "message", "role": "assistant", "status": "completed", "content": [PARTS["responses"]]}
ANSWERS: dict[str, Json] = {
    "anthropic": {**MESSAGE, "content": [PARTS["anthropic"]], "stop_reason": "end_turn"},
    "responses": {**RESPONSE, "status": "completed", "output": [SAID]},
}
PATHS = {"anthropic": "messages", "responses": "responses"}


class EndpointJudge(Judge):
    """Counts a conversation as it is sent in a form."""

    form = "anthropic"

    def tokens(self, messages: Messages) -> int:
        return total(self.form, FORMS[self.form](messages))

    def reports(self, every: Messages) -> tuple[Messages, list[Json]]:
        """The messages after the edits, and what the provider reports of those that were applied."""
        edits = self.options["edits"] if self.kind == BOTH else [{"type": self.kind, **self.options}]
        told: list[Json] = []
        for options in edits:
            before, every = every, EndpointJudge(options["type"], options, []).edited(every)
            if every is not before:
                name, left = ("tool_uses", results) if options["type"] == USES else ("thinking_turns", turns)
                saved, number = self.tokens(before) - self.tokens(every), left(before) - left(every)
                own = {f"cleared_{name}": number, "cleared_input_tokens": saved}
                told.append({"type": options["type"], **own})
        return every, told


def results(messages: Messages) -> int:
    """How many results are not cleared."""
    return sum(message["role"] == "tool" and message["content"] != "[cleared]" for message in messages)


def turns(messages: Messages) -> int:
    """How many turns have thoughts."""
    found, turn = set[int](), 0
    for message in messages:
        turn += message["role"] == "user"
        found |= {turn} if FIELDS & message.keys() else set()
    return len(found)


def stream_of(form: str) -> bytes:
    """The answer as a stream: what it begins with, and its last events."""
    whole = ANSWERS[form]
    if form == "responses":
        return events({"type": "response.completed", "response": whole, "sequence_number": 0})
    delta = {"type": "message_delta", "delta": {"stop_reason": "end_turn"}, "usage": {"output_tokens": 2}}
    return events({"type": "message_start", "message": {**whole, "content": []}}, delta, {"type": "message_stop"})


def told_in(content: bytes, form: str, *, is_streamed: bool) -> Json:
    """The answer, or the event of a stream that holds what was done to the prompt."""
    if not is_streamed:
        return dict(json.loads(content))
    datas = [line[5:].strip() for line in content.decode().splitlines() if line.startswith("data:")]
    found = [json.loads(data) for data in datas if data != "[DONE]"]
    (last,) = [each for each in found if each["type"] in ("message_delta", "response.completed")]
    return dict(last.get("response", last))


COMPACTIONS = ("compact_20260112", "compaction")


@dataclass
class Asked:
    """A request, and by what it is judged."""

    form: str
    path: str
    history: Messages
    judge: EndpointJudge
    cap: int | None
    body: Json

    @property
    def is_at_once(self) -> bool:
        return self.path.endswith("compact")

    @property
    def kept(self) -> Messages:
        """The words that a compaction keeps."""
        return [each for each in self.history if each["role"] == "user"] if self.form == "responses" else []

    @property
    def is_due(self) -> bool:
        """Whether a summary has to be asked for, in a prompt that may be too long for the cap."""
        judge, limit = self.judge, self.judge.options.get("trigger", self.judge.options.get("compact_threshold"))
        if judge.kind not in COMPACTIONS:
            return False
        least = judge.tokens([*self.kept, {"role": "user", "content": BEFORE}])
        if self.is_at_once:
            return least <= (self.cap or least)
        return judge.tokens(self.history) > limit and least <= min(limit, self.cap or limit)


def draw(rng: random.Random) -> Asked:
    """Draw a request."""
    form = rng.choice(["anthropic", "anthropic", "responses"])
    history = [each for each in chat(rng, rng.choice(["task", "chat", "parallel"])) if each["role"] != "system"]
    kind, options = edit(rng, rng.randrange(400, 2_500))
    if form == "responses":
        kind, options = "compaction", {"compact_threshold": rng.randrange(1, 4_000)}
    elif kind in COMPACTIONS:
        kind, options = "compact_20260112", {"trigger": rng.randrange(1, 4_000)}
    edits = options["edits"] if kind == BOTH else [{"type": kind, **options}]
    edits = [each if "trigger" not in each else {**each, "trigger": as_sent(each["trigger"])} for each in edits]
    path, given = PATHS[form], FORMS[form](history)
    body: Json = {"model": "m", "stream": rng.random() < 0.5, "context_management": edits, "input": given}
    if form == "anthropic":
        body = {**body, "messages": body.pop("input"), "max_tokens": 90, "thinking": {"type": "adaptive"}}
        body["context_management"] = {"edits": edits}
    elif rng.random() < 0.3:
        path, body = "responses/compact", {"model": "m", "input": given}
    judge = EndpointJudge(kind, options, [])
    judge.form = form
    return Asked(form, path, history, judge, rng.choice([None, 800, 2_000]), body)


def as_sent(trigger: Any) -> Json:
    """A trigger in the provider's form."""
    return trigger if isinstance(trigger, dict) else {"type": "input_tokens", "value": trigger}


def spoil(asked: Asked, headers: dict[str, str], rng: random.Random) -> None:
    """Make of a request one that the provider would refuse."""
    managed = asked.body["context_management"]
    edits = managed["edits"] if asked.form == "anthropic" else managed
    name = {"compact_20260112": "trigger", "compaction": "compact_threshold"}.get(edits[0]["type"], "keep")
    value = rng.choice([0.5, -1, True, [], {"type": "turns", "value": 1}, {"type": "tool_uses"}])
    change = rng.choice([{"type": "clear_all"}, {"type": 3}, {"keeps": 3}, {name: value}])
    if asked.form == "anthropic" and rng.random() < 0.25:
        del headers["anthropic-beta"]
    else:
        edits[0] = {**edits[0], **change}


def check(seed: int, upstream: Upstream, found: Counter[str]) -> None:
    """Send one conversation, and judge the request that reaches the upstream, and the answer."""
    rng = random.Random(f"endpoint {seed}")
    asked, headers = draw(rng), {"anthropic-beta": BETAS}
    is_bad = not asked.is_at_once and rng.random() < 0.15
    if is_bad:
        spoil(asked, headers, rng)
    form, cap, is_streamed = asked.form, asked.cap, bool(asked.body.get("stream"))
    whole = (json.dumps(ANSWERS[form]).encode(), JSON)
    answer = (stream_of(form), STREAM) if is_streamed else whole
    upstream.requests.clear()
    upstream.script = [whole, answer] if asked.is_due else [answer]
    manager = sp.ContextManager(cap, tokenizer=Letters(), result_tokens=None, history=None)
    with ContextEndpoint(f"{upstream.url}/v1", manager) as endpoint:
        got = httpx2.post(f"{endpoint.url}/v1/{asked.path}", json=asked.body, headers=headers, timeout=60)
    found["histories"] += 1
    sent = [json.loads(content)["messages" if form == "anthropic" else "input"] for *_, content in upstream.requests]
    for prompt in sent:
        assert not is_broken(form, prompt), "A call or a result is alone."
        assert cap is None or total(form, prompt) <= cap, "A prompt is over its cap."
    if got.status_code != 200:
        assert is_bad or cap is not None, got.text
        assert not sent
        assert got.json()["error"]["type"] == "invalid_request_error"
        found["bad input" if is_bad else "too long"] += 1
        return
    assert not is_bad, f"{asked.body['context_management']} is taken."
    told = told_in(got.content, form, is_streamed=is_streamed)
    if asked.is_due and len(sent) == 1 + (not asked.is_at_once):
        check_compaction(asked, sent, told)
        found[f"compacted by {asked.path}"] += 1
        return
    assert len(sent) == 1
    assert not asked.is_due or cap is not None, "No question is asked."
    edited, reports = (asked.history, []) if asked.judge.kind in COMPACTIONS else asked.judge.reports(asked.history)
    wanted = FORMS[form](edited)
    if cap is None or total(form, wanted) <= cap:
        assert sent[0] == wanted
    else:
        found["cut to the cap"] += 1
        others = [each for each in sent[0] if each not in wanted]
        assert all("tool_result" in str(each) or "_output" in str(each.get("type")) for each in others), others
    if asked.judge.kind not in COMPACTIONS:
        assert told["context_management"]["applied_edits"] == reports
        found[f"cleared by {asked.judge.kind}"] += bool(reports)


def check_compaction(asked: Asked, sent: list[Messages], told: Json) -> None:
    """Judge a request in which a summary was asked for."""
    question, summary = ({"role": "user", "content": text} for text in (INSTRUCTIONS, BEFORE + SUMMARY))
    assert sent[0][-1]["content"] == INSTRUCTIONS
    assert asked.cap is not None or sent[0] == FORMS[asked.form]([*asked.history, question])
    assert asked.is_at_once or sent[1] == FORMS[asked.form]([*asked.kept, summary])
    if asked.form == "responses":
        assert told["output"][-1 if asked.is_at_once else 0]["type"] == "compaction"
    else:
        assert told["usage"]["iterations"][0]["type"] == "compaction"


def main(histories: int, seed: int = 0) -> Counter[str]:
    """Judge so many histories."""
    found, upstream = Counter[str](), Upstream()
    try:
        for number in range(histories):
            check(seed + number, upstream, found)
    finally:
        upstream.close()
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--histories", type=int, default=5_000)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    print(dict(main(chosen.histories, chosen.seed)))
