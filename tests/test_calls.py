"""Calls, by example: what a model can send, and the results."""

from __future__ import annotations

import inspect
import json

import pytest

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.types import ToolCall
from smartplay_tools.types.arguments import read

RPS, HANOI = "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"
COUNT = TokenCounter().text
LEGAL = "1. Rock\n2. Paper\n3. Scissor"


@pytest.fixture
def episode():
    with sp.Episode(RPS, seed=1) as episode:
        yield episode


def test_act_plays_and_shows_the_new_observation(episode):
    result = episode.call("act", '{"action": "Rock"}')
    assert result.text.startswith("You chose Rock, and the opponent chose")
    assert not result.is_error
    assert result.data["step"] == result.data["observation_step"] == 1
    assert result.data["legal"] is True
    assert result.data["state_hash"] == episode.game.state_hash()


def test_observe_shows_the_current_observation_without_playing(episode):
    assert episode.call("observe").text == "New round begins."
    shown = episode.call("act", {"action": "Paper"}).text
    assert episode.call("observe").text == shown
    assert episode.stats.steps == 1


@pytest.mark.parametrize("nothing", [None, "", "{}", {}])
def test_no_arguments_may_be_sent_in_any_way(episode, nothing):
    assert not episode.call("observe", nothing).is_error
    assert episode.call("read_manual", nothing).text == episode.game.manual


@pytest.mark.parametrize("sent", ["Rock", "rock", " ROCK\n", "Rock.", "1", "1.", "1. Rock", "1. rock.", "001", 1])
def test_an_action_goes_by_its_name_or_its_number(episode, sent):
    assert episode.call("act", {"action": sent}).text.startswith("You chose Rock")


def test_the_number_may_be_a_number_and_is_recorded_as_it_was_said(tmp_path):
    """Hosts turn "1" into 1, and models write it. Records of version 1, where it was a mistake, stay as they are."""
    with sp.Episode(RPS, seed=1, transcript=tmp_path / "1.jsonl") as episode:
        assert episode.call("act", '{"action": 1}').text.startswith("You chose Rock")
        assert episode.call("act", {"action": 3}).text.startswith("You chose Scissor")
        assert episode.functions()[1](2).startswith("You chose Paper")
        assert episode.call("act", {"action": 4}).text.startswith('Error: "4" is not a legal action.')
    calls = [event["arguments"] for event in sp.read_transcript(tmp_path / "1.jsonl") if event["event"] == "call"]
    assert calls == [f'{{"action": {number}}}' for number in (1, 3, 2, 4)]
    old = sp.Episode.from_config(episode.config.model_copy(update={"prompts": "v1"}))
    assert old.call("act", '{"action": 1}').text.startswith('Error: `action` must be a string: "{"action": 1}".')
    assert old.tools == episode.tools


@pytest.mark.parametrize(
    "sent",
    ["", "Roc", "Rock!", "Rock please", "0", "4", "0001", "1) Rock", "2. Rock", "1.5", "1 .", "١", "Rock\x00", "-1"],
)
def test_nothing_else_is_an_action(episode, sent):
    result = episode.call("act", {"action": sent})
    assert result.is_error
    assert result.text == f'Error: "{sent}" is not a legal action. The legal actions are:\n{LEGAL}'
    assert (episode.stats.illegal_actions, episode.stats.malformed_calls, episode.stats.steps) == (1, 0, 0)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ("{", "The arguments are not valid JSON"),
        ("null", "The arguments are not a JSON object"),
        ('["Rock"]', "The arguments are not a JSON object"),
        ('"Rock"', "The arguments are not a JSON object"),
        ("Rock", "The arguments are not valid JSON"),
        ('{"action": "Rock", "action": "Paper"}', "The arguments have a key that stands twice"),
        ('{"action": NaN}', "The arguments hold NaN, which is not JSON"),
        ('{"action": ' + "[" * 3_000 + "]" * 3_000 + "}", "The arguments are nested too deep"),
        ('{"action": "' + "R" * 10_000 + '"}', "The arguments are longer than 10,000 characters"),
        ('{"action": ' + "1" * 5_000 + "}", "The arguments hold a number that is too long to read"),
        (None, "The argument `action` is missing"),
        ("{}", "The argument `action` is missing"),
        ('{"actoin": "Rock"}', "The argument `action` is missing"),
        ('{"action": "Rock", "why": "luck"}', "The argument `action` must be the only argument"),
        ('{"action": true}', "`action` must be a string"),
        ('{"action": 1.0}', "`action` must be a string"),
        ('{"action": 1.5}', "`action` must be a string"),
        ('{"action": null}', "`action` must be a string"),
        ('{"action": ["Rock"]}', "`action` must be a string"),
        ({"action": {"name": "Rock"}}, "`action` must be a string"),
    ],
)
def test_malformed_arguments_are_told_and_counted(episode, arguments, problem):
    result = episode.call("act", arguments)
    assert result.is_error
    assert result.text.startswith(f"Error: {problem}")
    assert result.text.endswith(f'Call act with {{"action": "Rock"}}, for example. The legal actions are:\n{LEGAL}')
    assert (episode.stats.malformed_calls, episode.stats.illegal_actions, episode.stats.steps) == (1, 0, 0)


@pytest.mark.parametrize("tool", ["observe", "read_manual"])
def test_a_tool_without_arguments_takes_none(episode, tool):
    result = episode.call(tool, '{"step": 3}')
    assert result.text == f'Error: Unexpected arguments: "{{"step": 3}}". Call {tool} without arguments.'
    assert episode.stats.malformed_calls == 1


@pytest.mark.parametrize("name", ["reset", "Act", "act ", "", "seed", "a" * 500])
def test_an_unknown_tool_is_told_which_there_are(episode, name):
    result = episode.call(name, '{"action": "Rock"}')
    quoted = name if len(name) <= 80 else name[:80] + "…"
    assert result.text == f'Error: There is no tool "{quoted}". The tools are observe, act, read_manual.'
    assert episode.stats.malformed_calls == 1


def test_a_name_may_be_anything_that_json_can_hold(tmp_path):
    deep: list = []
    for _ in range(100_000):
        deep = [deep]
    with sp.Episode(RPS, seed=1, transcript=tmp_path / "names.jsonl") as episode:
        for name in (None, 3, 10**5_000, ["act"], {"name": "act"}, deep):
            result = episode.call(name, '{"action": "Rock"}', call_id=["odd"])
            assert result.text.startswith("Error: There is no tool") or result.text.startswith("Error: This call id")
    assert sp.replay(tmp_path / "names.jsonl").identical


def test_an_error_quotes_at_most_80_characters(episode):
    result = episode.call("act", {"action": "x" * 3_000})
    assert f'"{"x" * 80}…"' in result.text
    assert "x" * 81 not in result.text


def test_half_a_character_is_quoted_in_words_that_a_request_can_hold():
    record = []
    with sp.Episode(RPS, seed=1, context="host", transcript=record) as episode:
        for half in ({"action": "half \ud83d"}, '{"action": "half \\ud83d"}'):
            assert '"half \ufffd"' in episode.call("act", half).text
        assert '"half \ufffd"' in episode.functions()[1]("half \ud83d")
    assert '"half \ud83d"' in record[1]["text"]
    assert sp.replay(record).identical


def test_an_illegal_move_of_the_game_is_the_games_business():
    with sp.Episode(HANOI, seed=0) as episode:
        result = episode.call("act", {"action": "Move the top disk of rod B to the top of rod A"})
    assert not result.is_error
    assert result.data["reward"] == -1
    assert episode.result.illegal_actions == 0
    assert episode.result.steps == 1


def test_the_last_step_says_so_and_later_calls_are_refused():
    with sp.Episode("BanditTwoArmedHighLowFixed-v0", seed=0) as episode:
        results = [episode.call("act", {"action": "1"}) for _ in range(51)]
    assert results[49].done
    assert results[49].text.endswith("\nThe game is over.")
    assert results[50].is_error
    assert results[50].done
    assert "over (rollout)" in results[50].text
    assert (episode.result.steps, episode.result.tool_calls, episode.result.end_reason) == (50, 50, "rollout")


def test_a_batch_runs_in_the_order_of_the_message():
    moves = ["Move the top disk of rod A to the top of rod C", "Move the top disk of rod A to the top of rod B"]
    with sp.Episode(HANOI, seed=0) as episode:
        calls = [ToolCall("act", {"action": move}) for move in moves]
        first, second = episode.call_batch(calls)
    assert "- B: |bottom, [1], top|\n- C: |bottom, [0], top|" in second.text
    assert "- B: |bottom, [], top|" in first.text
    assert episode.result.turns == 1


def test_first_act_refuses_the_other_actions_of_a_message():
    with sp.Episode(RPS, seed=0, batch="first_act") as episode:
        calls = [ToolCall("observe"), ToolCall("act", {"action": "1"}), ToolCall("act", {"action": "2"})]
        _, played, refused = episode.call_batch(calls)
        assert not played.is_error
        assert refused.is_error
        assert episode.stats.steps == 1
        assert not episode.call("act", {"action": "2"}).is_error
    assert episode.result.refused_calls == 1


class TestManual:
    def test_pinned_it_stands_in_the_system_message(self):
        with sp.Episode(RPS, seed=1, manual="pinned") as episode:
            assert episode.head[0]["content"].endswith(f"\n\n{episode.game.manual}")
            assert episode.call("read_manual").text == "The manual stands at the end of the system message."

    def test_withheld_the_tool_says_so(self):
        with sp.Episode(RPS, seed=1, manual="none") as episode:
            assert episode.call("read_manual").text == "There is no manual for this game."
            assert [tool.name for tool in episode.tools] == ["observe", "act", "read_manual"]


class TestCuts:
    """A result is cut once, to its cap, and says what is missing."""

    def test_an_observation_loses_its_end(self):
        with sp.Episode(HANOI, seed=1, budget=sp.Budget(result_tokens=20)) as episode:
            text = episode.call("observe").text
            kept, notice = text.rsplit("\n", 1)
            assert episode.game.observation.startswith(kept)
            missing = COUNT(episode.game.observation) - COUNT(kept)
            assert abs(int(notice.split()[0].strip("[")) - missing) <= 1
        assert episode.result.cut_results == 1

    def test_the_manual_loses_its_middle_at_line_borders(self):
        with sp.Episode(HANOI, seed=1, budget=sp.Budget(result_tokens=150)) as episode:
            above, below = episode.call("read_manual").text.split(" tokens cut]\n")
            lines = episode.game.manual.splitlines()
            kept = above.splitlines()[:-1]
            assert kept == lines[: len(kept)]
            assert below.splitlines() == lines[-len(below.splitlines()) :]


class TestHostContext:
    """If a host's agent manages the context, the history is in the result of `observe`."""

    def test_observe_gives_the_history_as_the_original_prints_it(self):
        with sp.Episode(RPS, seed=1, context="host", budget=sp.Budget(history=2)) as episode:
            assert episode.call("observe").text == "New round begins."
            seen = [episode.call("act", {"action": "1"}).text for _ in range(3)]
            assert episode.call("observe").text == (
                "Most recent 2 steps of the player's in-game observation:\n\n"
                f"Player Observation Step 1:\n{seen[0]}\n\nPlayer Observation Step 2:\n{seen[1]}\n\n{seen[2]}"
            )

    def test_a_cut_drops_the_oldest_steps(self):
        with sp.Episode(RPS, seed=1, context="host", budget=sp.Budget(result_tokens=80)) as episode:
            seen = [episode.call("act", {"action": "1"}).text for _ in range(10)]
            text = episode.call("observe").text
            assert COUNT(text) <= 80
            notice, history = text.split("\n\n", 1)
            assert notice.endswith("tokens cut]")
            assert history.startswith("Most recent 1 steps")
            assert history.endswith(f"Player Observation Step 9:\n{seen[8]}\n\n{seen[9]}")


def test_the_functions_are_plain_annotated_documented_callables(episode):
    observe, act, read_manual = episode.functions()
    assert [function.__name__ for function in (observe, act, read_manual)] == ["observe", "act", "read_manual"]
    assert inspect.get_annotations(act, eval_str=True) == {"action": str, "return": str}
    assert "1. Rock" in act.__doc__
    assert "action: The action's name or number" in act.__doc__
    assert act("Rock").startswith("You chose Rock")
    assert act(action="9").startswith("Error: ")
    assert observe().startswith("You chose Rock")
    assert read_manual() == episode.game.manual


def test_closing_ends_and_may_be_done_twice():
    episode = sp.Episode(RPS, seed=1)
    episode.close()
    episode.close()
    assert episode.result.end_reason == "closed"
    assert episode.call("act", {"action": "1"}).is_error


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"manual": "wall"}, "manual must be one of tool, pinned, none"),
        ({"batch": "some"}, "batch must be one of all, first_act"),
        ({"context": "both"}, "context must be one of window, host"),
        ({"engine": "fast"}, "has no engine 'fast'"),
        ({"budget": sp.Budget(prompt_tokens=50)}, "prompt_tokens=50 cannot hold the head"),
        ({"seed": -1}, "seed must be a whole number, 0 or more, not -1"),
        ({"seed": "x"}, "seed must be a whole number"),
        ({"seed": 1.5}, "seed must be a whole number"),
        ({"transcript": ""}, "A transcript needs the path of a new file"),
        ({"transcript": "/dev/null/x.jsonl"}, "cannot be written"),
    ],
)
def test_what_a_user_gets_wrong_is_one_sentence(settings, sentence):
    with pytest.raises(sp.SmartPlayError, match=sentence):
        sp.Episode(RPS, **{"seed": 1, **settings})


def test_schemas_in_every_form(episode):
    act = episode.tools[1]
    parameters = {
        "type": "object",
        "properties": {"action": {"type": "string", "description": "The action's name or number, exactly as listed."}},
        "required": ["action"],
        "additionalProperties": False,
    }
    about = {"name": "act", "description": act.description}
    function = {**about, "parameters": parameters}
    assert sp.schema(act, "openai") == {"type": "function", "function": {**function, "strict": True}}
    assert sp.schema(act, "responses") == {"type": "function", **function, "strict": True}
    assert sp.schema(act, "anthropic") == {**about, "input_schema": parameters}
    assert sp.schema(act, "json") == function
    assert json.loads(json.dumps(sp.schema(act, "openai"))) == sp.schema(act, "openai")
    with pytest.raises(sp.InvalidArgumentError, match="no schema format"):
        sp.schema(act, "xml")


CLOSED = {"type": "object", "additionalProperties": False}


@pytest.mark.parametrize(
    ("parameters", "strict"),
    [
        ({**CLOSED, "properties": {}, "required": []}, True),
        ({**CLOSED, "properties": {"n": {"type": "integer", "description": "How many."}}, "required": ["n"]}, True),
        ({**CLOSED, "properties": {"n": {"type": "integer"}}, "required": []}, False),
        ({**CLOSED, "properties": {"n": {"type": "integer"}}, "required": ["n"], "additionalProperties": True}, False),
        ({"type": "object"}, False),
        ({**CLOSED, "properties": {"any": True}, "required": ["any"]}, False),
        ({**CLOSED, "properties": {"any": {}}, "required": ["any"]}, False),
        ({**CLOSED, "properties": {"in": {"type": "object"}}, "required": ["in"]}, False),
        ({**CLOSED, "properties": {"l": {"type": "array", "items": {"type": "string"}}}, "required": ["l"]}, True),
        ({**CLOSED, "properties": {"l": {"type": "array"}}, "required": ["l"]}, False),
        ({**CLOSED, "properties": {"a": {"$ref": "#"}}, "required": ["a"]}, False),
        ({**CLOSED, "properties": {"a": {"type": "string"}}, "required": None}, False),
    ],
)
def test_a_tool_is_sent_as_strict_only_if_its_schema_is(parameters, strict):
    """OpenAI refuses a request with a strict tool whose schema is not, and agents bring such tools of their own."""
    tool = sp.ToolSpec("search", "Search files.", parameters)
    assert sp.schema(tool, "openai")["function"]["strict"] is strict
    assert sp.schema(tool, "responses")["strict"] is strict


@pytest.mark.parametrize("text", ['{"action": "Rock"}', '{"action": ["Rock"]}'])
def test_arguments_that_a_host_has_changed_are_read_as_sent_the_next_time(text):
    changed = read(text).values
    if isinstance(changed["action"], list):
        changed["action"].append("Paper")
    changed["why"] = "because"
    assert read(text).values == json.loads(text)
