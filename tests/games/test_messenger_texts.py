"""MESSENGER's manuals: our sentences and their statistics, the draws of an episode, and the original's texts."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.plan import plan_suite
from smartplay_tools.evaluation.suites import get_suite
from smartplay_tools.games.base import read_text
from smartplay_tools.games.messenger import manuals, rules
from smartplay_tools.games.messenger.manuals import OUR_TEXTS, Texts, load
from smartplay_tools.games.messenger.rules import GAMES, SPLITS, Game
from tests import messenger_sentences

DEALT = ("enemy:", "message:", "goal:", *(f"{entity}:" for entity in rules.ENTITIES))


def test_context_and_advice_are_the_originals() -> None:
    hashes = {
        "context.txt": "0c5f53911dd9d89fde2108d0376b150e947ff2a6566131ece401dfdb6fab35b3",
        "advice.txt": "18040da996b207b8f17c08354d52ca38c17fdc0426ae5b378153bbaf21e74986",
    }
    for name, sha256 in hashes.items():
        assert hashlib.sha256(read_text("smartplay_tools.games.messenger", name).encode()).hexdigest() == sha256


def test_the_sentences_never_change() -> None:
    """They are part of the benchmark. A grammar (`data/messenger_grammar.toml`) has written them once."""
    hashes = {"train": "edaca5a4ab88d086", "val": "1c52352343a28043", "test": "09388fa942193f41"}
    for split, sha256 in hashes.items():
        assert hashlib.sha256((OUR_TEXTS / f"text_{split}.json").read_bytes()).hexdigest()[:16] == sha256


def test_there_are_as_many_sentences_as_in_the_original() -> None:
    test = messenger_sentences.entries(load(OUR_TEXTS, "test"))
    assert Counter(entry.kind for entry in test) == {"chaser": 367, "fleeing": 395, "immovable": 393, "unknown": 71}
    assert Counter(entry.role for entry in test) == {"enemy": 504, "message": 362, "goal": 360}
    assert len(messenger_sentences.entries(load(OUR_TEXTS, "train"))) == pytest.approx(2863, abs=1)


def test_pairs_that_are_played_in_val_and_test_are_never_those_of_train() -> None:
    def pairs(split: rules.Split) -> set[tuple[str, str]]:
        real = {pair for game in GAMES[split] for pair in zip(game, manuals.ROLES, strict=True)}
        texts = load(OUR_TEXTS, split)
        assert all(texts[entity][role]["unknown"] for entity, role in real)
        return real

    assert pairs("val") == pairs("test")
    assert not pairs("train") & pairs("test")


@pytest.mark.parametrize(
    "split", [pytest.param(split, marks=() if split == "test" else pytest.mark.slow) for split in SPLITS]
)
def test_the_language_has_the_originals_figures(split: rules.Split) -> None:
    """Every length within half a word, and every share within five points; a little wider outside the test split."""
    for name, original, ours in messenger_sentences.figures(messenger_sentences.entries(load(OUR_TEXTS, split))):
        if name.startswith("characters"):
            assert ours == pytest.approx(original, abs=2), name
        elif name.startswith("words, "):
            assert ours == pytest.approx(original, abs=0.5), name
        else:
            assert ours == pytest.approx(original, abs=5 if split == "test" or name.startswith(DEALT) else 8), name


# The draws of an episode.


def whose(texts: Texts) -> dict[str, tuple[str, str, str]]:
    return {e.text: (e.entity, e.role, e.kind) for e in messenger_sentences.entries(texts)}


def drawn(level: int, number: int) -> list[tuple[Game, rules.State, list[tuple[str, str, str]]]]:
    chance, texts = np.random.default_rng(level), load(OUR_TEXTS, "test")
    about = whose(texts)
    episodes = []
    for _ in range(number):
        game, state = rules.pick(GAMES["test"], chance), rules.start(level, chance)
        sentences = manuals.draw(level, game, state.movements, texts, chance)
        episodes.append((game, state, [about[sentence] for sentence in sentences]))
    return episodes


def test_level_1_says_that_things_stay_or_nothing_of_movement() -> None:
    kinds: Counter[str] = Counter()
    for game, _, about in drawn(1, 300):
        assert sorted(pair[:2] for pair in about) == sorted(zip(game, manuals.ROLES, strict=True))
        kinds.update(kind for *_, kind in about)
    assert set(kinds) == {"immovable", "unknown"}
    assert 0.2 < kinds["unknown"] / 900 < 0.4  # they are drawn from one list, in which they are 71 of 248


def test_level_2_tells_the_movement_but_for_one_sentence_in_seven() -> None:
    silent = 0
    for game, state, about in drawn(2, 500):
        for entity, role, kind in about:
            assert kind in ("unknown", state.movements[game.index(entity)])
            assert role == manuals.ROLES[game.index(entity)]
            silent += kind == "unknown"
    assert 0.12 < silent / 1500 < 0.18


def test_level_3_has_two_sentences_on_every_name_one_of_them_false() -> None:
    leads: Counter[str] = Counter()
    for game, state, about in drawn(3, 300):
        assert Counter(entity for entity, *_ in about) == dict.fromkeys(game, 2)
        for role, (entity, movement) in enumerate(zip(game, state.movements, strict=False)):
            assert (entity, manuals.ROLES[role], movement) in about
        assert (game.message, "enemy", state.movements[3]) in about
        assert (game.goal, "enemy", state.movements[4]) in about
        ((_, role_told, movement_told),) = [a for a in about if a[0] == game.enemy and a[1] != "enemy"]
        assert movement_told != state.movements[0]
        leads[role_told] += 1
    assert 0.4 < leads["goal"] / 300 < 0.6


def test_the_order_of_the_sentences_says_nothing() -> None:
    first = Counter(about[0][1] for _, _, about in drawn(1, 600))
    assert all(150 < number < 250 for number in first.values())


# The original's texts.


def write_texts(folder: Path, change: str = "") -> Path:
    for split in SPLITS:
        marked = (OUR_TEXTS / f"text_{split}.json").read_text(encoding="utf-8").replace("the ", "ye ")
        (folder / f"text_{split}.json").write_text(change or marked, encoding="utf-8")
    return folder


def test_sentences_are_known_by_their_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = sp.GAMES["MessengerL2-v0"].make()
    given = sp.GAMES["MessengerL2-v0"].make(texts=write_texts(tmp_path))
    monkeypatch.setenv(manuals.TEXTS_VARIABLE, str(tmp_path))
    from_environment = sp.GAMES["MessengerL2-v0"].make()
    for game in (ours, given, from_environment):
        game.reset(seed=1)
    assert given.manual == from_environment.manual
    assert "\nye " in given.manual
    sha256 = hashlib.sha256((tmp_path / "text_test.json").read_bytes()).hexdigest()
    played = {"texts": {"paper": "original", "played": f"other:{sha256[:16]}"}}
    assert given.deviations() == from_environment.deviations() == played
    assert ours.deviations() == {"texts": {"paper": "original", "played": "grammar"}}


def test_the_originals_sentences_are_no_deviation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sha256 = hashlib.sha256((write_texts(tmp_path) / "text_test.json").read_bytes()).hexdigest()
    monkeypatch.setattr(manuals, "ORIGINAL_SHA256", {**manuals.ORIGINAL_SHA256, "test": sha256})
    assert sp.GAMES["MessengerL2-v0"].make(texts=tmp_path).deviations() == {}


def play_one(**options: Any) -> list[dict[str, Any]]:
    record: list[dict[str, Any]] = []
    with sp.Episode("MessengerL1-v0", seed=3, transcript=record, **options) as episode:
        sp.play(episode, sp.get_player("rule"))
    return record


def test_a_record_without_a_folder_is_replayed_with_our_sentences_on_any_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = play_one()
    assert "options" not in record[0]["config"]
    monkeypatch.setenv(manuals.TEXTS_VARIABLE, str(write_texts(tmp_path)))
    assert sp.replay(record).identical


@pytest.mark.parametrize("named", ["argument", "variable"])
def test_a_record_of_other_sentences_is_replayed_only_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str
) -> None:
    monkeypatch.setattr(manuals, "_NAMED", {})
    folder = tmp_path / "there"
    folder.mkdir()
    write_texts(folder)
    if named == "variable":
        monkeypatch.setenv(manuals.TEXTS_VARIABLE, str(folder))
    record = play_one(**{"texts": folder} if named == "argument" else {})
    assert record[0]["config"]["options"]["sentences"].startswith("other:")
    assert sp.replay(record).identical

    moved = folder.rename(tmp_path / "here")
    with pytest.raises(sp.InvalidArgumentError, match=r"The sentences 'other:.*that holds them in SMARTPLAY_MESS"):
        sp.replay(record)
    monkeypatch.setenv(manuals.TEXTS_VARIABLE, str(moved))
    assert sp.replay(record).identical


def test_the_suite_for_agents_plays_our_sentences_whatever_the_machine_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suite = get_suite("tools-v1")
    cells = plan_suite(suite, ["rule"]).cells
    monkeypatch.setenv(manuals.TEXTS_VARIABLE, str(write_texts(tmp_path)))
    assert plan_suite(suite, ["rule"]).cells == cells


@pytest.mark.parametrize("wrong", ["[]", "{}", '{"airplane": {"enemy": {"chaser": "fly"}}}', "{", "null"])
def test_texts_of_another_structure_get_one_sentence(tmp_path: Path, wrong: str) -> None:
    with pytest.raises(
        ValueError, match=r"text_test\.json (is not JSON|does not have the structure entity -> role)"
    ) as e:
        sp.GAMES["MessengerL1-v0"].make(texts=write_texts(tmp_path, wrong))
    assert "\n" not in str(e.value)
    assert sp.GAMES["MessengerL1-v0"].make(sentences="grammar").sentences == "grammar", "the folder is not read again"


def test_a_folder_without_texts_gets_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"There is no .*text_val\.json: texts must name a folder"):
        sp.GAMES["MessengerL1-v0"].make(texts=tmp_path, split="val")


def test_a_pair_without_sentences_on_a_movement_is_found_at_once(tmp_path: Path) -> None:
    texts = json.loads((OUR_TEXTS / "text_test.json").read_text(encoding="utf-8"))
    texts["robot"]["message"]["fleeing"] = []
    (tmp_path / "text_test.json").write_text(json.dumps(texts), encoding="utf-8")
    with pytest.raises(ValueError, match="nothing to read at robot -> message -> fleeing"):
        sp.GAMES["MessengerL2-v0"].make(texts=tmp_path)
