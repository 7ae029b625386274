"""What later prompts hold of a reply: arguments are objects, readable texts count, and version 1 stays as it was."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import example, given, strategies as st

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.episode.cells import cell_config
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import run_plan
from smartplay_tools.games.specs import get_spec
from smartplay_tools.records import sent_prompts
from smartplay_tools.types.arguments import read

GAME = "RockPaperScissorBasic-v0"
ROCK = '{"action": "Rock"}'
COUNTER = TokenCounter()


def reply(arguments: Any = ROCK, name: str = "act", **fields: Any) -> dict[str, Any]:
    call = {"id": "c", "type": "function", "function": {"name": name, "arguments": arguments}}
    return {"role": "assistant", "content": None, "tool_calls": [call], **fields}


def played(replies: list[dict[str, Any]], version: str = "v2", **budget: Any) -> tuple[list[Any], list[sp.Prompt]]:
    """The events and the prompts of an episode with these replies."""
    events: list[Any] = []
    config = cell_config(get_spec(GAME), budget=sp.Budget(**budget)).with_seed(1)
    config = config.model_copy(update={"prompts": version})
    prompts = []
    with sp.Episode.from_config(config, transcript=events) as episode:
        conversation = sp.Conversation(episode)
        for message in replies:
            prompts.append(conversation.prompt())
            conversation.receive(message)
        prompts.append(conversation.prompt())
    return events, prompts


def sent_arguments(prompt: sp.Prompt) -> list[str]:
    return [call["function"]["arguments"] for message in prompt.messages for call in message.get("tool_calls", ())]


@pytest.mark.parametrize(
    ("said", "sent"),
    [
        ("", "{}"),
        (None, "{}"),
        ("null", "{}"),
        (ROCK, ROCK),
        ('{ "action":"Rock" }', '{ "action":"Rock" }'),
        ({"action": "Rock"}, ROCK),
        ('{"action": "Ro', '{"arguments": "{\\"action\\": \\"Ro"}'),
        ('"Rock"', '{"arguments": "\\"Rock\\""}'),
        ("[1]", '{"arguments": "[1]"}'),
        ('{"action": NaN}', '{"arguments": "{\\"action\\": NaN}"}'),
        ('{"a": 1, "a": 2}', '{"arguments": "{\\"a\\": 1, \\"a\\": 2}"}'),
        ('{"action": 1e999}', '{"arguments": "{\\"action\\": 1e999}"}'),
        ('{"action": 1' + "0" * 400 + "}", '{"arguments": "{\\"action\\": 1' + "0" * 400 + '}"}'),
        ('{"action": "\\ud83d"}', '{"action": "\ufffd"}'),
        ('{"\\ud83d": 1, "\\ud83e": 2}', '{"arguments": "{\\"\\\\ud83d\\": 1, \\"\\\\ud83e\\": 2}"}'),
        ("{" * 300, '{"arguments": "' + "{" * 300 + '"}'),
    ],
)
def test_arguments_are_recorded_as_said_and_sent_as_an_object(said, sent):
    events, (_, prompt) = played([reply(said)])
    assert sent_arguments(prompt) == [sent]
    (message,) = [event["message"] for event in events if event["event"] == "message" and event["by"] == "player"]
    assert message["tool_calls"][0]["function"]["arguments"] == read(said).text
    *_, view = [event for event in events if event["event"] == "view"]
    assert view["tokens"] == COUNTER.prompt(prompt.messages, prompt.tools)
    *_, rebuilt = sent_prompts(events)
    assert rebuilt.sha256 == rebuilt.recorded_sha256
    assert rebuilt.prompt.messages == prompt.messages
    assert sp.replay(events).identical


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(st.characters(exclude_categories=())),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@example("\ud83d")
@example('{"a": "\ud83d", "b": 1e999}')
@given(st.text(st.characters(exclude_categories=())) | JSON.map(json.dumps) | JSON)
def test_whatever_a_model_wrote_is_an_object_that_every_server_reads(said):
    """Strictly: no NaN, no half character, no repeated key; and what is sent is its own form."""
    sent = read(said).sent

    def unique(pairs):
        assert len(dict(pairs)) == len(pairs)
        return dict(pairs)

    assert isinstance(json.loads(sent, object_pairs_hook=unique, parse_constant=pytest.fail), dict)
    if read(said).problem is None and sent == read(said).text:
        json.dumps(json.loads(sent), ensure_ascii=False).encode()
    assert read(sent).sent == sent


def test_a_head_with_an_earlier_chat_of_the_model_has_objects_too():
    chat = [reply('{"city": "Be', "weather"), {"role": "tool", "tool_call_id": "c", "content": "No."}]
    with sp.Episode(GAME, seed=1, transcript=(events := [])) as episode:
        prompt = sp.Conversation(episode, head=chat).prompt()
        assert sent_arguments(prompt) == ['{"arguments": "{\\"city\\": \\"Be"}']
    assert sp.replay(events).identical


THOUGHTS = "one by one the thoughts of a model"


@pytest.mark.parametrize(
    "fields",
    [
        {"reasoning_content": THOUGHTS},
        {"reasoning_details": [{"type": "reasoning.text", "text": THOUGHTS, "index": 0, "signature": "S" * 50}]},
        {"reasoning_details": [{"type": "reasoning.summary", "summary": THOUGHTS}]},
        {"thinking_blocks": [{"type": "thinking", "thinking": THOUGHTS, "signature": "S" * 50}]},
        {"reasoning": {"content": THOUGHTS}},
        {"reasoning_text": THOUGHTS},
        {"x": {"y": [{"z": THOUGHTS, "id": "i" * 50}]}},
        {"content": [{"type": "text", "text": "", "thoughts": THOUGHTS}]},
        {"provider_items": [{"type": "reasoning", "encrypted_content": "E" * 90, "summary": [{"text": THOUGHTS}]}]},
        {"provider_items": [{"type": "mine", "message": {"said": THOUGHTS}}], "reasoning_content": THOUGHTS},
    ],
)
def test_a_readable_text_counts_once_under_whatever_name(fields):
    plain, thinking = reply(), reply(**fields)
    _, (_, prompt) = played([thinking])
    (message,) = [message for message in prompt.messages if message["role"] == "assistant"]
    assert COUNTER.message(message) == COUNTER.message(plain) + COUNTER.text(THOUGHTS)


def test_data_that_nobody_reads_does_not_count():
    details = [{"type": "reasoning.encrypted", "data": "D" * 90, "id": "r1", "format": "anthropic-claude-v1"}]
    _, (_, prompt) = played([reply(reasoning_details=details)])
    assert COUNTER.messages(prompt.messages[2:3]) == COUNTER.message(reply())


UNTOUCHED = [reply(), reply('{"action":"Paper"}', content="I try."), reply("{}", "observe"), reply(content="Hm.")]
TOUCHED = [reply('{"action": "Ro'), reply("", "observe"), reply(reasoning_details=[{"text": "one", "more": "two"}])]


def test_prompts_without_thoughts_and_broken_calls_are_those_of_version_1():
    """Every event is the same, but for the version and the chain, which is a hash of it."""
    (first, prompts), (second, again) = played(UNTOUCHED, "v1"), played(UNTOUCHED, "v2")
    assert first[0]["config"].pop("prompts") == "v1"
    assert second[0]["config"].pop("prompts") == "v2"
    assert [{**event, "chain": ""} for event in first] == [{**event, "chain": ""} for event in second]
    assert prompts == again


def test_a_record_of_version_1_stays_what_it_was():
    """Arguments go back as they were said, and `text` alone counts of unknown thoughts, in a replay as in its play."""
    events, prompts = played(TOUCHED, "v1")
    assert sent_arguments(prompts[-1]) == ['{"action": "Ro', "", ROCK]
    counter = TokenCounter(version="v1")
    views = [event["tokens"] for event in events if event["event"] == "view"]
    assert views == [counter.prompt(prompt.messages, prompt.tools) for prompt in prompts]
    assert sp.replay(events).identical
    with sp.fork(events, 2, transcript=(further := [])) as forked:
        assert sent_arguments(forked.conversation.prompt()) == ['{"action": "Ro', ""]
        forked.conversation.receive(TOUCHED[2])
    assert further[0]["config"]["prompts"] == "v1"
    assert sp.replay(further).identical


def test_a_run_goes_on_with_the_prompts_with_which_it_began(tmp_path):
    """The same command finds its episodes, and adds further ones under the same rules."""
    cells = make_cells([GAME], ["rule"], [sp.Budget(tool_calls=4)])
    begun = run_plan(
        plan_episodes(cells, trials=1).with_prompts("v1"), tmp_path, ["rule"], RunOptions(executor="inline")
    )
    done = run_plan(plan_episodes(cells, trials=2), tmp_path, ["rule"], RunOptions(executor="inline"))
    assert [row["prompts"] for row in done.rows] == ["v1", "v1"]
    assert begun.rows[0] == done.rows[0]
