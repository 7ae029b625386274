"""Every player and adapter plays a whole game at every server that it can meet."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pytest

import smartplay_tools as sp
from tests.adapters.conformance import GAME, SEED
from tests.dialects.rules import Dialect
from tests.dialects.said import Json, Said, readable
from tests.dialects.scripts import MIXED
from tests.dialects.server import DialectServer
from tests.dialects.ways import PAIRS, Way, environment

pytestmark = pytest.mark.filterwarnings("ignore")

BUDGET = sp.Budget(prompt_tokens=1300, result_tokens=150, reply_tokens=300)
LEFT_OUT = frozenset("chain versions provider usage id ids tool_call_id sha256 index input partial_json".split())
"""Fields in which streams may differ: ids that a server draws, and what a framework adds to the parts of its messages."""


def game(way: Way, dialect: Dialect, script: Sequence[Said], stream: bool) -> tuple[list[Json], DialectServer]:
    """Play a script; return the record and the server."""
    events: list[Any] = []
    with (
        DialectServer(dialect, script, without=way.without(dialect)) as server,
        pytest.MonkeyPatch.context() as variables,
        sp.Episode(GAME, seed=SEED, budget=BUDGET, transcript=events) as episode,
    ):
        for name, value in environment(server).items():
            variables.setenv(name, value)
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
        sent = body.get("messages") or body["input"]
        seen = sum(map(counter(), [*readable(sent), *readable(body.get("system", ""))]))
        assert seen <= view["tokens"] <= BUDGET.prompt_tokens, "what is sent is counted"
    return result


def counter() -> Any:
    from smartplay_tools.context.tokens import TokenCounter

    return TokenCounter().text


@pytest.mark.parametrize(("way", "dialect"), PAIRS, ids=lambda value: value.name)
def test_a_game_is_played_to_its_end(way, dialect):
    if not way.is_here:
        pytest.skip(f"needs {way.needs}; `.ci/run` has an environment with it")
    events, server = game(way, dialect, MIXED, False)
    result = check(events, server)
    assert result["steps"] == 7
    if way.streams:
        streamed, server = game(way, dialect, MIXED, True)
        check(streamed, server)
        assert said_and_done(streamed) == said_and_done(events)
