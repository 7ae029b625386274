"""What requests cost under the rules of caches, as `tests/cache_judge.py` says, and worked examples."""

from __future__ import annotations

import random
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context.strategies import KINDS
from smartplay_tools.context.tokens.tokenizers import with_pictures
from smartplay_tools.context.turns import with_ids
from smartplay_tools.errors import TranscriptError, UnknownNameError
from smartplay_tools.evaluation.costs.charges import calls_under, charge
from smartplay_tools.providers.caches import CacheRule, cache_rules, rule_named, rule_of
from smartplay_tools.providers.prices import Price
from smartplay_tools.records import Record
from smartplay_tools.records.requests import requests_of
from tests import cache_judge, fuzz, scripts

RULE = {"title": "a rule", "read_on": "2026-11-23", "source": "this test"}
WORDS = with_pictures(scripts.Words())


def any_rule(chance: random.Random) -> CacheRule:
    return CacheRule(
        name="any",
        minimum=chance.choice([0, 0, 60, 250, 400]),
        block=chance.choice([1, 1, 16, 100]),
        write=chance.choice([None, 1.25]),
        marks=chance.choice(["auto", "auto", 0, 1, 2, 4]),
        lookback=chance.choice([None, None, 0, 1, 4, 20]),
        life=chance.choice([None, 0, 3, 20]),
        replies=chance.random() < 0.4,
        tool_choice=chance.random() < 0.5,
        **RULE,
    )


def any_episode(chance: random.Random) -> tuple[scripts.Played, str]:
    """A conversation at random under a budget at random, and its strategy; one in ten is about pictures."""
    form = chance.choice(["picture", "both"]) if chance.random() < 0.1 else "text"
    game, host = "Crafter-v0" if form != "text" else chance.choice(scripts.GAMES), chance.random() < 0.3
    size = scripts.head_tokens(game, WORDS, host=host)
    budget = fuzz.budget(chance, game, size, fuzz.PICTURE + fuzz.WORDS_BESIDE if form != "text" else 0, form)
    script = [
        scripts.Move(fuzz.hostile_reply(chance), chance.choice(scripts.AFTER)) for _ in range(chance.randrange(14))
    ]
    answers = chance.choices(scripts.ANSWERS, k=3)
    played = scripts.converse(
        game, script, host=host, answers=answers, seed=chance.randrange(9), budget=budget, tokenizer=WORDS,
        observation=form,
    )  # fmt: skip
    return played, fuzz.strategy_of(budget)


def replies_of(events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The replies in the order of their prompts, with the ids that their calls have when they are shown again."""
    replies = []
    for event in events:
        if event["event"] == "summary":
            replies.append(event["message"])
        elif event["event"] == "message" and event["by"] == "player":
            calls = event["message"].get("tool_calls") or []
            replies.append(with_ids(event["message"], event.get("ids") or [call["id"] for call in calls]))
    return replies


def check_episode(seed: int) -> str:
    """Compare the charges of one random episode under random rules with the judge's; return its strategy."""
    chance = random.Random(f"caches {seed}")
    played, strategy = any_episode(chance)
    replies = replies_of(played.events)
    for event in played.events:
        if event["event"] == "usage" and seed % 3 == 0:
            event["provider"] = {
                "prompt": event["prompt"] * 6 // 5 + 7,
                "reply": 5,
                "requests": chance.choice([1, 1, 2]),
            }
    log = requests_of(Record(played.events), tokenizer=WORDS)
    sent = played.sent[: len(replies)]
    if log.ratio is None:
        assert [request.prompt for request in log.requests] == [prompt["tokens"] for prompt in sent]
        assert all(sum(unit.tokens for unit in each.units) + 3 == each.prompt for each in log.requests)
    times: list[float | None] = [None] * len(replies)
    if chance.random() < 0.7:
        times = sorted(float(chance.randrange(6 * len(replies))) for _ in replies)
    log = replace(log, requests=[request._replace(at=at) for request, at in zip(log.requests, times, strict=True)])
    asked = cache_judge.asked(sent, replies, times, WORDS.count)
    for rule in (any_rule(chance), any_rule(chance), any_rule(chance), *cache_rules().values()):
        marks = chance.choice([("stable", "end"), ("end",), ("stable",), ()])
        calls = [call[:3] for call in calls_under(log, rule, marks=marks)]
        assert calls == cache_judge.judge(asked, dict(rule), marks, log.ratio or Fraction(1)), (seed, rule, marks)
    return strategy


@pytest.mark.parametrize(
    "seeds",
    [range(30), pytest.param(range(30, 230), marks=pytest.mark.slow)],
)
def test_random_episodes_cost_what_the_judge_says(seeds: range) -> None:
    asked = {name for seed in seeds for name in check_episode(seed).partition(", ")[0].split(" and ")}
    assert asked <= {"plain dropping", *KINDS}
    assert len(seeds) < 100 or len(asked) == len(KINDS) + 1, "of every strategy"


@pytest.mark.parametrize(
    ("player", "options", "name"),
    [
        ("openai:gpt-5.5", {}, "openai-5-5"),
        ("openai-responses:gpt-6.1-sol", {}, "openai-5-6"),
        ("openai:gpt-5.6", {"base_url": "http://localhost:8000/v1"}, None),
        ("anthropic:claude-opus-5", {}, "anthropic-512"),
        ("anthropic:claude-opus-5-5", {}, None),
        ("anthropic:claude-haiku-4-5-20251001", {}, "anthropic-4096"),
        ("langchain:google_genai:gemini-3.5-flash", {}, "gemini-3"),
        ("rule", {}, None),
    ],
)
def test_a_player_has_the_rule_of_its_model(player: str, options: dict[str, str], name: str | None) -> None:
    rule = rule_of(player, options, cache_rules())
    assert (rule and rule.name) == name


def test_a_rule_is_named_by_itself_or_by_a_model() -> None:
    rules = cache_rules()
    assert rule_named("anthropic:claude-opus-5", rules) is rules["anthropic-512"]
    with pytest.raises(UnknownNameError, match=r"no rule of a cache 'antropic-512'; did you mean anthropic-512"):
        rule_named("antropic-512", rules)


def test_a_record_without_prompts_or_usage_has_no_cost() -> None:
    events: list[Any] = []
    with sp.Episode("Hanoi3Disk-v0", seed=0, context="host", transcript=events) as episode:
        episode.call("act", {"action": "1"})
    with pytest.raises(TranscriptError, match="has no prompts: its episode was played with the host's own context"):
        requests_of(Record(events))
    played = [event for event in short_episode() if event["event"] != "usage"]
    with pytest.raises(TranscriptError, match="The record has no usage, so nothing can be said about its cost"):
        requests_of(Record(played))
    with pytest.raises(sp.InvalidArgumentError, match="A mark is at one of stable, end, not begin"):
        charge(requests_of(Record(short_episode())), cache_rules()["none"], marks=["begin"])  # type: ignore[list-item]


def short_episode() -> list[Any]:
    events: list[Any] = []
    with sp.Episode("Hanoi3Disk-v0", seed=0, transcript=events) as episode:
        sp.play(episode, sp.get_player("rule"))
    return events


def test_a_price_overrides_the_rates_of_a_rule_where_it_has_its_own() -> None:
    rule = cache_rules()["anthropic-512"]
    plain, full = rule.priced(Price.parse("4,20")), rule.priced(Price.parse("4,20,0.2,6"))
    assert (plain.cached, plain.write) == (((0, pytest.approx(0.4)),), ((0, 5.0),))
    assert (full.cached, full.write) == (((0, 0.2),), ((0, 6.0),))
    calls = [(1_000, 400, 100, 10), (2_000, 0, 0, 0)]
    usages = [sp.Usage(prompt=p, cached=hit, written=written, reply=reply) for p, hit, written, reply in calls]
    assert full.each(calls) == pytest.approx([*map(full.cost, usages)])


def test_each_call_is_charged_in_the_tier_of_its_prompt() -> None:
    tiers = Price(((0, 1.0), (1_000, 2.0)), ((0, 4.0),), ((0, 0.5), (2_000, 1.0)), "given")
    calls = [(999, 10, 0, 1), (1_000, 10, 5, 1), (2_000, 10, 0, 1)]
    usages = [sp.Usage(prompt=p, cached=hit, written=written, reply=reply) for p, hit, written, reply in calls]
    assert tiers.each(calls) == pytest.approx([*map(tiers.cost, usages)])


def test_written_tokens_are_billed_at_their_own_rates_and_left_out_of_records_that_have_none() -> None:
    price = Price(((0, 4.0),), ((0, 20.0),), ((0, 0.4),), "given", ((0, 5.0),), ((0, 8.0),))
    usage = sp.Usage(prompt=1_000_000, cached=400_000, written=300_000, written_1h=100_000)
    assert price.cost(usage) == pytest.approx(0.3 * 4 + 0.4 * 0.4 + 0.2 * 5 + 0.1 * 8)
    assert sp.Usage(prompt=1).model_dump() == {"prompt": 1, "reply": 0, "cached": None, "reasoning": 0, "requests": 1}
    assert sp.Usage(written=2).model_dump()["written"] == 2
    older = {"input": [[0, 4.0]], "output": [[0, 20.0]], "cached": [[0, 0.4]], "source": "given"}
    assert Price.from_json(older).cost(usage) == pytest.approx(0.6 * 4 + 0.4 * 0.4)
    assert Price.from_json(price.to_json()) == price


def test_the_papers_protocol_is_charged_too_and_a_pinned_manual() -> None:
    events: list[Any] = []
    with sp.Episode("Hanoi3Disk-v0", seed=0, transcript=events) as episode:
        sp.play(episode, sp.ScriptedPlayer([{"role": "assistant", "content": "Hm."}] * 6), protocol="paper")
    log = requests_of(Record(events))
    assert all(sum(unit.tokens for unit in each.units) + 3 == each.prompt for each in log.requests)
    calls = calls_under(log, cache_rules()["llama-cpp"])
    # The second question of a step repeats the first, and the answer to it; the next step has another history.
    first = log.requests[0]
    assert [call.hit for call in calls[:2]] == [0, first.prompt - 3 + first.reply]
    assert calls[2].hit < first.prompt - 3
    pinned: list[Any] = []
    with sp.Episode("Hanoi3Disk-v0", seed=0, manual="pinned", transcript=pinned) as episode:
        sp.play(episode, sp.get_player("rule"))
    usages = Record(pinned).usages
    hits = [call.hit for call in calls_under(requests_of(Record(pinned)), CacheRule(name="plain", **RULE))]
    assert hits == [usage["prefix"] for usage in usages]
