"""Records of context managers, as the commands and the page show them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.pages.report.threads import thread_data
from smartplay_tools.manager.record import read_thread
from smartplay_tools.records.threads import thread_requests, thread_row
from smartplay_tools.transcript.hashing import chained_lines
from tests.evaluation.command import result_of
from tests.manager.histories import FORMS
from tests.manager.test_fit import steps

CAP = 300


def written(folder: Path, form: str, name: str = "reader") -> Path:
    """Record a reader whose pages do not fit; its provider counts a tenth more, and one prompt is refused."""
    pages = steps(30)
    for page in pages[3::7]:
        page["content"] = "And so on. " * 20
    messages = FORMS[form](pages)
    options: dict[str, Any] = {"history": 3, "beyond_history": "mask", "result_tokens": 20, "slack": 0.5}
    manager = sp.ContextManager(CAP, record=folder, form=form, **options)
    for end in range(4, len(messages), 2):
        prompt = manager.fit(messages[:end], thread=name, system="Be \x1b[31mbrief\u202e.")
        manager.reported(prompt, prompt.tokens * 11 // 10)
    with pytest.raises(sp.PromptOverflowError):
        manager.fit([*messages, {"role": "user", "content": "word " * CAP}], thread=name)
    return folder / f"{name}.jsonl"


def run(*words: Any) -> tuple[int, str]:
    result = result_of(*words)
    return result.exit_code, result.output


@pytest.mark.parametrize("form", FORMS)
def test_a_row_says_what_became_of_a_thread(tmp_path: Path, form: str):
    thread = read_thread(written(tmp_path, form))
    code, output = run("results", tmp_path, "--format", "json")
    (row,) = json.loads(output)
    assert code == 0
    assert row == thread_row(thread)
    prompts = thread.prompts
    assert row["prompts"] == len(prompts) == row["counted"]
    assert row["tokens"] == sum(prompt.facts["tokens"] for prompt in prompts)
    assert row["largest"] == max(prompt.facts["tokens"] for prompt in prompts) <= CAP == row["cap"]
    assert row["refusals"] == 1
    assert row["over"] == sum(prompt.facts["tokens"] * 11 // 10 > CAP for prompt in prompts) > 0
    assert 1.08 < row["ratio"] < 1.1
    assert row["dropped"] == sum(bool(prompt.changed("dropped")) for prompt in prompts) > 5
    assert row["masked"]
    assert row["cut"]


def test_nothing_is_claimed_of_prompts_that_a_provider_managed(tmp_path: Path):
    manager = sp.ContextManager(CAP, record=tmp_path)
    for count, managed in ((3, False), (4, True)):
        prompt = manager.fit(steps(count), thread="one")
        manager.reported(prompt, 10 * CAP, managed=managed)
    (row,) = json.loads(run("results", tmp_path, "--format", "json")[1])
    assert (row["managed"], row["counted"], row["over"]) == (1, 1, 1)
    assert re.search(r"one~ .* 1 of 1", run("results", tmp_path)[1])
    code, output = run("cost", tmp_path, "--cache", "anthropic-512")
    assert code != 0
    assert "the provider managed itself" in output


def test_a_file_and_a_folder_are_read_alike_and_runs_are_shown_apart(tmp_path: Path):
    files = [written(tmp_path / "agent", "chat", name) for name in ("one", "two")]
    assert [row["thread"] for row in json.loads(run("results", *files, "--json")[1])] == ["one", "two"]
    assert re.search(r"one +\d+ .*\ntwo +\d+", run("results", tmp_path / "agent")[1])
    sp.evaluate(["Hanoi3Disk-v0"], ["random"], out=tmp_path / "run", trials=1, executor="inline")
    code, output = run("results", tmp_path / "agent", tmp_path / "run")
    assert code == 2
    assert "holds no record of a context manager, unlike the others" in output


def changed(file: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change the events of a record, as somebody does who computes its chain again."""
    events = [json.loads(line) for line in file.read_text().splitlines()]
    for event in events:
        del event["chain"]
        change(event)
    file.write_bytes(chained_lines(events, "")[0])


def test_replay_rebuilds_every_prompt(tmp_path: Path):
    first, second = (written(tmp_path, "chat", name) for name in ("one", "two"))
    count = len(read_thread(first).prompts)
    assert run("replay", tmp_path) == (0, f"identical: {2 * count} prompts of 2 threads of {tmp_path}\n")
    assert run("replay", first) == (0, f"identical: {count} prompts of {first}\n")
    changed(first, lambda event: event.get("number") == 3 and "part" in event and event["part"].update(content="else"))
    code, output = run("replay", tmp_path)
    assert code == 1
    assert "differs: prompt 1 of" in output
    assert "one.jsonl is not what its digest says" in output
    second.write_text(second.read_text().replace("Page 1", "Page 9"))
    assert run("replay", second)[0] == 2, "its chain says that it was changed"
    found = json.loads(run("replay", tmp_path, "--json")[1])
    assert [each["identical"] for each in found] == [False, False]


def test_prompts_are_charged_under_the_rules_of_caches(tmp_path: Path):
    thread = read_thread(written(tmp_path, "chat"))
    log = thread_requests(thread)
    assert [request.prompt for request in log.requests] == [prompt.reported for prompt in thread.prompts]
    stable = [sum(unit.tokens for unit in request.units[: request.same]) for request in log.requests]
    assert all(
        0 <= ours - facts.facts["prefix_tokens"] <= 3 or not ours
        for ours, facts in zip(stable, thread.prompts, strict=True)
    )
    assert max(stable) > 100
    code, output = run("cost", tmp_path, "--cache", "anthropic-512", "--cache", "openai:gpt-4o-mini", "--json")
    rule, model = json.loads(output)
    assert code == 0
    assert (rule["usd"], model["usd"]) == (False, True)
    assert 0 < model["cost"] < 0.01


RECORDS: list[tuple[Callable[[dict[str, Any]], Any], str]] = [
    (lambda event: event.update(shown=[[0, 10**12]]) if event["kind"] == "prompt" else None, "numbers of a prompt"),
    (lambda event: event.update(dropped=[[0, 10**12]]) if event["kind"] == "prompt" else None, "numbers of a prompt"),
    (lambda event: event.update(tokens="many") if event["kind"] == "prompt" else None, "valid integer"),
    (lambda event: event.update(parts={"x": 1}) if event["kind"] == "prompt" else None, "'tools', 'head'"),
    (lambda event: event.update(tokens=-1) if event["kind"] == "usage" else None, "greater than or equal"),
    (lambda event: event.update(prompt=10**6) if event["kind"] == "usage" else None, "out of range"),
    (lambda event: event.update(part=7) if event["kind"] == "part" else None, "numbers of a prompt"),
    (lambda event: event.update(kind=["part"]), "no event|match"),
]


@pytest.mark.parametrize(("change", "sentence"), RECORDS)
def test_what_strangers_write_is_a_sentence(tmp_path: Path, change: Callable[[dict[str, Any]], Any], sentence: str):
    file = written(tmp_path, "chat")
    changed(file, change)
    for command in (["results"], ["replay"], ["cost"], ["report", "--out", tmp_path / "page.html"]):
        code, output = run(*command, file)
        assert code == 2, command
        assert re.search(sentence, output.replace("\n", " ")), output


def test_nothing_in_a_record_opens_anything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    beacon = {"tokenizer": "hf:/etc/passwd", "head": "/etc/passwd", "url": "http://127.0.0.1:9/", "import": "os:system"}
    picture = {"type": "image_url", "image_url": {"url": "file:///etc/passwd"}}
    file = written(tmp_path, "chat")
    changed(file, lambda event: event["kind"] == "start" and event["settings"].update(beacon))
    changed(
        file, lambda event: event.get("number") == 1 and "part" in event and event["part"].update(content=[picture])
    )
    opened: list[str] = []
    monkeypatch.setattr("smartplay_tools.context.tokens.tokenizers.get_tokenizer", lambda name: opened.append(name))
    monkeypatch.setattr("socket.socket.connect", lambda *given: opened.append(str(given)))
    for command in (["results"], ["cost"], ["report", "--out", tmp_path / "page.html"]):
        assert run(*command, tmp_path)[0] == 0
    assert not opened
    assert "root:" not in (tmp_path / "page.html").read_text()


def test_characters_that_are_not_seen_are_written_as_escapes(tmp_path: Path):
    thread = read_thread(written(tmp_path, "anthropic"))
    data = thread_data(thread, thread_row(thread))
    assert data["turns"][0]["beside"] == [r'system: "Be \u001b[31mbrief\u202e."']
    for text in ("\x1b[2J", "a\u202eb", "\x9b", "\r"):
        manager = sp.ContextManager(None, record=tmp_path / "more")
        manager.fit([{"role": "user", "content": text}], thread="strange")
    thread = read_thread(tmp_path / "more" / "strange.jsonl")
    words = [part["content"] for part in thread_data(thread, thread_row(thread))["parts"]]
    assert words == [r"\x1b[2J", r"a\u202eb", r"\x9b", r"\x0d"]


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_the_page_shows_each_prompt_word_for_word_and_what_left_it(show: Any, tmp_path: Path, form: str):
    thread = read_thread(written(tmp_path, form, "reader"))
    page = show(tmp_path, "#episode=reader&turn=9", viewport={"width": 390, "height": 844})
    sent = "promptParts(shown.episode, null, at).map(({ message }) => message.sent).filter(Boolean)"
    shown = page.evaluate(f"shown.episode.turns.map((_, at) => {sent})")
    assert shown == [json.loads(json.dumps(list(prompt.messages))) for prompt in thread.prompts]
    for at, prompt in enumerate(thread.prompts):
        states = page.evaluate("(at) => shown.episode.turns[at].view.states", at)
        gone = {number for number, state in enumerate(states) if state == "dropped"}
        units = page.evaluate("(at) => shown.episode.turns[at].view.units.map((unit) => unit.length)", at)
        assert sum(units[number] for number in gone) == len(prompt.changed("dropped"))
    page.evaluate("goTo(shown.episode.turns.findIndex(isOver))")
    assert "OVER THE CAP by that count" in page.locator("#allowed").inner_text()
    assert "rebuilt and found" in page.locator("#rules").evaluate("box => box.textContent")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_the_site_shows_threads_beside_runs(tmp_path: Path):
    site = pytest.importorskip("smartplay_tools.web.site")
    from tests.loopback import ask

    written(tmp_path / "agent", "chat", "reader")
    sp.evaluate(["Hanoi3Disk-v0"], ["random"], out=tmp_path / "run", trials=1, executor="inline")
    with site.ViewServer(site.RunList([tmp_path])) as server:
        names = [run["name"] for run in json.loads(ask(f"{server.url}api/runs")[2])]
        listed = json.loads(ask(f"{server.url}api/runs/agent/episodes")[2])
        (row,) = (dict(zip(listed["columns"], each, strict=True)) for each in listed["episodes"])
        status, _, page = ask(f"{server.url}episode/agent/{row['record']}")
        news = json.loads(ask(f"{server.url}api/episode/agent/{row['record']}?after=")[2])
        missing = [
            ask(f"{server.url}episode/agent/threads/{name}")[0] for name in ("other", "..%2freader", "reader.jsonl")
        ]
    assert sorted(names) == ["agent", "run"]
    assert (row["game"], row["status"], row["mistakes"]) == ("reader", "running", 1)
    assert status == 200
    assert 'data-open="reader"' in page
    assert news["playing"]
    assert news["data"]
    assert all(status in (400, 404) for status in missing)
