"""What was in view when it was needed: counted from records, whoever played, and shown cell by cell."""

from __future__ import annotations

import json
import re

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.headline import TERMS
from smartplay_tools.evaluation.analysis.remembering import ANSWERS, MONEY, WORK, question_cost, remembering_tables
from smartplay_tools.evaluation.pages.report.page import write_report
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.games import with_action_list
from smartplay_tools.providers.prices import Price
from smartplay_tools.records import Record, replay
from smartplay_tools.records.contents import PLACES, stands_in
from smartplay_tools.records.remembered import answers, remembered
from tests.evaluation import command

STEPS = 8


class Echo(sp.TextGame):
    """Name the digit of two steps before; a skip breaks the rules."""

    actions = ("0", "1", "Skip")
    manual = with_action_list("Name the digit of two steps before. Never skip.", actions)

    def _reset(self):
        self.digits = [0]
        return "Digit 0."

    def _step(self, action):
        right = bool(self.needs) and action == self.digits[-3]
        self.score += right
        self.digits.append(len(self.digits) % 2)
        return f"Digit {self.digits[-1]}.", float(right), False, len(self.digits) > STEPS

    def _state(self):
        return self.digits

    @property
    def needs(self):
        return [self._steps - 2] if self._steps > 1 else []

    @property
    def breaks(self):
        return [2]


@pytest.fixture
def echo():
    spec = sp.GameSpec(id="Echo-v0", family="echo", entry_point=Echo, history=STEPS, rollout=STEPS, trials=3)
    return sp.register(spec).id


def played(game, *replies, said="Nothing.", **budget):
    """The record of an episode of these replies: actions, and calls of other tools."""
    events = []
    with sp.Episode(game, seed=1, budget=sp.Budget(**budget), transcript=events) as episode:
        conversation = sp.Conversation(episode)
        for reply in replies:
            while conversation.prompt().purpose != "play":
                conversation.receive({"role": "assistant", "content": said})
            conversation.receive(sp.call("act", action=reply) if isinstance(reply, str) else reply)
    return events


RIGHT = ("0", "1", "0", "1", "0", "1", "0", "1")
LOOK = sp.call("observe")


def test_an_answer_is_in_view_where_the_prompt_shows_what_it_needs(echo):
    shares = remembered(Record(played(echo, LOOK, *RIGHT, history=None)))
    assert shares == {"in view": [6, 6], "in view: observation": [6, 6], "0": [6, 6]}
    shares = remembered(Record(played(echo, LOOK, *RIGHT[:6], "1", "0", history=1)))
    assert shares == {"out of view": [4, 6], "1": [1, 1], "2-3": [3, 5]}


def test_what_was_never_shown_has_survived_nothing(echo):
    shares = remembered(Record(played(echo, *RIGHT, history=None)))
    assert shares == {"out of view": [1, 1], "in view": [5, 5], "in view: observation": [5, 5], "0": [5, 5]}


def test_who_asks_a_tool_before_an_answer_has_looked(echo):
    recall = sp.call("recall", query="Digit")
    shares = remembered(Record(played(echo, LOOK, *RIGHT[:4], recall, *RIGHT[4:], history=1, recall_tokens=100)))
    assert shares["looked"] == [1, 6]


def test_rules_are_kept_or_broken_once_the_manual_was_read(echo):
    manual = sp.call("read_manual")
    shares = remembered(Record(played(echo, "Skip", manual, "Skip", "Skip", *RIGHT[3:], history=2)))
    assert shares["rules"] == [5, 7]


class Told(Echo):
    """The same, and says which words the digit is."""

    @property
    def needs(self):
        return {step: f"step {step} {self.digits[step]}" for step in super().needs}


@pytest.fixture
def told():
    spec = sp.GameSpec(id="Told-v0", family="told", entry_point=Told, history=STEPS, rollout=STEPS, trials=3)
    return sp.register(spec).id


SAID = "Step 0: 0. Step 1: 1. In step 2 there was a 0, then step 3 (1), step 4 = 0, step 5 -> 1, step 6: 0"


def saying(text, action):
    return {**sp.call("act", action=action), "content": text}


def test_words_of_the_model_keep_what_has_left_the_view(told):
    events = played(told, LOOK, *(saying(SAID, action) for action in RIGHT), history=0)
    assert {answer.place for answer in answers(Record(events)) if answer.places} == {"newest reply"}
    assert remembered(Record(events))["in view"] == [6, 6]
    once = played(told, LOOK, saying(SAID, "0"), *RIGHT[1:], history=0, beyond_history="mask")
    assert {answer.place for answer in answers(Record(once)) if answer.places} == {"own words"}
    noted = played(told, LOOK, sp.call("take_notes", text=SAID), *RIGHT, history=0, notes_tokens=200)
    assert {answer.place for answer in answers(Record(noted)) if answer.places} == {"memory"}
    assert replay(events).identical


def test_a_budget_closes_the_channel_of_the_models_own_words(told):
    """Without it, a player that says everything again in each reply needs no window."""
    events = played(told, LOOK, *(saying(SAID, action) for action in RIGHT), history=0, own_words="never")
    assert {answer.place for answer in answers(Record(events)) if answer.places} == {"nowhere"}
    assert replay(events).identical
    arguments = [{**saying(SAID, action), **sp.call("act", action=action, why=SAID)} for action in RIGHT]
    refused = played(told, LOOK, *arguments, history=0, own_words="never")
    assert Record(refused).result.steps == 0


def test_a_summary_and_a_memory_are_told_apart(told, kept):
    for name, place in (("Asked", "summary"), ("Written", "memory"), ("Blind", "nowhere")):
        events = played(told, LOOK, *RIGHT, said=SAID, history=0, strategy=f"{kept}:{name}")
        assert {answer.place for answer in answers(Record(events)) if answer.places} == {place}


KEPT = f"""
SAID = {SAID!r}


class Asked:
    persistent = False

    def compact(self, history, room):
        text = (yield [{{"role": "user", "content": "What matters?"}}])["content"]
        return [{{"role": "user", "content": text}}, *history[1:]]


class Blind(Asked):
    def compact(self, history, room):
        return [*history[:1], {{"role": "user", "content": SAID}}]


class Short:
    persistent = False

    def compact(self, history, room):
        at = max((at for at, message in enumerate(history) if message["role"] == "assistant"), default=0)
        if at < 2:
            return history
        asked = yield [*history, {{"role": "user", "content": "What matters?"}}]
        return [history[0], {{"role": "user", "content": asked["content"]}}, *history[at:]]


class Idle:
    def compact(self, history, room):
        return history


class Written:
    persistent = False

    def compact(self, history, room):
        return [{{"role": "user", "content": SAID}}, *history[1:]]
"""


@pytest.fixture
def kept(tmp_path):
    """The file of these compactors."""
    (tmp_path / "kept.py").write_text(KEPT, encoding="utf-8")
    return tmp_path / "kept.py"


def test_what_a_compactor_did_is_in_the_tables(told, kept, tmp_path):
    names = ("Asked", "Written", "Idle")
    budgets = [sp.Budget(history=None, prompt_tokens=440, strategy=f"{kept}:{name}") for name in names]
    run = sp.evaluate([told], ["random"], budgets=budgets, trials=2, executor="inline", out=tmp_path / "run")
    table = next(table for table in remembering_tables(run.rows) if table.title.startswith("what the compactor"))
    assert [column.heading for column in table.columns][1:] == [*WORK, MONEY]
    assert [line[-1] for line in table.rows[1:]] == ["0", "unknown", "0"]
    assert [line[0].rpartition(", ")[2] for line in table.rows[1:]][1:] == ["wrote without asking", "never acts"]
    assert "-" not in [line[1] for line in table.rows[1:]]
    report = write_report([tmp_path / "run"], tmp_path / "report.html").read_text(encoding="utf-8")
    assert "What the compactor did in an episode" in report
    assert "never acts" in report


def test_what_questions_cost_is_told_beside_the_episode_and_never_guessed(told, kept, tmp_path):
    """Rows of older versions lack it: nothing where nothing was asked or all was free, otherwise unknown."""
    folder, second = tmp_path / "run", {"compactor_player": {"name": "rule-notes", "words": True}}
    budget = sp.Budget(history=None, prompt_tokens=440, strategy=f"{kept}:Asked")
    players = [PlayerConfig(name="random", options=second)]
    prices = {"random": Price.per_million(1, 1), "rule-notes": Price.per_million(20, 30)}
    given = {"budgets": [budget], "trials": 1, "executor": "inline"}
    (row,) = sp.evaluate([told], players, **given, prices=prices, out=folder).rows
    tokens = row["tokens"]
    asked = (20 * tokens["question_prompt"] + 30 * tokens["question_reply"]) / 1e6
    played = sum(tokens[part] - tokens[f"question_{part}"] for part in ("prompt", "reply")) / 1e6
    assert (row["question_cost"], row["cost"]) == pytest.approx((asked, asked + played))
    assert MONEY in command.run("results", folder, "--all", "--format", "markdown")[1]
    assert MONEY in write_report([folder], tmp_path / "page.html").read_text(encoding="utf-8")
    older = {name: value for name, value in row.items() if name != "question_cost"}
    assert question_cost(older) is None
    assert question_cost(older | {"cost": 0.0}) == question_cost(older | {"questions": 0, "tokens": {}}) == 0


def test_play_says_what_a_compactor_did_and_the_score_where_it_has_failed(kept):

    def printed(strategy: str, *more: str) -> str:
        options = ("--player", "reader", "--prompt-tokens", 1_600, "--strategy", strategy, *more)
        return " ".join(re.sub("│", "", command.run("play", "Lockers6-v0", *options)[1]).split())

    assert "rewritings" in (asked := printed(f"{kept}:Short", "--price", "reader=20,30"))
    assert "questions cost $0." in asked
    assert "what its words cost is not known" in printed(f"{kept}:Blind")
    assert "strategy_error" in (wrong := printed("tests/data/broken_strategies.py:Raises"))
    assert "the episode failed" not in wrong


@pytest.mark.parametrize(
    ("text", "stands"),
    [
        ("Card 5 is hearts.", True),
        ("5: Hearts, 6: spades", True),
        ("card 5 was one of hearts", True),
        ("5 spades, 6 hearts", False),
        ("card 15 is hearts", False),
        ("hearts 5", False),
        ("the 5 heartsease", False),
    ],
)
def test_a_content_is_its_words_in_their_order_and_close_together(text, stands):
    assert stands_in("5 hearts", text) is stands


def test_records_of_older_versions_have_no_contents_and_replay_alike(told):
    events = json.loads(json.dumps(played(told, LOOK, *RIGHT, history=None)))
    assert any("contents" in event["data"] for event in events if event["event"] == "call")
    for event in events:
        if event["event"] == "call":
            event["data"].pop("contents", None)
    assert remembered(Record(events))["in view"] == [6, 6]
    assert all(difference.endswith("its chain is broken.") for difference in replay(events).differences)


def test_a_game_that_declares_nothing_has_no_shares():
    assert remembered(Record(played("Hanoi3Disk-v0", LOOK, "A->B"))) is None


def test_a_row_has_the_shares_and_the_tables_show_and_explain_them(echo, tmp_path):
    budgets = [sp.Budget(history=None), sp.Budget(history=1)]
    run = sp.evaluate([echo, "Hanoi3Disk-v0"], ["random"], budgets=budgets, trials=3, executor="inline", out=tmp_path)
    assert ["memory" in row for row in run.rows] == [True] * 6 + [False] * 6
    seen, stood, survived = remembering_tables(run.rows)
    assert [column.heading for column in stood.columns][1:] == [*PLACES]
    assert stood.columns[1].heading in TERMS
    assert [column.heading for column in seen.columns][1:] == [*ANSWERS]
    assert seen.columns[1].heading in TERMS
    assert [line[1] for line in seen.rows[1:]] == ["83 [31, 94]", "0 [0, 63]"]
    assert survived.rows[2][1] == "-"
    assert list(remembering_tables(run.rows[6:])) == []


def test_a_compactor_loses_the_manual_and_what_it_asks_and_writes_is_counted(echo, kept):
    replies = [sp.call("read_manual"), *RIGHT[:2], "Skip", *RIGHT[3:]]
    events = played(echo, LOOK, *replies, history=None, strategy=f"{kept}:Short")
    shares, tokens = remembered(Record(events)), Record(events).result.tokens
    assert (shares["rules"], shares["rules lost"]) == ([1, 1], [6, 7])
    assert shares["out of view"] == [5, 6]
    assert 0 < tokens.question_reply < tokens.question_prompt < tokens.prompt
    assert tokens.texts > 7
    assert replay(events).identical
