"""Every player and adapter plays a whole game at every server that it can meet."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from tests.adapters.conformance import GAME, SEED
from tests.dialects.failures import Failure
from tests.dialects.page import PAGES, renewed
from tests.dialects.rules import Dialect
from tests.dialects.said import Json, Said, readable
from tests.dialects.scripts import HOSTILE, MIXED, SHORT
from tests.dialects.server import DialectServer
from tests.dialects.ways import PAIRS, Way, reached

pytestmark = pytest.mark.filterwarnings("ignore")

COUNTER = TokenCounter()
BUDGET = sp.Budget(prompt_tokens=1300, result_tokens=150, reply_tokens=300)
LEFT_OUT = (
    "chain versions provider usage id ids tool_call_id sha256 index input partial_json".split()  # noqa: SIM905
)
"""Fields in which streams may differ: ids that a server draws, and what a framework adds to parts of its messages."""
STRICT = ["OpenAI", "Mistral"]
QUICK = [
    (way, dialect)
    for way, dialect in PAIRS
    if way.is_here
    and (way.name in ("openai:", "openai-responses:") or (way.name.startswith("serve") and dialect.name in STRICT))
]
"""The pairs that fast tests play: OpenAI's players everywhere, the endpoints in front of the strictest servers."""
ONE_EACH = [(way, next(dialects)[1]) for way, dialects in groupby(PAIRS, key=lambda pair: pair[0])]
"""Each way in at one server."""


def game(
    way: Way, dialect: Dialect, script: Sequence[Said | Failure], stream: bool, budget: sp.Budget = BUDGET
) -> tuple[list[Json], DialectServer]:
    """Play a script; return the record and the server."""
    events: list[Any] = []
    with (
        reached(DialectServer(dialect, script, without=way.without(dialect))) as server,
        sp.Episode(GAME, seed=SEED, budget=budget, transcript=events) as episode,
    ):
        way.play(server, episode, stream)
    return json.loads(json.dumps(events)), server


def said_and_done(events: Sequence[Json]) -> list[Any]:
    """What a record holds of the game, whichever way a reply came."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items() if key not in LEFT_OUT}
        return [plain(item) for item in value] if isinstance(value, list) else value

    return [plain(event) for event in events if event["event"] != "usage"]


def check(events: Sequence[Json], server: DialectServer, end: str = "terminated") -> Json:
    """The game went on to its end, and the server was sent what it reads, all of it counted. Return the result."""
    result: Json = events[-1]["result"]
    needed = [words for rule, words in server.refused if not rule.optional]
    assert (needed, server.overlooked) == ([], [])
    assert len({rule.rule for rule, _ in server.refused}) == len(server.refused), (
        "what is optional is left out for good"
    )
    assert (result["end_reason"], result["error"]) == (end, None)
    views = [event for event in events if event["event"] == "view"]
    assert len(views) == len(server.requests), "every request is in the record"
    for view, body in zip(views, server.requests, strict=True):
        sent = [*readable(body.get("messages") or body["input"]), *readable(body.get("system", ""))]
        assert sum(map(COUNTER.text, sent)) <= view["tokens"] <= BUDGET.prompt_tokens, "what is sent is counted"
    return result


@pytest.mark.parametrize(("way", "dialect"), QUICK, ids=lambda value: value.name)
def test_a_short_game_is_played_to_its_end(way, dialect):
    events, server = game(way, dialect, SHORT, way.streams)
    assert check(events, server)["steps"] == 7


@pytest.mark.slow
@pytest.mark.parametrize(("way", "dialect"), PAIRS, ids=lambda value: value.name)
def test_a_game_with_every_reply_is_played_to_its_end(way, dialect):
    """Whole and, where there are streams, in pieces; frameworks with an reached of their own play there."""
    way.skip_if_missing()
    played = [game(way, dialect, MIXED, stream) for stream in sorted({False, way.streams})]
    assert [check(*each)["steps"] for each in played] == [7] * len(played)
    assert said_and_done(played[0][0]) == said_and_done(played[-1][0]) or not way.is_exact


@pytest.mark.slow
@pytest.mark.parametrize("name", ["broken JSON", "another tool", "nothing"])
@pytest.mark.parametrize(("way", "dialect"), ONE_EACH, ids=lambda value: value.name)
def test_a_reply_that_never_ends_ends_the_episode(way, dialect, name):
    """The same hostile reply again and again: the episode ends by its own rule, after few requests."""
    way.skip_if_missing()
    played = game(way, dialect, [HOSTILE[name]], way.streams)
    check(*played, end="no_tool_call" if name == "nothing" else "stalled_turns")


def test_the_page_has_the_tables_of_the_rules():
    """`python -m tests.dialects.page` writes them; each kind of end has a row."""
    pages = [path.read_text(encoding="utf-8") for path in PAGES]
    for page in pages:
        assert page == renewed(page)
    rows = (line.strip("| ").split(" | ") for page in pages for line in page.splitlines())
    ends = dict(row for row in rows if row[0].startswith("end: "))
    assert "`model_length` (Mistral)" in ends["end: cut"]
    assert "`refusal` (Anthropic)" in ends["end: refused"]
