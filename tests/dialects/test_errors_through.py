"""An error of each kind through every way in, in a request for a move and in one for a summary."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from datetime import date
from typing import Any

import pytest
from smartplay_gateway import WindowEndpoint

import smartplay_tools as sp
from smartplay_tools.players.server_errors import Row, rows
from tests.adapters.conformance import GAME, SEED
from tests.adapters.window_host import HostAgent
from tests.dialects.failures import Failure
from tests.dialects.rules import DIALECTS
from tests.dialects.said import Said
from tests.dialects.scripts import act
from tests.dialects.server import DialectServer
from tests.dialects.test_dialects import ONE_EACH
from tests.dialects.ways import Way, player, reached

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]

WORDS = "I have a plan, and it is a long one. " * 5
KINDS = {(row.whose, row.about): row for row in reversed(rows())}
"""A row of each kind."""
FULL = Row(
    "OpenAI",
    "prompt",
    '400 {"error": {"code": "context_length_exceeded", "message": "Full."}}',
    "",
    date.min,
    about="context",
)
"""A full context as OpenAI says it, which Inspect knows."""
SUMMARIES = sp.Budget(prompt_tokens=900, summary_tokens=40, slack=0.5)
RETRIES = ("openai:", "openai-responses:", "anthropic:", "langchain: (ChatOpenAI)", "langchain: (ChatAnthropic)")
"""The ways in whose player asks again; the others leave that to their framework."""


def played(way: Way, script: Sequence[Said | Failure], stream: bool, budget: sp.Budget) -> tuple[Any, DialectServer]:
    """Play a script at the first server of a way in, whatever it raises; return the result and the server."""
    dialect = next(dialect for other, dialect in ONE_EACH if other is way)
    with (
        reached(DialectServer(dialect, script, without=way.without(dialect))) as server,
        sp.Episode(GAME, seed=SEED, budget=budget, transcript=(events := [])) as episode,
        contextlib.suppress(Exception),
    ):
        way.play(server, episode, stream)
    assert sp.replay(events).identical
    return episode.result, server


@pytest.mark.parametrize("row", [*KINDS.values(), FULL], ids=lambda row: f"{row.whose} {row.about}")
@pytest.mark.parametrize("way", [way for way, _ in ONE_EACH], ids=lambda way: way.name)
def test_an_error_in_a_move_ends_only_what_it_has_to(way, row):
    way.skip_if_missing()
    for stream in sorted({False, way.streams}):
        script = [act(0, ""), Failure(row, "status"), *(act(at, "") for at in range(1, 7))]
        check(way, row, played(way, script, stream, sp.Budget())[0])


def check(way: Way, row: Row, result: sp.EpisodeResult) -> None:
    if row.whose == "model":
        assert (result.end_reason, result.steps, result.idle_replies) == ("terminated", 7, 1)
        assert result.tokens.provider.broken_calls == (way.name != "serve openai"), "completions do not say it"
    elif row.about == "moderation" and way.name == "Inspect AI":  # its own words in place of a reply
        assert (result.end_reason, result.tokens.provider.refused) == ("terminated", 1)
    elif row.whose == "prompt" and row.about:
        assert (result.end_reason, result.steps) == ("host", 1)
        assert ("--prompt-tokens" in result.detail) == (row.about == "context")
    elif result.end_reason != "terminated":  # raised to the user, or asked again by the framework
        assert (result.end_reason, result.steps) == ("player_error", 1)
        assert row.whose != "moment" or way.name not in RETRIES


@pytest.mark.parametrize("way", [way for way, _ in ONE_EACH], ids=lambda way: way.name)
def test_a_mistake_in_a_summary_is_an_empty_summary(way):
    way.skip_if_missing()
    script: list[Said | Failure] = [Said(words=WORDS, calls=act(at % 2).calls) for at in range(40)]
    _, server = played(way, script, False, SUMMARIES)
    asked = [number for number, body in enumerate(server.requests) if "earlier summary" in json.dumps(body)]
    script[asked[0]] = Failure(KINDS["model", "call"], "status")
    result, again = played(way, script, False, SUMMARIES)
    assert result.tokens.provider.broken_calls == (way.name != "serve openai")
    assert len(again.requests) > asked[0] + 1, "the game goes on"


@pytest.mark.parametrize("about", ["key", "quota", "model"])
def test_a_refused_account_leaves_an_episode_of_the_window_open(about):
    """Its agent is told so; with the account in order, its next request is answered, and nothing is lost."""
    script = [act(0, ""), Failure(KINDS["player", about], "status"), *(act(at, "") for at in range(1, 7))]
    with (
        reached(DialectServer(DIALECTS["OpenAI"], script)) as server,
        sp.Episode(GAME, seed=SEED, transcript=(events := [])) as episode,
        player(server, stream=True) as model,
        WindowEndpoint(model) as endpoint,
    ):
        host = HostAgent(endpoint, endpoint.serve(episode))
        host.answer(host.post())
        with pytest.raises(AssertionError, match="player_refused"):
            host.post()
        host.play()
    assert (episode.result.end_reason, episode.result.steps) == ("terminated", 7)
    assert episode.result.tokens.provider.requests == 8
    assert sp.replay(events).identical
