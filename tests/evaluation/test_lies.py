"""Lies: what somebody who knows this library can make of a bundle. The check catches it, or says that no check can.

Every lie changes an honest standard submission and makes all else fit: the chain, the rows, the results.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.board.submissions.check import NOT_PROVED, Checked, check_submission
from smartplay_tools.evaluation.board.submissions.check_report import report_json
from smartplay_tools.evaluation.board.submissions.prepare import prepare_submission
from smartplay_tools.evaluation.board.submissions.submitted_plan import cell_results, read_plan
from smartplay_tools.evaluation.suites import SUITES, Suite
from smartplay_tools.records import Record
from smartplay_tools.records.prices import Price
from smartplay_tools.records.rows import row_of
from tests.evaluation import bundles
from tests.evaluation.bundles import BANDIT, FACTS, HANOI, Files, edit_json, edit_record, records
from tests.evaluation.players import FirstMoves, act

Events = list[dict[str, Any]]
Lie = Callable[[Files], None]

LEFT_OUT = "cells, and the last trials of a cell, can be left out"
GAIN = 20
"""The turn after which a liar would like to stop."""


class Paid(FirstMoves):
    """Pays for its replies, says something in each, and plays and looks in one message."""

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        message = act("1")
        look = {"id": "2", "type": "function", "function": {"name": "observe", "arguments": "{}"}}
        message = {**message, "content": "The first.", "tool_calls": [*message["tool_calls"], look]}
        return sp.Reply(message, sp.Usage(prompt=1000, reply=100))


@pytest.fixture(scope="module")
def small_suite() -> Iterator[Suite]:
    """A fixed suite that takes a second; of the last message of a long episode one call is refused."""
    suite = Suite("small", {HANOI: 1, BANDIT: 2}, (sp.Budget(tool_calls=59),))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SUITES, "small", suite)
        yield suite


@pytest.fixture(scope="module")
def honest(small_suite, tmp_path_factory) -> Files:
    """The files of a standard submission; one of its episodes was killed and continued."""
    folder = tmp_path_factory.mktemp("honest")
    asked = {"suite": "small", "out": folder / "run", "executor": "inline", "prices": {"paid": Price.per_million(1, 2)}}
    run = sp.evaluate([], {"paid": Paid}, **asked)
    record = run.folder.transcript(run.rows[-1]["key"])
    beginning = record.read_bytes().splitlines(keepends=True)[:60]
    record.unlink()
    (folder / "run" / "running" / f"{record.stem}.1.jsonl").write_bytes(b"".join(beginning))
    sp.evaluate([], {"paid": Paid}, **asked)
    facts = {**FACTS, "submission_type": "standard", "suite": "small"}
    prepare_submission(folder / "run", folder / "bundle.zip", facts)
    checked = check_submission(folder / "bundle.zip", workers=0)
    assert checked.verified
    assert {finding.kind for finding in checked.findings} == {"seed"}, "it is not known who issued it"
    return bundles.read(folder / "bundle.zip")


def check(files: Files, folder: Path) -> Checked:
    checked = check_submission(bundles.write(folder / "lie.zip", files), workers=0)
    assert json.dumps(report_json(checked), allow_nan=False)
    return checked


# How a liar works.


def fit(files: Files, folder: Path) -> None:
    """Make rows and results what the records say."""
    plan, rows = read_plan(json.loads(files["manifest.json"])), []
    for episode in plan.episodes:
        record = folder / f"{episode.key}.jsonl"
        record.write_bytes(files[f"episodes/{episode.key}.jsonl"])
        rows.append(row_of(Record.read(record, plan.prices), episode.trial))
    files["results.jsonl"] = "".join(json.dumps(row) + "\n" for row in rows).encode()
    results = [result.model_dump(mode="json") for result in cell_results(rows)]
    edit_json(files, "submission.json", lambda facts: facts.update(results=results))


def events_of(files: Files, name: str) -> Events:
    return [json.loads(line) for line in files[name].splitlines()]


def played_again(
    events: Events,
    *,
    reply: Callable[[sp.Message], sp.Message] = lambda message: message,
    usage: sp.Usage | None = None,
    head: Sequence[sp.Message] = (),
    turns: int | None = None,
    end: tuple[str, str | None] = ("host", "max_turns"),
) -> Events:
    """Play a record's replies again, and return the new record: it is right in everything, the end perhaps excepted."""
    again: Events = []
    replies = [event["message"] for event in events if event["event"] == "message" and event["by"] == "player"]
    with sp.Episode.from_config(sp.EpisodeConfig.from_event(events[0]), transcript=again) as episode:
        conversation = sp.Conversation(episode, head=head)
        for message in replies[:turns]:
            conversation.prompt()
            conversation.receive(reply(message), usage or sp.Usage(prompt=1000, reply=100))
        episode.end(end[0], detail=end[1])
    return again


def again(game: str = BANDIT, **how: Any) -> Lie:
    """Return what plays the first record of a game again, and puts the new record in its place."""

    def lie(files: Files) -> None:
        name = records(files, game)[0]
        files[name] = bundles.chained(played_again(events_of(files, name), **how))

    return lie


def of_kind(events: Events, kind: str, at: int = 5) -> dict[str, Any]:
    return [event for event in events if event["event"] == kind][at]


CAUGHT: list[Any] = []
UNPROVABLE: list[Any] = []


def caught(kind: str) -> Callable[[Lie], Lie]:
    """Register a lie that the check finds, with the kind of the finding."""
    return lambda lie: CAUGHT.append(pytest.param(kind, lie, id=lie.__name__)) or lie


def unprovable(words: str) -> Callable[[Lie], Lie]:
    """Register a lie that no check can find, with words of the report that say so."""
    return lambda lie: UNPROVABLE.append(pytest.param(words, lie, id=lie.__name__)) or lie


def in_record(change: Callable[[Events], Any]) -> Lie:
    return lambda files: edit_record(files, records(files, BANDIT)[0], change)


def in_continued(change: Callable[[Events], Any]) -> Lie:
    return lambda files: edit_record(files, continued(files), change)


def continued(files: Files) -> str:
    (attempt,) = [name for name in files if name.startswith("attempts/")]
    return f"episodes/{attempt.removeprefix('attempts/').partition('.')[0]}.jsonl"


def in_manifest(change: Callable[[Any], Any]) -> Lie:
    return lambda files: edit_json(files, "manifest.json", change)


def in_submission(change: Callable[[Any], Any]) -> Lie:
    return lambda files: edit_json(files, "submission.json", change)


def set_in(kind: str, *path: Any, to: Any, at: int = 5) -> Callable[[Events], None]:
    """Return what sets a field of an event, or of what is in it."""

    def change(events: Events) -> None:
        inner: Any = of_kind(events, kind, at)
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = to(inner[path[-1]]) if callable(to) else to

    return change


def without(left: Callable[[dict[str, Any], dict[str, Any]], bool]) -> Lie:
    """Return what leaves out episodes: a function of each and of the last one says which."""

    def lie(files: Files) -> None:
        plan = json.loads(files["manifest.json"])
        last = plan["episodes"][-1]
        for episode in [episode for episode in plan["episodes"] if left(episode, last)]:
            plan["episodes"].remove(episode)
            for name in [name for name in files if episode["key"] in name]:
                del files[name]
        plan["cells"] = plan["cells"][: 1 + max(episode["cell"] for episode in plan["episodes"])]
        files["manifest.json"] = json.dumps(plan).encode()

    return lie


def of_a_custom_run(lie: Lie) -> Lie:
    def both(files: Files) -> None:
        lie(files)
        edit_json(files, "submission.json", lambda facts: facts.update(submission_type="custom", suite=None))

    return both


STOPPED = again(turns=GAIN)

# What is changed in one field, everything else made to fit.

FIELDS: dict[str, Callable[[Events], Any]] = {
    "a higher score": set_in("end", "result", "score", to=lambda was: was + 1, at=0),
    "a reward": set_in("call", "data", "reward", to=lambda was: was + 1, at=4),
    "a text of the game": set_in("call", "text", to="You won."),
    "no error": set_in("call", "is_error", to=lambda was: not was),
    "another action": set_in("message", "message", "tool_calls", 0, "function", "arguments", to='{"action": "2"}'),
    "fewer mistakes": set_in("end", "result", "malformed_calls", to=-1, at=0),
    "another end": set_in("end", "result", "end_reason", to="terminated", at=0),
    "a prompt's sha256": set_in("view", "sha256", to="0" * 64),
    "a prompt's length": set_in("view", "tokens", to=5),
    "what a prompt showed": set_in("view", "turns", to=[]),
    "cheaper prompts": set_in("usage", "prompt", to=1),
    "cheaper replies": set_in("usage", "reply", to=1),
    "a wider budget": set_in("start", "budget", "history", to=500, at=0),
    "another seed": set_in("start", "config", "seed", to=5, at=0),
    "no deviations": set_in("end", "result", "deviations", to={}, at=0),
    "other versions at the end": set_in("end", "result", "versions", "smartplay-tools", to="9.9", at=0),
    "versions that are none": set_in("start", "versions", to={"a": "\x1b[2J"}, at=0),
    "an error": set_in("end", "result", "error", to="TimeoutError", at=0),
    "a traceback": set_in("end", "traceback", to="File x", at=0),
    "a detail": set_in("end", "result", "detail", to="stopped", at=0),
    "one for true": set_in("call", "done", to=0),
    "a list with true for one": set_in("view", "turns", to=lambda was: [[False, was[0][1]]]),
    "a field that is null": lambda events: of_kind(events, "call").update(extra=None),
    "a null in the result": lambda events: of_kind(events, "end", 0)["result"].update(extra=None),
    "an error in a call": lambda events: of_kind(events, "call")["data"].update(error="late"),
    "versions of a call": lambda events: of_kind(events, "call").update(versions={}),
    "an end before the end": lambda events: events.insert(-1, events[-1]),
    "an exception on the way": lambda events: events.insert(
        30, {"event": "exception", "error": "E", "traceback": None}
    ),
    "an exception at the end": lambda events: events.append({"event": "exception", "error": "E", "traceback": None}),
    "a call that was not played": lambda events: events.remove(of_kind(events, "call")),
    "calls in another order": lambda events: events.insert(
        events.index(of_kind(events, "call", 4)), events.pop(events.index(of_kind(events, "call", 5)))
    ),
}
"""Changes in a record, which then is not what its replies and its game give."""

ELSEWHERE: dict[str, tuple[str, Lie]] = {
    "a resume that never was": (
        "attempts",
        in_record(lambda events: events.insert(30, {"event": "resume", "versions": events[0]["versions"]})),
    ),
    "a resume with more in it": ("record", in_continued(lambda events: of_kind(events, "resume", 0).update(extra="x"))),
    "a resume elsewhere": (
        "attempts",
        in_continued(lambda events: events.insert(40, events.pop(events.index(of_kind(events, "resume", 0))))),
    ),
    "a resume after the end": (
        "attempts",
        in_record(lambda events: events.append({"event": "resume", "versions": events[0]["versions"]})),
    ),
    "other versions from there on": (
        "record",
        in_continued(lambda events: of_kind(events, "resume", 0).update(versions={"smartplay-tools": "9.9"})),
    ),
    "the seed of the run": ("seed", in_manifest(lambda plan: plan.update(seed=7))),
    "a wider budget in the plan": ("suite", in_manifest(lambda plan: plan["cells"][0]["budget"].update(history=500))),
    "another trial": ("seed", in_manifest(lambda plan: plan["episodes"][0].update(trial=9))),
    "a price below zero": ("plan", in_manifest(lambda plan: plan["prices"]["paid"].update(input=[[0, -5.0]]))),
    "a price without end": ("plan", in_manifest(lambda plan: plan["prices"]["paid"].update(input=[[0, float("inf")]]))),
    "a price beyond all": ("record", in_manifest(lambda plan: plan["prices"]["paid"].update(input=[[0, 1e300]]))),
    "no list of prices": ("plan", in_manifest(lambda plan: plan["prices"]["paid"].update(input=[]))),
    "less spending": ("plan", in_manifest(lambda plan: plan.update(spending={"total": {}}))),
    "a better result": ("results", in_submission(lambda facts: facts["results"][0].update(score=99.0))),
    "a result that is not a number": (
        "metadata",
        in_submission(lambda facts: facts["results"][0].update(score=float("nan"))),
    ),
    "a result without end": ("metadata", in_submission(lambda facts: facts["results"][0].update(cost=float("inf")))),
    "stopped at its best": ("end", STOPPED),
    "stopped and not finished": ("record", again(turns=GAIN, end=("closed", None))),
    "stopped by a budget that was not spent": ("record", again(turns=GAIN, end=("prompt_tokens", None))),
    "a hint in every prompt": ("prompts", again(head=[{"role": "user", "content": "The second is the better one."}])),
    "a trial left out": ("suite", without(lambda episode, last: episode == last)),
    "a game left out": ("suite", without(lambda episode, last: episode["cell"] == last["cell"])),
}
CAUGHT += [pytest.param("record", in_record(change), id=name) for name, change in FIELDS.items()]
CAUGHT += [pytest.param(kind, lie, id=name) for name, (kind, lie) in ELSEWHERE.items()]


NOT_CAUGHT: dict[str, tuple[str, Lie]] = {
    "a trial left out of a custom run": (LEFT_OUT, of_a_custom_run(ELSEWHERE["a trial left out"][1])),
    "a game left out of a custom run": (LEFT_OUT, of_a_custom_run(ELSEWHERE["a game left out"][1])),
    "the best of several plays": (
        "several plays of one seed",
        again(reply=lambda said: {**said, "tool_calls": [*act("2")["tool_calls"], *said["tool_calls"][1:]]}),
    ),
    "words of somebody else": ("Who wrote the replies", again(reply=lambda said: {**said, "content": "I think: 1."})),
    "another model's name": ("Who wrote the replies", in_submission(lambda facts: facts.update(model_name="Better"))),
    "a cheaper provider": ("What a provider counted and charged", again(HANOI, usage=sp.Usage(prompt=1, reply=1))),
    "a lower price": ("and the prices", in_manifest(lambda plan: plan["prices"]["paid"].update(input=[[0, 0.001]]))),
}
"""Lies that no check can find, and words of the report that say so."""
UNPROVABLE += [pytest.param(words, lie, id=name) for name, (words, lie) in NOT_CAUGHT.items()]

# What is left out, replaced or put in.


@caught("prompts")
def the_last_call_left_out(files: Files) -> None:
    name = records(files, BANDIT)[0]
    edit_record(files, name, lambda events: events.remove(of_kind(events, "call", -1)))
    events = events_of(files, name)
    events[-1]["result"]["refused_calls"] -= 1
    files[name] = bundles.chained(events)


@caught("record")
def another_episode_s_record(files: Files) -> None:
    first, second = records(files, BANDIT)
    files[first] = files[second]


@caught("seed")
def a_world_that_was_chosen(files: Files) -> None:
    """An episode of another seed, whose key and record are right."""
    plan, name = json.loads(files["manifest.json"]), records(files, HANOI)[0]
    events = events_of(files, name)
    events[0]["config"]["seed"] = 99
    episode = next(episode for episode in plan["episodes"] if episode["key"] in name)
    episode |= {"seed": 99, "key": sp.EpisodeConfig.from_event(events[0]).key}
    files["manifest.json"] = json.dumps(plan).encode()
    files[f"episodes/{episode['key']}.jsonl"] = bundles.chained(played_again(events))
    del files[name]


@caught("record")
def a_line_that_is_written_otherwise(files: Files) -> None:
    """Of two fields of one name this library reads the last one; another reader may take the first."""
    name = records(files, BANDIT)[0]
    files[name] = files[name].replace(b'"is_error": false', b'"is_error": true, "is_error": false', 1)


@caught("attempts")
def an_attempt_that_is_continued_left_out(files: Files) -> None:
    del files[next(name for name in files if name.startswith("attempts/"))]


@caught("record")
def an_attempt_that_ended_in_no_way_there_is(files: Files) -> None:
    name = records(files, BANDIT)[0]
    attempt = played_again(events_of(files, name), turns=GAIN, end=("closed", None))
    attempt[-1]["result"]["end_reason"] = "\x1b[2J"
    files[f"attempts/{Path(name).stem}.1.jsonl"] = bundles.chained(attempt)


@caught("attempts")
def a_finished_episode_among_the_attempts(files: Files) -> None:
    name = records(files, BANDIT)[0]
    files[f"attempts/{Path(name).stem}.1.jsonl"] = files[name]


@unprovable("attempts that were left out")
def an_attempt_that_was_begun_anew_left_out(files: Files) -> None:
    """The continued episode is played in one go, without its attempt."""
    name = continued(files)
    files[name] = bundles.chained(played_again(events_of(files, name)))
    del files[next(name for name in files if name.startswith("attempts/"))]


@unprovable("With which versions")
def other_versions(files: Files) -> None:
    for name in records(files, HANOI):

        def change(events: Events) -> None:
            events[0]["versions"]["numpy"] = events[-1]["result"]["versions"]["numpy"] = "99"

        edit_record(files, name, change)


def bundle_with(files: Files, lie: Lie, folder: Path) -> Files:
    """Return the files after a lie, with rows and results that fit, where anything fits."""
    lying = dict(files)
    lie(lying)
    assert lying != files
    results = [json.loads(one["submission.json"])["results"] for one in (lying, files)]
    if results[0] == results[1]:
        with suppress(sp.SmartPlayError, KeyError, ValueError, OverflowError):
            fit(lying, folder)
    return lying


def two_of_each_kind() -> Iterator[Any]:
    """The lies that are caught; fast tests tell two of those that have one kind of finding."""
    told: Counter[str] = Counter()
    for row in CAUGHT:
        told[row.values[0]] += 1
        yield pytest.param(*row.values, id=row.id, marks=pytest.mark.slow if told[row.values[0]] > 2 else ())


@pytest.mark.parametrize(("kind", "lie"), [*two_of_each_kind()])
def test_a_lie_is_caught(honest, tmp_path, kind, lie):
    checked = check(bundle_with(honest, lie, tmp_path), tmp_path)
    assert kind in {finding.kind for finding in checked.errors}, checked.findings


@pytest.mark.slow
@pytest.mark.parametrize(("words", "lie"), UNPROVABLE)
def test_what_no_check_can_prove_is_in_every_report(honest, tmp_path, words, lie):
    checked = check(bundle_with(honest, lie, tmp_path), tmp_path)
    assert checked.verified, checked.errors
    assert any(words in line for line in NOT_PROVED)


def test_an_end_by_a_host_is_remarked_where_a_host_may_end(honest, tmp_path):
    checked = check(bundle_with(honest, of_a_custom_run(STOPPED), tmp_path), tmp_path)
    assert checked.verified
    remarks = [finding.text for finding in checked.findings if finding.kind == "end"]
    assert remarks == ["The host ended the episode (host: max_turns), not the game, a budget or the player."]


def test_tools_of_strategies_are_the_game_s_own(tmp_path):
    budget = sp.Budget(history=3, notes_tokens=60, prompt_tokens=1_500, summary_tokens=60, slack=0.5)
    sp.evaluate([BANDIT], ["random"], budgets=budget, out=tmp_path / "run", trials=1, executor="inline")
    prepare_submission(tmp_path / "run", tmp_path / "bundle.zip", FACTS)
    checked = check_submission(tmp_path / "bundle.zip", workers=0)
    assert checked.verified
    assert "prompts" not in {finding.kind for finding in checked.findings}
