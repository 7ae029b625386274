"""Wording: every word of a model is in one file a version, no version changes, and an unknown one is refused."""

from __future__ import annotations

import hashlib
import inspect
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context.prompts.budget_line import SENTENCES
from smartplay_tools.context.prompts.wording import _OWN as WORDINGS, PARAPHRASES, VERSION, Wording, versions
from smartplay_tools.context.strategies.memory import COMMANDS
from smartplay_tools.episode.cells import cell_config
from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.evaluation.analysis.grouping import PlayedCell
from smartplay_tools.games.specs import get_spec
from smartplay_tools.players.cache_marks import last_markable
from smartplay_tools.records import Record, sent_prompts
from smartplay_tools.tool_formats.functions import AsyncGameTools, GameTools
from smartplay_tools.transcript import TranscriptWriter
from tests import scripts

ROOT = Path(__file__).parents[1]
GAME = "Hanoi3Disk-v0"
RELEASED = dict.fromkeys(("v1", "v2", "v3"), "45f901036551305bcd54171cf06dcfd89e725983c134feb906772a77824fdb6a")
"""The sha256 of each version, which a release never changes; the words of all are those of the first."""
ADDED = {
    SENTENCES: "304b2629d1a6a3ad9ea4a8ca45920f0b0e52d88304b0f07f6018ee6d756464b5",
    ("too_many",): "f6a8d5612e3d319b6978c0d039552c82ff4e7a75d13d8b6a17093166d343c33a",
}
"""Sentences of rules that came later, and their sha256: no episode without the rule says them, under any version."""


def sha256_of(texts: Mapping[str, str]) -> str:
    sentences = "\n".join(f"{name}\t{text!r}" for name, text in sorted(texts.items()))
    return hashlib.sha256(sentences.encode()).hexdigest()


@pytest.mark.parametrize("version", versions())
def test_a_version_does_not_change(version):
    texts = dict(Wording.of(version).texts)
    for names, sha256 in ADDED.items():
        assert sha256_of({name: texts.pop(name) for name in names}) == sha256
    assert sha256_of(texts) == RELEASED.get(version), (
        f"The words of {version} differ from those that records name: undo the change, write it into the file of a new "
        "version, change VERSION in wording.py, and add the new sha256 here."
    )


def test_every_sentence_is_used_and_every_version_has_all_of_them():
    """Names in the code are strings; a sentence that none of them names would be dead, but for one of a gone harness.

    A released version keeps it, because the sha256 in records is that of all its sentences.
    """
    paths = [*(ROOT / "smartplay_tools").rglob("*.py"), *(ROOT / "adapters").rglob("*.py")]
    named = {name for path in paths for name in re.findall(r"[\"'](\w+)[\"']", path.read_text(encoding="utf-8"))}
    named |= {f"memory_{name}" for taken in COMMANDS.values() for name in taken}
    for version in versions():
        texts = Wording.of(version).texts
        assert texts.keys() - named == {"too_many_calls"}
        assert texts.keys() == Wording.of(VERSION).texts.keys()
        placeholders = {name: set(re.findall(r"{(\w+)}", text)) for name, text in texts.items()}
        assert placeholders == {
            name: set(re.findall(r"{(\w+)}", text)) for name, text in Wording.of(VERSION).texts.items()
        }


@pytest.mark.parametrize("kind", [GameTools, AsyncGameTools])
def test_an_object_of_tools_says_what_the_tools_say(kind):
    """Its methods are documented in the source, where frameworks read them: a new version changes them, too."""
    words = Wording.of(VERSION)
    assert inspect.getdoc(kind.observe) == words("observe")
    assert inspect.getdoc(kind.read_manual) == words("read_manual")
    act, argument = inspect.getdoc(kind.act).split("\n\n")
    assert words("act").startswith(act)
    assert argument == f"Args:\n    action: {words('act_action')}"


def test_a_config_with_an_unknown_version_is_refused():
    config = cell_config(get_spec(GAME)).with_seed(1).model_copy(update={"prompts": "v9"})
    with pytest.raises(InvalidArgumentError, match=r"no prompts 'v9' in this release; it knows v1, v2, v3\.$"):
        sp.Episode.from_config(config)


@pytest.fixture
def of_v9() -> list[dict[str, Any]]:
    """A record of a later release, as far as this one can tell."""
    played = scripts.converse(GAME, [], seed=1).events
    played[0]["config"]["prompts"] = "v9"
    events: list[dict[str, Any]] = []
    TranscriptWriter(events).append(*({name: event[name] for name in event if name != "chain"} for event in played))
    return events


@pytest.mark.parametrize("read", [sp.replay, sp.resume, lambda events: list(sent_prompts(events))])
def test_a_record_of_an_unknown_version_is_told_as_such(of_v9, read):
    with pytest.raises(
        TranscriptError, match=r"made with prompts 'v9', which this release does not know; it knows v1, v2, v3"
    ):
        read(of_v9)


def test_a_reply_is_not_marked_for_a_cache_and_the_message_before_it_is():
    message = {"role": "user", "content": "What now?"}
    assert last_markable([message, message, {"role": "assistant", "content": "Rock."}]) == 1


COMPLETE = {**Wording.of(VERSION).texts, "system": "Play, with the tools.", "error": "No. {reason}"}


def written(path: Path, texts: Mapping[str, Any]) -> str:
    path.write_text("".join(f"{name} = {json.dumps(text)}\n" for name, text in texts.items()), encoding="utf-8")
    return str(path)


def without(name: str) -> dict[str, str]:
    return {other: text for other, text in COMPLETE.items() if other != name}


def test_an_episode_is_played_in_words_of_a_file_and_replays_without_it(tmp_path):
    file, events = written(tmp_path / "mine.toml", COMPLETE), list[Any]()
    with sp.Episode(GAME, seed=1, transcript=events, wording=file) as episode:
        result = sp.play(episode, sp.get_player("rule"))
    name = events[0]["config"]["wording"]
    assert re.fullmatch("mine-[0-9a-f]{16}", name)
    assert result.deviations["wording"] == {"paper": None, "played": name}
    Path(file).unlink()
    assert not sp.replay(events).differences
    assert Record(events).heads[0]["messages"][0]["content"].startswith("Play, with the tools.")


@pytest.mark.parametrize("name", [None, *PARAPHRASES])
def test_a_rule_reads_every_wording_of_the_package(name):
    with sp.Episode(GAME, seed=1, wording=name, budget_line="on") as episode:
        assert sp.play(episode, sp.get_player("rule")).score == 3


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (without("idle"), "lack idle; give every sentence of v3"),
        ({**COMPLETE, "idol": "x"}, "have idol, which no sentence is called"),
        ({**COMPLETE, "cut": "[cut]"}, "cut in the prompts .* must have {missing}, once each"),
        ({**COMPLETE, "error": "{reason}"}, "error in the prompts .* {reason}, once each, after a word of its own"),
        ({**COMPLETE, "idle": ""}, "have no text for idle"),
        ({**COMPLETE, "idle": 3}, "have no text for idle"),
    ],
)
def test_words_that_are_not_complete_are_refused(tmp_path, texts, said):
    with pytest.raises(InvalidArgumentError, match=said):
        sp.Episode(GAME, seed=1, wording=written(tmp_path / "mine.toml", texts))


@pytest.mark.parametrize(("text", "said"), [(None, "name a file, or a paraphrase: brief"), ("a = ", "is not TOML")])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, text, said):
    if text is not None:
        (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InvalidArgumentError, match=said):
        sp.Episode(GAME, seed=1, wording=str(tmp_path / "mine.toml"))


def test_the_papers_protocol_has_its_own_words():
    with pytest.raises(InvalidArgumentError, match="paper's protocol has its own words"):
        cell_config(GAME, protocol="paper", wording="brief")


def test_a_record_whose_sentences_were_changed_is_not_replayed(tmp_path):
    events: list[Any] = []
    with sp.Episode(GAME, seed=1, transcript=events, wording=written(tmp_path / "a.toml", COMPLETE)) as episode:
        episode.call("observe", {})
    WORDINGS.clear()
    events[0]["config"]["sentences"]["system"] = "Lose."
    with pytest.raises(TranscriptError):
        sp.replay(events)


def test_wordings_are_other_cells_of_a_run_in_other_processes(tmp_path):
    """Their names are in the condition, in the key and in the row; a run that is continued needs the same."""
    how: dict[str, Any] = {"trials": 2, "executor": "processes", "workers": 1}
    runs = [sp.evaluate([GAME], ["rule"], out=tmp_path / name, wording=name, **how) for name in PARAPHRASES[:2]]
    rows = [row for run in runs for row in run.folder.rows()]
    assert [row["wording"].partition("-")[0] for row in rows] == ["brief", "brief", "formal", "formal"]
    assert len({row["key"] for row in rows}) == 4
    assert len({PlayedCell.of(row).key() for row in rows}) == 2
    with pytest.raises(InvalidArgumentError):
        sp.evaluate([GAME], ["rule"], out=tmp_path / "brief", wording="formal", **how)
