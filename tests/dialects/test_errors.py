"""Every error of the table, said as servers say it: what becomes of the game is a matter of whose error it is."""

from __future__ import annotations

import json
from datetime import date
from itertools import product

import pytest

from smartplay_tools.players import server_error
from smartplay_tools.players.server_errors import ANY, Row, rows
from tests.dialects.failures import Failure, How
from tests.dialects.rules import DIALECTS
from tests.dialects.scripts import act
from tests.dialects.test_dialects import game
from tests.dialects.ways import WAYS

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
    messages = [event["message"] for event in events if event["event"] == "message" and event["by"] == "player"]
    return events[-1]["result"], messages, len(server.requests)


QUICK = [("chat", "stream"), ("responses", "answer"), ("messages", "status")]
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
        case "model":
            assert (result["end_reason"], result["steps"], requests) == ("terminated", 7, 8)
            assert result["tokens"]["provider"]["broken_calls"] == 1
            assert replies[1]["content"] == (said.reply or None)
        case "moment":
            assert (result["end_reason"], result["steps"], requests) == ("terminated", 7, 8)
            assert result["tokens"]["provider"]["requests"] == 8
        case "prompt" if row.about:
            assert (result["end_reason"], result["steps"], requests) == ("host", 1, 2)
            assert result["tokens"]["provider"].get("refused", 0) == (row.about == "moderation")
            assert ("--prompt-tokens" in result["detail"]) == (row.about == "context")
            assert said.tokens is None or f"{said.tokens:,} tokens" in result["detail"]
        case _:
            assert (result["end_reason"], result["steps"], requests) == ("player_error", 1, 2)
            assert ("ModelRefusedError" in result["error"]) == (row.whose == "player")
            assert all(words.rstrip(".") in result["error"] for words in said.words if not {*words} & {*"'{"})


def test_every_row_says_where_it_is_from_and_knows_its_own_error():
    for row in rows():
        assert row.source
        assert row.read >= date(2026, 11, 29)
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
