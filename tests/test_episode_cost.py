"""A budget in money: what an episode costs by its rule, as `tests/cache_judge.py` and own arithmetic say."""

from __future__ import annotations

import json
import random
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.cli.options import names
from smartplay_tools.evaluation.analysis.details import details
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.providers.caches import cache_rules
from smartplay_tools.records import replay
from tests import cache_judge, fuzz, scripts
from tests.test_charges import WORDS, any_rule, replies_of

CARDS = "RockPaperScissorBasic-v0"


def any_line(chance: random.Random) -> tuple[str, dict[str, Any], dict[str, Fraction]]:
    """A rule of costs at random: the line that spells it out, the cache's rule, and the price of each kind of token."""
    rule = {**dict(any_rule(chance)), "life": None}
    rule["write"] = chance.choice([None, 0.0, 1.25, 3e-06])
    rates = {"input": chance.choice([1, 2.5e-06, 0.3]), "read": chance.choice([0, 0.1, 0.25, 1])}
    rates |= {"write": rule["write"] or 0, "output": chance.choice([0, 1, 5, 1.5e-05])}
    names = ("minimum", "block", "marks", "lookback", "replies", "tool_choice")
    given = {**rates, "write": rule["write"], **{name: rule[name] for name in names}}
    said = [f"{name}={str(value).lower()}" for name, value in given.items() if value is not None]
    return "any:" + ",".join(said), rule, {name: Fraction(str(rate)) for name, rate in rates.items()}


def check_episode(seed: int) -> str:
    """Play a random script under a random budget in money; judge every cap on a reply, and the end."""
    chance = random.Random(f"money {seed}")
    game, host = chance.choice(scripts.GAMES), chance.random() < 0.3
    line, rule, rates = any_line(chance)
    drawn = fuzz.budget(chance, game, scripts.head_tokens(game, WORDS, host=host)).model_copy(update={"strategy": None})
    marks = chance.choice([True, "stable", False])
    places = {True: ("stable", "end"), "stable": ("stable",), False: ()}[marks]
    script = [scripts.Move(fuzz.hostile_reply(chance), chance.choice(scripts.AFTER)) for _ in range(14)]
    options: dict[str, Any] = {
        "host": host,
        "seed": chance.randrange(9),
        "tokenizer": WORDS,
        "player_options": {"cache": marks},
    }

    def play(**more: Any) -> scripts.Played:
        return scripts.converse(game, script, budget=sp.Budget(**dict(drawn) | more), **options)

    def costs(played: scripts.Played, number: int) -> list[Fraction]:
        """What each of the first prompts costs."""
        replies = [*replies_of(played.events), {"role": "assistant", "content": ""}][:number]
        asked = cache_judge.asked(played.sent[:number], replies, [None] * number, WORDS.count)
        judged = cache_judge.judge(asked, rule, places, Fraction(1))
        return [
            (prompt - hit - written) * rates["input"] + hit * rates["read"] + written * rates["write"]
            for prompt, hit, written in judged
        ]

    free = play()
    whole = sum(costs(free, len(replies_of(free.events))), Fraction())
    cap = float(whole) * chance.random() * 1.2 or 1.0
    played = play(episode_cost=cap, cost_rule=line)
    assert played.sent == [
        {**sent, "max_tokens": now["max_tokens"]} for sent, now in zip(free.sent, played.sent, strict=False)
    ]
    usages = [event for event in played.events if event["event"] == "usage"]
    spent, least = Fraction(), drawn.reply_tokens or 40
    for at, (sent, cost) in enumerate(zip(played.sent, costs(played, len(played.sent)), strict=True)):
        left = Fraction(repr(cap)) - spent - cost
        tokens = sum(event["prompt"] + event["reply"] for event in usages[:at])
        limits = [drawn.reply_tokens, left // rates["output"] if rates["output"] else None]
        limits += [drawn.episode_tokens and drawn.episode_tokens - tokens - sent["tokens"]]
        assert left >= least * rates["output"]
        assert sent["max_tokens"] == min((limit for limit in limits if limit is not None), default=None)
        if at < len(usages):
            reply = usages[at]["reply"]
            spent += cost + reply * rates["output"]
            assert usages[at]["spent"] == float(spent)
            assert spent <= Fraction(repr(cap)) or reply > sent["max_tokens"]
    assert played.result.spent_cost == float(spent)
    reason, number = played.result.end_reason, len(played.sent)
    if reason == "episode_cost":
        assert Fraction(repr(cap)) - spent - costs(free, number + 1)[-1] < least * rates["output"]
    assert not replay(played.events, tokenizer=WORDS).differences
    return reason


@pytest.mark.parametrize("seeds", [range(60), pytest.param(range(60, 600), marks=pytest.mark.slow)])
def test_the_cap_on_costs_is_never_passed_and_never_ends_an_episode_too_soon(seeds: range) -> None:
    reasons = [check_episode(seed) for seed in seeds]
    assert reasons.count("episode_cost") > len(seeds) // 4


@pytest.mark.parametrize(
    "line", [*cache_rules(), "anthropic:claude-opus-5", "ours:read=0.25,output=5", "a:input=2e-06"]
)
def test_a_budget_has_the_numbers_of_its_rule_whatever_it_was_called(line: str) -> None:
    budget = sp.Budget(episode_cost=0.5, cost_rule=line)
    assert sp.Budget(**dict(budget)) == budget
    if line == "none":
        assert budget.cost_rule is None, "of which budgets say nothing"
    else:
        assert ":input=" in str(budget.cost_rule)


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("opus", "no rule of a cache 'opus'"),
        ("ours:life=3", "each once"),
        ("ours:read=1,read=2", "each once"),
        ("ours:read=-1", "greater than or equal to 0"),
        ("openai:gpt-5.5", "changes with the length of a prompt"),
    ],
)
def test_a_rule_that_says_no_price_is_refused_in_a_sentence(line: str, error: str) -> None:
    with pytest.raises(sp.InvalidArgumentError, match=error):
        sp.Budget(episode_cost=1, cost_rule=line)


def test_a_host_that_sends_its_own_prompts_cannot_keep_a_budget_in_money() -> None:
    with pytest.raises(sp.InvalidArgumentError, match="leaves to the host"):
        sp.Episode(CARDS, seed=1, context="host", budget=sp.Budget(episode_cost=1_000))


@pytest.mark.parametrize(
    "limits",
    [{"episode_cost": cost} for cost in range(800, 3_000, 200)]
    + [{"episode_tokens": n} for n in range(700, 2_700, 300)],
)
def test_an_episode_of_a_compactor_whose_prompt_could_not_be_paid_replays(limits: dict[str, float]) -> None:
    events: list[Any] = []
    budget = sp.Budget(history=None, strategy="compact_20260112:trigger=450", **limits)  # type: ignore[arg-type]
    conversation = sp.Conversation(sp.Episode("Hanoi3Disk-v0", seed=1, budget=budget, transcript=events))
    while (prompt := conversation.prompt()) is not None:
        answer = {"role": "assistant", "content": "<summary>Nothing yet.</summary>"}
        conversation.receive(sp.call("observe") if prompt.purpose == "play" else answer)
    assert conversation.episode.result.end_reason == next(iter(limits))
    assert replay(events).identical


def test_the_tables_of_a_run_say_what_was_spent(tmp_path: Path) -> None:
    budgets = [sp.Budget(history=None, episode_cost=cap, cost_rule="openai-5-5") for cap in (8_000, None)]
    run = sp.evaluate([CARDS], ["rule"], budgets=budgets, trials=2, out=tmp_path / "run", executor="inline")
    poor, rich = (summary := summarize(run.rows)).cells
    assert all(row.get("spent_cost", 0) <= 8_000 for row in run.rows)
    assert poor.spent_cost.mean > 6_500
    assert poor.end_reasons == {"episode_cost": 2}
    assert rich.spent_cost is None
    [took] = [table for table in details(summary) if table.title.startswith("what it took")][:1]
    assert took.columns[-1].heading == "spent"


def test_a_list_of_rules_in_a_sweep_keeps_the_numbers_of_each() -> None:
    assert names("none, ours:read=0.25,output=5,openai-5-5") == ["none", "ours:read=0.25,output=5", "openai-5-5"]


def test_a_record_without_a_budget_in_money_says_nothing_of_one() -> None:
    events: list[dict[str, Any]] = []
    with sp.Episode(CARDS, seed=1, budget=sp.Budget(tool_calls=2), transcript=events) as episode:
        result = sp.play(episode, sp.get_player("rule"))
    assert "cost" not in json.dumps([event for event in events if event["event"] != "start"])
    assert not {"episode_cost", "cost_rule"} & (events[0]["budget"].keys() | events[0]["config"]["budget"].keys())
    assert result.spent_cost == 0
