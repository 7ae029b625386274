"""Small cases that the property tests found once; each names the sentence of the architecture that it is about."""

from __future__ import annotations

import json
from pathlib import Path

import smartplay_tools as sp
from smartplay_tools.records.prompts import sent_prompts
from tests import scripts
from tests.test_edges import calling

GAME = "BanditTwoArmedHighLowFixed-v0"


def test_results_of_foreign_calls_with_one_id_answer_them_in_order_and_rebuild(tmp_path: Path) -> None:
    path = tmp_path / "episode.jsonl"
    with sp.Episode(GAME, seed=0, transcript=path, tokenizer="approximate") as episode:
        conversation = sp.Conversation(episode, foreign_tools=[scripts.NOTE])
        conversation.prompt()
        conversation.receive(calling(("a", "observe", ""), ("a", "note", "1"), ("a", "note", "2")))
        for text in ("first", "second"):
            conversation.add({"role": "tool", "tool_call_id": "a", "content": text})
        conversation.prompt()
        assert [item.position for item in conversation.turns[0].items] == [0, 1, 2]
    assert all(sent.sha256 == sent.recorded_sha256 for sent in sent_prompts(sp.read_transcript(path)))
    assert sp.replay(path).identical


def test_nothing_is_recorded_after_the_end(tmp_path: Path) -> None:
    path = tmp_path / "episode.jsonl"
    with sp.Episode(GAME, seed=0, budget=sp.Budget(tool_calls=1), transcript=path, tokenizer="approximate") as episode:
        conversation = sp.Conversation(episode)
        conversation.prompt()
        conversation.receive(calling(("a", "observe", "")))
        conversation.add({"role": "user", "content": "Thank you."})
        assert conversation.receive(calling(("b", "act", '{"action": "1"}')))[0].is_error
        assert episode.call("observe").is_error
    assert json.loads(path.read_text().splitlines()[-1])["event"] == "end"
    assert sp.replay(path).identical
    assert sp.replay(path).result == episode.result


def test_a_cut_history_says_how_much_of_the_whole_is_missing() -> None:
    words = scripts.Words()
    whole, cut = (
        sp.Episode("Hanoi3Disk-v0", seed=0, budget=budget, context="host", tokenizer=words)
        for budget in (sp.Budget(), sp.Budget(result_tokens=20))
    )
    for episode in (whole, cut):
        episode.call("act", {"action": "1"})
    shown, all_of_it = cut.call("observe").text, whole.call("observe").text
    kept, _, notice = shown.rpartition("\n")
    assert words.count(shown) <= 20
    assert notice == f"[{words.count(all_of_it) - words.count(kept)} tokens cut]"
