"""A model file as a player. `.ci/framework local` has an environment with llama.cpp and the model."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

pytest.importorskip("xllamacpp", reason="needs smartplay-tools[local]; `.ci/run` has an environment with it")

from smartplay_gateway import LocalEndpoint
from smartplay_local import LocalPlayer, LocalServer
from smartplay_local.engine import Loading, idle_threads, shared_server
from smartplay_local.model_files import KNOWN_MODELS, find_model, read_gguf
from smartplay_local.player import tried
from smartplay_local.text import as_text, call_in, grammar_of
from smartplay_openai import chat_reply

import smartplay_tools as sp
from smartplay_tools.players import get_player
from tests.dialects.rules import DIALECTS
from tests.dialects.scripts import HOSTILE, ODD, SOLVED
from tests.dialects.server import whole_answer

MODEL = KNOWN_MODELS["smollm2-135m"]
GAME = "RockPaperScissorBasic-v0"

needs_model = pytest.mark.skipif(not MODEL.is_here, reason="needs `smartplay-tools model get`")


@pytest.fixture(scope="module")
def server() -> LocalServer:
    return shared_server(Loading(find_model(), threads=1))


@needs_model
def test_the_model_is_the_one_that_was_published():
    assert MODEL.is_intact
    assert MODEL.path.stat().st_size == MODEL.bytes
    assert read_gguf(MODEL.path).context_length == 8192


@needs_model
def test_it_plays_a_short_episode_whose_calls_are_well_formed(tmp_path):
    record = tmp_path / "one.jsonl"
    budget = sp.Budget(prompt_tokens=900, tool_calls=6)
    with sp.Episode(GAME, seed=3, budget=budget, transcript=record) as episode:
        result = sp.play(episode, get_player("local", threads=1, format="text"))
    assert (result.error, result.end_reason) == (None, "tool_calls")
    assert (result.malformed_calls, result.idle_replies) == (0, 0)
    provider = result.tokens.provider
    assert provider is not None
    assert provider.requests == result.turns
    assert provider.cached > 0, "the engine reads the beginning of a prompt once"
    start = sp.read_transcript(record)[0]
    assert start["config"]["player"] == "local:smollm2-135m"
    assert start["versions"]["format"] == "text"
    assert start["versions"]["model"] == f"sha256:{MODEL.sha256}"
    assert result.versions.items() >= start["versions"].items()
    assert sp.replay(record).identical


@needs_model
async def test_the_taught_model_plays_two_episodes_at_once_each_from_its_own_cache():
    budget = sp.Budget(prompt_tokens=1000, slack=0.5, tool_calls=4)
    episodes = [sp.Episode(GAME, seed=seed, budget=budget) for seed in (1, 2)]
    players = [LocalPlayer("smollm2-135m-player", threads=1, context=2048) for _ in episodes]
    results = await asyncio.gather(*map(sp.aplay, episodes, players))
    for result in results:
        assert (result.error, result.illegal_actions, result.malformed_calls) == (None, 0, 0)
        assert result.steps >= 3, "it plays, where the model without its adapter reads and asks"
        assert result.versions["adapter"].startswith("sha256:048a6b62")
        assert result.tokens.provider.cached > result.tokens.provider.prompt / 2


@pytest.mark.parametrize(("load", "threads"), [(0.0, 2), (0.6, 1), (1.4, 1), (9.0, 1)])
def test_threads_fit_the_load_of_the_machine(load, threads, monkeypatch):
    monkeypatch.setattr("os.getloadavg", lambda: (load, 0.0, 0.0), raising=False)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1}, raising=False)
    assert idle_threads() == threads


TOOLS_TEMPLATE = """
{% for t in tools %}{{ t | tojson }}{% endfor %}{% for m in messages %}<|im_start|>{{ m.role }}
{{ m.content }}{% for c in m.tool_calls %}<tool_call>{{ c.function | tojson }}</tool_call>{% endfor %}<|im_end|>
{% endfor %}{% if add_generation_prompt %}<|im_start|>assistant
{% endif %}""".strip()


def with_template(template: str, path: Path) -> Path:
    """The model's file with another chat template, as long as its own."""
    own = str(read_gguf(MODEL.path).facts["tokenizer.chat_template"]).encode()
    written = template.encode()
    path.write_bytes(
        MODEL.path.read_bytes().replace(own, b"{#" + b" " * (len(own) - len(written) - 4) + b"#}" + written)
    )
    return path


@needs_model
def test_a_model_whose_template_has_tools_is_sent_them_there(tmp_path):
    path = with_template(TOOLS_TEMPLATE, tmp_path / "tools.gguf")
    player = LocalPlayer(str(path), threads=1, context=1024, format="template")
    with sp.Episode(GAME, seed=3) as episode:
        body = player.request(sp.Conversation(episode).prompt())
    assert (body["tool_choice"], body["max_tokens"]) == ("required", 2_000)
    written = player.load().written(body["messages"], body["tools"])
    assert '"maxLength": 64' in written
    assert written.count('"name": ') == len(body["tools"]) == 3


@needs_model
def test_a_draw_depends_on_the_seed_only():
    with sp.Episode(GAME, seed=3) as episode:
        prompt = sp.Conversation(episode).prompt()
    assert prompt is not None
    replies = [LocalPlayer(threads=1, temperature=1.5, seed=seed).reply(prompt).message for seed in (1, 1, 2, 3, 4)]
    calls = [json.dumps(reply["tool_calls"][0]["function"]) for reply in replies]
    assert calls[0] == calls[1]
    assert len(set(calls)) > 1


@needs_model
def test_it_is_a_model_for_programs_that_take_a_base_url():
    with (
        LocalEndpoint(LocalPlayer(threads=1)) as endpoint,
        sp.Episode(GAME, seed=3, budget=sp.Budget(tool_calls=2)) as e,
    ):
        result = sp.play(e, get_player("openai:local:smollm2-135m", base_url=endpoint.base_url))
    assert (result.error, result.tool_calls, result.malformed_calls) == (None, 2, 0)


@needs_model
@pytest.mark.slow
@pytest.mark.parametrize("stream", [False, True], ids=["whole", "streamed"])
def test_the_engine_takes_every_prompt_whatever_its_model_has_said(server, stream):
    """A real llama.cpp as a server: after each hostile reply it gets the next prompt, and replies."""
    said = [*map(HOSTILE.get, ("broken JSON", "NaN", "another tool", "nothing")), SOLVED[0], ODD["empty arguments"]]
    budget = sp.Budget(prompt_tokens=900, reply_tokens=4)
    asks = sp.get_player("openai:smollm2", base_url=server.base_url, stream=stream, retries=0)
    with asks, sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget) as episode:
        conversation = sp.Conversation(episode)
        for number, reply in enumerate(said):
            assert asks.reply(conversation.prompt()).usage.prompt > 0
            conversation.receive(chat_reply(whole_answer(DIALECTS["llama.cpp"], reply, number)).message)
        assert asks.reply(conversation.prompt()).usage.prompt > 0
        assert episode.stats.steps == 1


@needs_model
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"context": 10_000}, "between 1 and 8,192"),
        ({"threads": 0}, "threads is at least 1"),
        ({"format": "hermes"}, "format must be one of template, text, call, bare, words, legal"),
        ({"format": "template"}, "has no tools; leave format out, or text"),
        ({"adapter": str(MODEL.path)}, "is not a LoRA adapter in GGUF"),
        ({"adapter": "nowhere.gguf"}, "There is no model file nowhere"),
        ({"base_url": "http://127.0.0.1"}, "takes no base_url"),
    ],
    ids=str,
)
def test_options_that_cannot_be_are_refused(options, message):
    with pytest.raises(sp.InvalidArgumentError, match=message):
        get_player("local", **options)


@needs_model
def test_a_model_that_does_not_fit_is_refused_before_it_is_loaded(monkeypatch):
    monkeypatch.setattr("smartplay_local.engine.free_memory", lambda: 200_000_000)
    with pytest.raises(sp.InvalidArgumentError, match=r"0\.2 GB are free: choose a smaller context"):
        get_player("local")


@needs_model
@pytest.mark.parametrize("damaged", ["weights", "template", "adapter"])
def test_a_file_that_the_engine_cannot_load_is_refused(damaged, tmp_path):
    path, taught = tmp_path / "damaged.gguf", KNOWN_MODELS["smollm2-135m-player"].adapter_path
    part = {"weights": b"token_embd.weight", "template": b"{% endfor %}", "adapter": b"blk.0.attn_q.weight.lora_a"}[
        damaged
    ]
    whole = (taught if damaged == "adapter" else MODEL.path).read_bytes()
    path.write_bytes(
        whole.replace(part, part.replace(b"end", b"and").replace(b"embd", b"abcd").replace(b"_q", b"_x"), 1)
    )
    files = {"model": MODEL.path, "adapter": path} if damaged == "adapter" else {"model": path}
    with pytest.raises(sp.InvalidArgumentError, match=r"llama\.cpp could not load .*may be damaged"):
        LocalServer(**files, threads=1)


def test_messages_become_text_that_any_template_can_write():
    with sp.Episode(GAME, seed=1) as episode:
        tools = episode.tools
    messages = [
        {"role": "system", "content": "S"},
        {"role": "user", "content": "U"},
        sp.call("act", action="Rock"),
        {"role": "tool", "content": "R", "tool_call_id": "call_0"},
        {"role": "user", "content": "Go on."},
    ]
    written = as_text(messages, tools)
    assert [message["role"] for message in written] == ["system", "user", "assistant", "user"]
    assert all(tool.description in written[0]["content"] for tool in tools)
    assert written[2]["content"] == '{"name": "act", "arguments": {"action": "Rock"}}'
    assert written[3]["content"] == "R\n\nGo on."
    assert as_text(messages[:2], ()) == messages[:2]
    assert messages[0]["content"] == "S", "the prompt itself is unchanged"


ARGUMENT_OF = {"observe": None, "act": "action", "take_notes": "notes"}


@pytest.mark.parametrize(
    ("form", "text", "words", "called"),
    [
        ("text", '{"name":"act","arguments":{"action":"Rock"}}', "", ("act", {"action": "Rock"})),
        ("text", '{"name":"act","argum', '{"name":"act","argum', None),
        ("text", "[1]", "[1]", None),
        ("call", "act(Rock)", "", ("act", {"action": "Rock"})),
        ("call", "observe()", "", ("observe", {})),
        ("call", "take_notes(a (b) c)", "", ("take_notes", {"notes": "a (b) c"})),
        ("call", "act(Ro", "act(Ro", None),
        ("call", "leave(Rock)", "leave(Rock)", None),
        ("words", "Paper beats it.\nact(Paper)", "Paper beats it.", ("act", {"action": "Paper"})),
        ("bare", "Rock\n", "", ("act", {"action": "Rock"})),
        ("legal", "", "", None),
    ],
)
def test_a_call_is_read_in_every_format_and_a_reply_that_was_cut_is_none(form, text, words, called):
    function = None if called is None else {"name": called[0], "arguments": json.dumps(called[1])}
    assert call_in(text, ARGUMENT_OF, form) == (words, function)


@pytest.mark.parametrize(
    ("form", "told", "said"),
    [
        ("text", "- act: Play one action", '{"name": "act", "arguments": {"action": "Paper"}}'),
        ("call", "one call and nothing else, such as act(Rock)", "act(Paper)"),
        ("words", "next line with one call, such as act(Rock)", "It is time.\nact(Paper)"),
        ("bare", "the name of one action and nothing else, such as Rock", "Paper"),
        ("legal", "the name of one action and nothing else, such as Rock", "Paper"),
    ],
)
def test_tools_and_earlier_calls_are_written_in_the_format(form, told, said):
    with sp.Episode(GAME, seed=1) as episode:
        tools = episode.tools
    words = "It is time." if form == "words" else None
    written = as_text([MESSAGES[0], sp.call("act", say=words, action="Paper")], tools, form)
    assert told in written[0]["content"]
    assert ("observe" in written[0]["content"]) == (form not in ("bare", "legal")), "actions are played alone"
    assert written[1]["content"] == said


MESSAGES = [{"role": "system", "content": "Play."}]


def test_a_format_that_has_no_form_for_a_tool_is_refused():
    with sp.Episode(GAME, seed=1, budget=sp.Budget(notes_tokens=50)) as episode:
        assert '"take_notes(" /' in grammar_of(episode.tools, "call")
        with pytest.raises(sp.InvalidArgumentError, match="cannot call take_notes; choose call"):
            grammar_of(episode.tools, "legal")
    with (
        sp.Episode(GAME, seed=1, budget=sp.Budget(memory_tokens=50)) as episode,
        pytest.raises(sp.InvalidArgumentError, match="no form for the arguments of memory; choose text"),
    ):
        grammar_of(episode.tools, "call")


@needs_model
@pytest.mark.parametrize("form", ["call", "bare", "words", "legal"])
def test_it_plays_in_a_format_that_is_fixed(form, tmp_path):
    record = tmp_path / "one.jsonl"
    rules = {"manual": "pinned", "first_observation": "prompt", "offered_tools": "useful"}
    budget = sp.Budget(history=None, tool_calls=3)
    with sp.Episode(GAME, seed=3, budget=budget, transcript=record, **rules) as episode:
        result = sp.play(episode, LocalPlayer(threads=1, format=form, temperature=1.0))
    assert (result.error, result.malformed_calls, result.idle_replies) == (None, 0, 0)
    assert result.steps + result.illegal_actions == 3
    assert result.illegal_actions == 0 or form != "legal"
    assert result.deviations["format"] == {"paper": None, "played": form}
    assert "trial" not in result.versions
    assert sp.replay(record).identical


@needs_model
def test_the_format_is_chosen_by_a_trial_that_is_said_and_recorded(capfd):
    tried.cache_clear()
    versions = LocalPlayer(threads=1).versions
    assert versions["trial"].startswith("right answers of 4 in a trial: text ")
    assert f"plays in the format {versions['format']} ({versions['trial']})" in capfd.readouterr().err
    assert "trial" not in LocalPlayer("smollm2-135m-player").versions, "its format is the one that it was taught"


def test_the_grammar_names_every_tool_and_bounds_its_texts():
    with sp.Episode(GAME, seed=1, budget=sp.Budget(history=3, notes_tokens=100)) as episode:
        grammar = grammar_of(episode.tools)
        assert all(tool.name in grammar for tool in episode.tools)
    assert '"maxLength":64' in grammar
    assert '"maxLength":2000' in grammar


def test_a_text_that_may_be_null_has_an_end_too():
    with sp.Episode(GAME, seed=1, budget=sp.Budget(memory_tokens=50)) as episode:
        grammar = grammar_of(episode.tools[-1:])
    # The command is one of a few words.
    assert grammar.count('"maxLength":2000') == grammar.count('"type":"string"') - 1


def test_a_missing_file_is_said_before_anything_is_played(tmp_path, monkeypatch):
    monkeypatch.setenv("SMARTPLAY_MODELS", str(tmp_path))
    with pytest.raises(sp.InvalidArgumentError, match=r"model get smollm2-135m` downloads it \(98 MB\)"):
        get_player("local")
    with pytest.raises(sp.InvalidArgumentError, match="There is no model file"):
        get_player(f"local:{Path('nowhere.gguf')}")
