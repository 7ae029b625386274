"""A class, an object or a text where another shape belongs is one sentence that says what to write."""

from __future__ import annotations

import re

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.players import PlayerConfig

HANOI = "Hanoi3Disk-v0"


class P:
    name = "p"

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        return sp.Reply(sp.call("observe"))


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda out: sp.get_player(P), "P is not the name of a player; a class that is not registered is called"),
        (lambda out: sp.evaluate([HANOI], [P], out=out), 'with a name for each: {"p": P}'),
        (lambda out: sp.evaluate([HANOI], [P()], out=out), 'with a name for each: {"p": P}'),
        (lambda out: sp.evaluate([HANOI], "rule", out=out), "a list of names; write ['rule']"),
        (lambda out: sp.evaluate(HANOI, ["rule"], out=out), "a list of ids; write ['Hanoi3Disk-v0']"),
        (lambda out: sp.evaluate([P], ["rule"], out=out), "P is not a setting; give a GameSpec"),
        (
            lambda out: sp.evaluate([HANOI], ["rule"], budgets=[5], out=out),
            "5 is not a Budget; write Budget(history=5)",
        ),
        (lambda out: sp.Budget(prompt_token=600), "A budget has no field 'prompt_token'; did you mean prompt_tokens"),
        (lambda out: sp.Budget(prompt_tokens="many"), "prompt_tokens='many' is no limit of a budget: input should be"),
        (lambda out: sp.Budget(slack=2), "slack=2 is no limit of a budget: input should be less than or equal to 1."),
        (lambda out: sp.Budget(slack=float("nan")), "slack=nan is no limit of a budget"),
        (lambda out: sp.Budget(history=-1), "history=-1 is no limit of a budget"),
        (lambda out: sp.sweep([HANOI], [P], vary={"history": [1]}, out=out), 'with a name for each: {"p": P}'),
        (lambda out: sp.sweep(HANOI, ["rule"], vary={"history": [1]}, out=out), "a list of ids"),
        (lambda out: PlayerConfig("p", factory=P), 'as in PlayerConfig(name="rule")'),
        (lambda out: sp.play(sp.Episode(HANOI, seed=1), P), "P is a class, not a player; pass an instance: P()"),
        (lambda out: sp.play(sp.Episode(HANOI, seed=1), "rule"), "pass get_player('rule')"),
        (lambda out: sp.play(HANOI, P()), "str is not an episode; pass one"),
        (lambda out: sp.Episode(P, seed=1), "P is not a setting"),
        (lambda out: sp.register(P), "P is not a setting"),
        (lambda out: sp.register_strategy("mine", P()), "P is an object; register the class of the strategy 'mine'"),
    ],
)
def test_it_is_refused_in_one_sentence(call, sentence, tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match=re.escape(sentence)) as raised:
        call(tmp_path / "run")
    assert "\n" not in str(raised.value)


def test_a_class_with_a_name_is_a_player(tmp_path):
    run = sp.evaluate(
        [HANOI], {"p": P}, out=tmp_path / "run", trials=1, executor="inline", budgets=sp.Budget(tool_calls=2)
    )
    assert [row["player"] for row in run.rows] == ["p"]
