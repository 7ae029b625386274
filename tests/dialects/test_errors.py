"""Every error of the table, said as servers say it: what becomes of the game is a matter of whose error it is."""

from __future__ import annotations

import json
from datetime import date
from itertools import product
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.players import server_error
from smartplay_tools.players.server_errors import ANY, Row, rows
from tests.dialects.failures import Failure, How
from tests.dialects.rules import DIALECTS
from tests.dialects.said import Said
from tests.dialects.scripts import act
from tests.dialects.server import DialectServer
from tests.dialects.test_dialects import game
from tests.dialects.ways import WAYS, reached

pytestmark = pytest.mark.filterwarnings("ignore")

PLACES = {"chat": ("openai:", "OpenRouter"), "responses": ("openai-responses:", "OpenAI Responses")} | {
    "messages": ("anthropic:", "Anthropic")
}
"""By interface the player, and the server if the row's own does not speak it, as where a gateway passes it on."""
KINDS = [next(row for row in rows() if (row.whose, row.about) == kind) for kind in {(r.whose, r.about) for r in rows()}]


def played(row: Row, interface: str, how: How) -> tuple[dict, list[dict], int]:
    """Play a game with an error after the first move; return the result, the replies on record, and the requests."""
    way, place = PLACES[interface]
    own = DIALECTS.get(row.provider)
    dialect = own if own is not None and own.interface == interface else DIALECTS[place]
    script = [act(0, ""), Failure(row, how), *(act(at, "") for at in range(1, 7))]
    events, server = game(WAYS[way], dialect, script, how == "stream")
    assert sp.replay(events).identical
    messages = [event["message"] for event in events if event["event"] == "message" and event["by"] == "player"]
    return events[-1]["result"], messages, len(server.requests)


QUICK = [("chat", "status"), ("chat", "stream"), ("responses", "answer")]  # Anthropic's client takes a second to import
CASES = [
    pytest.param(row, *where, marks=() if row in KINDS and where in QUICK else pytest.mark.slow)
    for row, where in product(rows(), product(PLACES, ("status", "answer", "stream")))
    if where != ("messages", "stream")
]


@pytest.mark.parametrize(("row", "interface", "how"), CASES, ids=lambda value: getattr(value, "provider", value))
def test_an_error_ends_only_what_it_has_to(row, interface, how):
    result, replies, requests = played(row, interface, how)
    said = server_error(json.loads(row.says.partition(" ")[2]) if row.provider != ANY else {"error": {}})
    match row.whose:
        case "model" | "moment":
            assert (result["end_reason"], result["steps"], requests) == ("terminated", 7, 8)
            assert result["tokens"]["provider"]["requests"] == 8
            assert result["tokens"]["provider"].get("broken_calls", 0) == (row.whose == "model")
            assert replies[1].get("content") == ((said.reply or None) if row.whose == "model" else None)
        case "prompt" if row.about:
            assert (result["end_reason"], result["steps"], requests) == ("host", 1, 2)
            assert result["tokens"]["provider"].get("refused", 0) == (row.about == "moderation")
            assert ("--prompt-tokens" in result["detail"]) == (row.about == "context")
            assert said.tokens is None or f"{said.tokens:,} tokens" in result["detail"]
        case _:
            assert (result["end_reason"], result["steps"], requests) == ("player_error", 1, 2)
            assert ("ModelRefusedError" in result["error"]) == (row.whose == "player")
            plain = [words.rstrip(".") for words in said.words if row.whose == "player" and not {*words} & {*"'{"}]
            assert all(words in result["error"] for words in plain)


class Asking(DialectServer):
    """Plays, and answers a request for a summary or a compactor's question with a call that it cannot read."""

    questions = 0

    def answer(self, path: str, body: Any) -> tuple[int, str, bytes]:
        if body.get("tool_choice") not in ("none", {"type": "none"}):
            return super().answer(path, body)
        self.questions += 1
        broken = next(row for row in rows() if "tool_use_failed" in row.code)
        return Failure(broken, "status").answer(self.dialect.interface)


ASKS = [{"prompt_tokens": 600, "slack": 0.5, "summary_tokens": 60}, {"strategy": "summing"}]


def summing(self: Any, history: Any, room: Any) -> Any:
    """A compactor that asks after four turns."""
    if len(history) < 9:
        return history
    reply = yield [*history, {"role": "user", "content": "Sum up."}]
    return [{"role": "user", "content": f"So far: {reply['content']}"}, *history[-2:]]


@pytest.mark.parametrize("interface", ["chat", *(pytest.param(name, marks=pytest.mark.slow) for name in [*PLACES][1:])])
@pytest.mark.parametrize("options", ASKS)
def test_a_broken_call_in_place_of_a_summary_or_an_answer_ends_nothing(interface, options):
    """The model's words are the summary, or the answer to the compactor, and are not asked for again."""
    sp.register_strategy("summing", type("Summing", (), {"compact": summing}))
    budget = sp.Budget(history=None, tool_calls=20, **options)
    with (
        reached(Asking(DIALECTS[PLACES[interface][1]], [Said(calls=(("act", '{"action": "1"}'),))])) as server,
        sp.Episode("BanditTwoArmedHighLowFixed-v0", seed=1, budget=budget) as episode,
    ):
        WAYS[PLACES[interface][0]].play(server, episode, False)
    result = episode.result
    assert (result.end_reason, result.steps) == ("tool_calls", 20)
    assert 1 < server.questions == result.summaries + result.questions == result.tokens.provider.broken_calls
    assert any("<function=act>" in str(body) for body in server.requests)


def test_every_row_says_where_it_is_from_and_knows_its_own_error():
    for row in rows():
        assert row.source
        assert row.read >= date(2026, 11, 26)
        assert row.provider in {*DIALECTS, ANY}
        body = json.loads(row.says.partition(" ")[2])
        if row.provider != ANY:
            said = server_error({"error": body} if isinstance(body, list) else body)
            assert (said.whose, said.about) == (row.whose, row.about)


@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        ("Please retry in 36.429760048s.", 36.429760048),
        ("Please try again in 20s.", 20),
        ("Please try again in 6m0s. Visit the page.", 360),
        ("Please try again in 120ms", 0.12),
        ("Please retry after 22 seconds.", 22),
        ("Please try again in 9m38.016s. Need more tokens?", 578.016),
        ("Please try again later.", None),
    ],
)
def test_the_wait_that_a_server_names(words, seconds):
    assert server_error({"error": {"message": words, "code": 429}}).wait == seconds


def test_words_of_the_model_or_of_the_prompt_sort_nothing():
    flagged = {"code": 403, "metadata": {"flagged_input": "maximum context length is 3 tokens"}}
    assert server_error({"error": flagged}).whose == "player"
    deep = {"message": "Overloaded"}
    for _ in range(2000):
        deep = {"error": deep}
    assert server_error(deep).whose == "moment"
