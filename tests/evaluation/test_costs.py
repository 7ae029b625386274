"""The command `cost` and the option `--cache`: what runs would have cost under the rules of caches."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.episode.cells import cell_config
from smartplay_tools.evaluation.analysis.money import cell_costs
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.costs.charges import Charge
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.estimate import estimate_cell
from smartplay_tools.providers.prices import Price
from smartplay_tools.records import Record
from tests.evaluation.command import refused, shown_by

BANDIT = "BanditTwoArmedHighLowFixed-v0"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("costs") / "run"
    sp.sweep([BANDIT], ["rule"], vary={"history": [None, 10], "slack": [0, 0.5]}, trials=1, out=out, executor="inline")
    return str(out)


def test_the_cheapest_window_depends_on_the_rule(swept: str) -> None:
    shown = json.loads(shown_by("cost", swept, "--json"))
    tokens = [row["tokens"]["prompt"] + row["tokens"]["reply"] for row in RunFolder(swept).rows()]
    assert (shown[0]["window"], shown[0]["tokens"]) == ("history all", max(tokens))
    cheapest = {
        rule: min((row for row in shown if row["rule"] == rule), key=lambda row: row["cost"])["window"]
        for rule in ("openai-5-5", "anthropic-512", "gemini-3", "vllm")
    }
    assert cheapest == {
        "openai-5-5": "history all",
        "anthropic-512": "history 10, slack 0.5",
        "gemini-3": "history 10, slack 0.5",
        "vllm": "history all",
    }
    # Where writes are billed, a window that slides at every step is dearer than no cache.
    sliding = {row["rule"]: row["cost"] for row in shown if row["window"] == "history 10"}
    assert sliding["anthropic-512"] > sliding["none"]


def test_where_prompts_are_marked_is_a_part_of_the_question(swept: str) -> None:
    costs = {
        marks: json.loads(shown_by("cost", swept, "--cache", "anthropic-512", "--marks", marks, "--json"))[2]["cost"]
        for marks in ("stable,end", "end", "stable", "none")
    }
    assert (
        costs["stable"] < costs["none"] < costs["end"]
    )  # of a window that slides: only what is stable is worth a mark


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--cache", "vlm"], "There is no rule of a cache 'vlm'; did you mean vllm?"),
        (["--price", "-1,2"], "is not a price"),
        (["--marks", "middle"], "A mark is at one of stable, end, not middle."),
    ],
)
def test_a_mistake_is_one_sentence(swept: str, words: list[str], error: str) -> None:
    assert error in refused("cost", swept, *words)


def test_a_run_without_prompts_has_no_cost(tmp_path: Any) -> None:
    out = tmp_path / "run"
    sp.evaluate(games=["Hanoi3Disk-v0"], players=["random"], trials=1, out=out, executor="inline")
    for record in (out / "episodes").glob("*.jsonl"):
        lines = record.read_text(encoding="utf-8").splitlines(keepends=True)
        record.write_text("".join(line for line in lines if '"event": "usage"' not in line), encoding="utf-8")
    assert "has no finished episode with prompts and usage on record" in refused("cost", out)


CHARGE = Charge(50, 80_000, 0, 0, 2_000, 0.4, 0.0)


def test_the_score_beside_a_cost_is_that_of_every_other_table(swept: str) -> None:
    row = RunFolder(swept).rows()[0] | {"carry": "notes", "chain": 2}
    rows = [row | {"key": f"{trial:016x}", "trial": trial, "score": score} for trial, score in enumerate([10, 20, 30])]
    (cell,) = cell_costs(rows, {row["key"]: [CHARGE] for row in rows})
    assert cell.score == summarize(rows).cells[0].score.mean == 22.5


def test_the_area_is_the_mean_score_while_money_is_spent(swept: str) -> None:
    shown = [row for row in json.loads(shown_by("cost", swept, "--json")) if row["rule"] == "none"]
    dearest = max(row["cost"] for row in shown)
    run = RunFolder(swept)
    for row, result in zip(shown, run.rows(), strict=True):
        record = Record.read(run.transcript(result["key"]))
        scores = [0.0, *(call["data"]["score"] for call in record.calls)]
        costs = [usage["prompt"] + 5 * usage["reply"] for usage in record.usages]
        spent = sum(score * cost for score, cost in zip(scores, costs, strict=False))
        assert row["area"] == pytest.approx((spent + scores[-1] * (dearest - sum(costs))) / dearest)


def test_tokens_that_are_written_for_an_hour_are_charged_once() -> None:
    price = Price(((0, 4.0),), ((0, 20.0),), ((0, 0.4),), "given", ((0, 5.0),), ((0, 8.0),))
    usage = sp.Usage(prompt=1_000_000, written=300_000, written_1h=100_000)
    assert price.cost(usage) == pytest.approx(0.7 * 4 + 0.2 * 5 + 0.1 * 8)


def test_no_call_costs_more_than_the_most() -> None:
    price = Price(((0, 4.0), (1_000, 8.0)), ((0, 20.0),), ((0, 0.4),), "given", ((0, 5.0), (1_000, 10.0)))
    for_an_hour = replace(price, write_1h=((0, 8.0), (1_000, 16.0)))
    for prompt in (999, 1_000):
        usages = [sp.Usage(prompt=prompt, cached=cached, written=prompt - cached, reply=7) for cached in (0, 500)]
        assert max(map(price.cost, usages)) == pytest.approx(price.most(prompt, 7))
        written = sp.Usage(prompt=prompt, written=prompt, written_1h=prompt, reply=7)
        assert for_an_hour.cost(written) == pytest.approx(for_an_hour.most(prompt, 7))


def test_an_estimate_knows_from_which_length_on_the_models_provider_caches() -> None:
    def cost(player: str, **budget: Any) -> tuple[float, float]:
        """The lowest cost of an episode, and that of the fewest tokens without a cache."""
        price = Price.parse("1,4,0.1,1.25")
        estimate = estimate_cell(cell_config(BANDIT, player=player, budget=sp.Budget(**budget)), [0], price)
        assert estimate.cost is not None
        uncached = sp.Usage(prompt=round(estimate.prompt_tokens.low), reply=round(estimate.reply_tokens.low))
        return estimate.cost.low, price.cost(uncached)

    low, uncached = cost("openai:gpt-5.5", history=2)  # prompts of some 700 tokens are never cached
    assert low == pytest.approx(uncached, rel=0.02)
    low, uncached = cost("openai:gpt-5.5", history=None)
    assert low < 0.5 * uncached
    low, uncached = cost("anthropic:claude-opus-5", history=2)  # a window that slides is written anew at every call
    assert low > uncached
