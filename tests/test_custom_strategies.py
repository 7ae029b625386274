"""Custom strategies: by file, by name, by an entry point; what is refused, recorded, replayed and moved."""

from __future__ import annotations

import json
import random
import re
import shutil
from collections import Counter
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools import registry
from smartplay_tools.context.strategies import custom
from smartplay_tools.episode import cell_config
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.runs.plan import plan_episodes
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import run_plan
from smartplay_tools.players.rule import RulePlayer
from smartplay_tools.records import Record, replay, resume, sent_prompts
from smartplay_tools.records.accounts import Accounts
from tests import fuzz, scripts
from tests.evaluation.command import refused
from tests.test_edges import calling

RPS = "RockPaperScissorDifferentScore-v0"
HERE = Path(__file__).parent
PAGE = (HERE.parent / "docs" / "add-a-strategy.md").read_text(encoding="utf-8")
CODE = re.findall(r"^```python\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)[0]


@pytest.fixture
def file(tmp_path, monkeypatch):
    """The page's strategy in a file, known to nobody yet."""
    monkeypatch.setattr(custom, "_NAMED", {})
    monkeypatch.setattr(custom.IN_FILES, "read", {})
    monkeypatch.chdir(tmp_path)
    (tmp_path / "first_and_newest.py").write_text(CODE, encoding="utf-8")
    return "first_and_newest.py:FirstAndNewest"


def forget():
    """Forget every strategy, as another process would."""
    custom._NAMED.clear()
    custom.IN_FILES.read.clear()


def played(strategy, **budget):
    events = []
    budget = sp.Budget(**{"prompt_tokens": 800, **budget}, strategy=strategy)
    with sp.Episode(RPS, seed=2, budget=budget, transcript=events) as episode:
        result = sp.play(episode, sp.get_player("rule-notes"))
    return result, scripts.as_json(events)


def test_its_record_is_replayed_resumed_and_counted(file):
    result, events = played(f"{file}:turns=2", notes_tokens=60)
    assert result.end_reason == "rollout"
    assert result.deviations["strategy"] == {"paper": None, "played": f"{file}:turns=2"}
    scripts.check_record(events)
    assert {departure.reason for departure in Accounts.of(Record(events)).departures()} == {"choice"}


def test_notes_beside_an_observation_are_rebuilt_as_they_were_shown(file):
    """Their turn is masked although no observation is too old, and the strategy masks none."""
    budget, events = sp.Budget(strategy=file, notes_tokens=20, history=None, prompt_tokens=2_000), []
    with sp.Episode(RPS, seed=2, budget=budget, transcript=events) as episode:
        conversation = sp.Conversation(episode)
        conversation.receive(calling(("n", "take_notes", '{"text": "Rock"}'), ("a", "act", '{"action": "1"}')))
        for _ in range(3):
            conversation.receive(sp.call("act", action="1"))
    sent = list(sent_prompts(events))
    assert "[observation left" in str(sent[-1].prompt.messages)
    assert [one.sha256 for one in sent] == [one.recorded_sha256 for one in sent]


def test_the_experiment_plays_the_pages_strategy():
    assert (HERE.parent / "experiments" / "first_and_newest.py").read_text(encoding="utf-8") == CODE


def test_prompts_are_rebuilt_without_it(file):
    _, events = played(file)
    forget()
    Path("first_and_newest.py").unlink()
    sent = list(Record(events).sent_prompts())
    assert sent
    assert all(one.sha256 == one.recorded_sha256 for one in sent)


def test_a_record_imports_no_file_by_itself(file):
    _, events = played(file)
    forget()
    for play_again in (replay, lambda record: resume(record, transcript=[])):
        with pytest.raises(sp.InvalidArgumentError, match="name it with --strategy"):
            play_again(events)
    shutil.move("first_and_newest.py", "moved.py")
    custom.load_strategy("moved.py:FirstAndNewest")
    assert replay(events).identical
    forget()
    Path("first_and_newest.py").write_text(CODE + "\n# changed\n", encoding="utf-8")
    custom.load_strategy(file)
    with pytest.raises(sp.InvalidArgumentError, match="has changed since the record was made"):
        replay(events)
    forget()
    Path("record.jsonl").write_text("".join(f"{json.dumps(event)}\n" for event in events), encoding="utf-8")
    Path("first_and_newest.py").write_text('open("mark", "w")', encoding="utf-8")
    said = refused("replay", "record.jsonl", "--strategy", file)
    assert "is not the file of the record, or has changed since, so it is not imported" in said
    assert not Path("mark").exists()


def choosing(turns: str) -> str:
    """The text of a file with a strategy and a player."""
    return f"""import smartplay_tools as sp

class S:
    def choose(self, past, room):
        return sp.Choice({turns})

class P:
    name, turns = "p", "{turns}"
    def reply(self, prompt):
        return sp.Reply(sp.call("act", action="1"))
"""


def shown_by(turns: str) -> list[int]:
    """Write the file, and return the turns that the last prompt of an episode with its strategy shows."""
    Path("s.py").write_text(choosing(turns), encoding="utf-8")
    result, events = played("s.py:S")
    assert result.end_reason == "rollout"
    assert events[0]["config"]["strategy_sha256"] == digest_of("s.py")
    assert sp.get_player("s.py:P").turns == turns
    return [event["turns"] for event in events if event["event"] == "view"][-1]


def digest_of(path: str) -> str:
    return sha256(Path(path).read_bytes()).hexdigest()


def test_a_file_that_was_rewritten_is_a_new_strategy(file):
    """As in a notebook: the same name, another content, of the same size and within the same second."""
    first, second, third = map(shown_by, ("range(1)", "range(0)", "range(1)"))
    assert first == third != second


def test_a_name_means_the_file_of_the_current_folder(file, tmp_path, monkeypatch):
    seen = []
    for folder, turns in (("a", "range(0)"), ("b", "range(1)")):
        (tmp_path / folder).mkdir()
        monkeypatch.chdir(tmp_path / folder)
        seen.append(shown_by(turns))
    assert seen[0] != seen[1]


def test_an_episode_is_not_played_with_a_file_that_has_changed_since_it_was_planned(file):
    Path("s.py").write_text(choosing("range(0)"), encoding="utf-8")
    config = cell_config(RPS, budget=sp.Budget(strategy="s.py:S")).with_seed(1)
    forget()
    Path("s.py").write_text(choosing("range(1)"), encoding="utf-8")
    with pytest.raises(sp.InvalidArgumentError, match=r"s\.py has changed since its episodes were planned"):
        sp.Episode.from_config(config)


@pytest.mark.parametrize(
    ("strategy", "sentence"),
    [
        ("nowhere.py:Any", "There is no file nowhere.py"),
        ("first_and_newest.py:Other", "has no class 'Other'"),
        ("unheard-of", "There is no strategy 'unheard-of'; known: agent-framework-summary"),
        ("first_and_newest.py:FirstAndNewest:size=3", "cannot be made with these options: TypeError"),
        ("first_and_newest.py:sp", "has no class 'sp'"),
        ("first_and_newest.py:FirstAndNewest:turns=3:turns=4", "each key once"),
        ("raises.py:Any", "raises.py cannot be imported: ZeroDivisionError"),
    ],
)
def test_what_cannot_be_loaded_is_one_sentence(file, strategy, sentence):
    Path("raises.py").write_text("1 / 0", encoding="utf-8")
    with pytest.raises(sp.SmartPlayError, match=re.escape(sentence)):
        sp.Episode(RPS, seed=1, budget=sp.Budget(strategy=strategy))


@pytest.mark.parametrize("budget", [{"slack": 0.5}, {"beyond_history": "mask"}, {"summary_tokens": 30, "slack": 0.5}])
def test_what_decides_the_same_is_refused(file, budget):
    with pytest.raises(sp.InvalidArgumentError, match="chooses the turns itself"):
        sp.Episode(RPS, seed=1, budget=sp.Budget(prompt_tokens=900, strategy=file, **budget))
    with pytest.raises(sp.InvalidArgumentError, match="needs a window over tool calls"):
        sp.Episode(RPS, seed=1, context="host", budget=sp.Budget(strategy=file))


def test_an_entry_point_is_a_name(file, monkeypatch):
    class Declared:
        name, value, dist = "first", "first_and_newest:FirstAndNewest", None

        def load(self):
            return registry.read_file(file).value

    monkeypatch.setattr(registry, "declared_in", lambda group: [Declared()] if group == custom.ENTRY_POINTS else [])
    result, events = played("first:turns=2")
    assert result.end_reason == "rollout"
    forget()
    assert replay(events).identical
    with pytest.raises(sp.InvalidArgumentError, match="is taken"):
        sp.register_strategy("first", Declared)


def test_the_judge_agrees(monkeypatch):
    counts = Counter()
    monkeypatch.setattr(fuzz, "strategy", lambda chance: {"strategy": f"{fuzz.ODD}:seed={chance.randrange(999)}"})
    for number in range(40):
        fuzz.hostile_conversation(random.Random(f"custom {number}"), counts)
    assert counts["prompts"] > 50


def test_a_run_that_was_interrupted_goes_on_in_another_process(file, tmp_path, monkeypatch):
    asked = {"trials": 1, "budgets": [sp.Budget(prompt_tokens=800, strategy=file)], "out": tmp_path / "run"}
    reply, replies = RulePlayer.reply, []

    def interrupted(player, prompt):
        replies.append(prompt)
        if len(replies) == 20:
            raise KeyboardInterrupt
        return reply(player, prompt)

    monkeypatch.setattr(RulePlayer, "reply", interrupted)
    with suppress(KeyboardInterrupt):
        sp.evaluate([RPS], ["rule"], executor="inline", **asked)
    monkeypatch.setattr(RulePlayer, "reply", reply)
    forget()
    done = sp.evaluate([RPS], ["rule"], executor="inline", **asked)
    assert done.complete
    record = Record.read(done.transcript(done.rows[0]["key"]))
    assert record.resumes, "the episode was continued, not begun again"
    assert replay(record.events).identical


def test_a_record_has_no_path_and_the_manifest_has_it(file, tmp_path):
    """A file is one cell however its path is written, and nothing that is published says where it was."""
    keys = set()
    spellings = (f"./{file}", f"{tmp_path}/../{tmp_path.name}/{file}")
    for number, place in enumerate(spellings):
        out = tmp_path / f"run-{number}"
        budget = sp.Budget(prompt_tokens=800, strategy=f"{place}:turns=2")
        run = sp.evaluate([RPS], ["rule"], trials=1, budgets=budget, out=out, executor="inline")
        [row] = run.rows
        keys.add(row["key"])
        record = Record.read(run.transcript(row["key"]))
        assert record.config.budget.strategy == row["asked"]["strategy"] == f"{file}:turns=2"
        assert record.config.strategy_sha256 == row["strategy_sha256"] == digest_of("first_and_newest.py")
        assert str(tmp_path) not in (out / "results.jsonl").read_text() + record.path.read_text()
        assert run.folder.manifest().strategy_files == {row["strategy_sha256"]: str(Path(place.partition(":")[0]))}
    assert len(keys) == 1


@pytest.mark.slow
def test_worker_processes_find_the_file_of_a_strategy_in_another_folder(file, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    budget = sp.Budget(prompt_tokens=800, strategy=f"../{file}")
    run = sp.evaluate([RPS], ["rule"], trials=2, budgets=budget, out=tmp_path / "run", executor="processes", workers=2)
    assert run.complete


def test_two_files_of_one_name_are_two_cells(file, tmp_path):
    for folder, turns in (("a", "range(0)"), ("b", "range(1)")):
        Path(folder).mkdir()
        Path(folder, "s.py").write_text(choosing(turns), encoding="utf-8")
    budgets = [sp.Budget(prompt_tokens=800, strategy=f"{folder}/s.py:S") for folder in ("a", "b")]
    run = sp.evaluate([RPS], ["rule"], trials=2, budgets=budgets, out=tmp_path / "run", executor="inline")
    cells = summarize(run.rows)
    labels = [cells.label_of(cell) for cell in cells.cells]
    assert [cell.episodes for cell in cells.cells] == [2, 2]
    assert [label.rpartition("file ")[2] for label in labels] == [digest_of(f"{at}/s.py")[:8] for at in ("a", "b")]
    assert all(replay(run.transcript(row["key"])).identical for row in run.rows)


def test_a_run_whose_records_have_the_path_is_continued_as_it_is(file, tmp_path):
    """Earlier versions recorded the path as it was written, and the keys of the episodes follow from it."""
    asked = {"budgets": sp.Budget(prompt_tokens=800, strategy=f"./{file}"), "executor": "inline"}
    cell = cell_config(RPS, budget=asked["budgets"], player="rule")
    cell = cell.model_copy(update={"budget": asked["budgets"]})
    earlier = run_plan(plan_episodes([cell], trials=1), tmp_path / "run", options=RunOptions(executor="inline"))
    [row] = earlier.rows
    assert row["asked"]["strategy"] == f"./{file}"
    extended = sp.evaluate([RPS], ["rule"], trials=2, out=tmp_path / "run", **asked)
    assert [row["asked"]["strategy"] for row in extended.rows] == [f"./{file}"] * 2
    assert extended.rows[0] == row
    assert all(replay(extended.transcript(row["key"])).identical for row in extended.rows)
