"""A prompt for a summary on the wire: it has the tools, which providers require next to calls, and chooses none."""

from __future__ import annotations

import pytest

import smartplay_tools as sp

BANDIT = "BanditTwoArmedHighLowFixed-v0"


def prompts() -> tuple[sp.Prompt, sp.Prompt]:
    """A prompt to play, and one for a summary."""
    budget = sp.Budget(history=None, prompt_tokens=600, slack=0.5, summary_tokens=60)
    conversation = sp.Conversation(sp.Episode(BANDIT, seed=1, budget=budget))
    player = sp.get_player("rule")
    first = conversation.prompt()
    prompt = first
    while prompt.purpose == "play":
        conversation.receive(player.reply(prompt).message)
        prompt = conversation.prompt()
    return first, prompt


@pytest.mark.parametrize(
    ("name", "choice"),
    [
        ("openai:m", "none"),
        ("openai-responses:m", "none"),
        pytest.param("anthropic:m", {"type": "none"}, marks=pytest.mark.slow),
    ],
)
def test_the_tools_are_sent_and_none_is_chosen(name, choice):
    pytest.importorskip(name.partition("-")[0].partition(":")[0])
    play, summary = prompts()
    player = sp.get_player(name, base_url="http://127.0.0.1:9/v1", api_key="none")
    assert "tool_choice" not in player.request(play)
    asked = player.request(summary)
    assert asked["tool_choice"] == choice
    assert len(asked["tools"]) == 3
    assert "about to leave your view" in str(asked)


BUDGET = sp.Budget(history=None, prompt_tokens=900, slack=0.5, summary_tokens=120)


def by_langchain(episode: sp.Episode) -> None:
    agents, adapter = pytest.importorskip("langchain.agents"), pytest.importorskip("smartplay_langchain")
    model = adapter.PlayerChatModel(player=sp.get_player("rule-notes"))
    agents.create_agent(model, middleware=[adapter.SmartPlayMiddleware(episode)]).invoke({"messages": []})


def by_endpoint(episode: sp.Episode, player: str = "openai") -> None:
    pytest.importorskip("openai")
    gateway = pytest.importorskip("smartplay_gateway")
    with gateway.LocalEndpoint(sp.get_player("rule-notes")) as endpoint:
        asking = sp.get_player(f"{player}:rule-notes", base_url=endpoint.base_url)
        sp.play(episode, asking)
        asking.close()


def by_responses(episode: sp.Episode) -> None:
    by_endpoint(episode, "openai-responses")


@pytest.mark.slow
@pytest.mark.parametrize("play", [by_langchain, by_endpoint, by_responses])
def test_a_player_behind_an_interface_is_asked_for_summaries(play):
    """Nothing but the question says so there; the player answers it with its memory, as in a loop of its own."""
    budget = BUDGET.model_copy(update={"tool_calls": 25})
    with sp.Episode(BANDIT, seed=1, budget=budget) as episode:
        play(episode)
    with sp.Episode(BANDIT, seed=1, budget=budget) as direct:
        sp.play(direct, sp.get_player("rule-notes"))
    assert direct.result.summaries > 1
    assert direct.result.empty_summaries == 0
    counts = ("summaries", "score", "state_hash", "turns", "refused_calls", "end_reason", "empty_summaries")
    assert [getattr(episode.result, name) for name in counts] == [getattr(direct.result, name) for name in counts]
    assert episode.result.tokens.summary_reply == direct.result.tokens.summary_reply
