"""The example that trains an agent: it learns from a teacher's rows, plays in batches, and is trained by reward."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.exports import export
from tests.processes import printed_by

torch = pytest.importorskip("torch", reason="`.ci/framework train` has an environment with it")
pytest.importorskip("transformers", reason="`.ci/framework train` has an environment with it")

EXAMPLES = Path(__file__).parents[1] / "examples"
GAME = "RockPaperScissorBasic-v0"
BUDGET = sp.Budget(prompt_tokens=700, slack=0.5)


@pytest.fixture(scope="module", autouse=True)
def on_one_thread():
    """Two runs add in the same order only on as many threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def tiny_agent():
    sys.path.insert(0, str(EXAMPLES))
    import tiny_agent

    yield tiny_agent
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def rows(tiny_agent, tmp_path_factory):
    folder = tmp_path_factory.mktemp("teacher")
    sp.evaluate([GAME], ["rule"], budgets=[BUDGET], trials=6, seed=1, out=folder / "run", executor="inline")
    export(folder / "run", folder / "data", "sft-chains")
    return tiny_agent.read_rows(folder / "data")


@pytest.fixture(scope="module")
def tokenizer(tiny_agent, rows):
    return tiny_agent.make_tokenizer(rows)


@pytest.fixture(scope="module")
def taught(tiny_agent, rows, tokenizer):
    """A model that has learned to call tools, and not much of the game."""
    model = tiny_agent.new_model(tokenizer, seed=0, width=32)
    samples = [tiny_agent.encode(tokenizer, row) for row in rows]
    loss = tiny_agent.train(model, samples, tokens=150_000, at_once=1024)
    assert loss < 0.5
    return model


def episodes(seeds, **budget):
    return [sp.Episode(GAME, seed=seed, budget=BUDGET.model_copy(update=budget), transcript=[]) for seed in seeds]


def test_exactly_the_replies_of_a_row_are_trained(tiny_agent, rows, tokenizer):
    row = next(row for row in rows if any(message["role"] == "assistant" for message in row["prompt"]))
    ids, trained = tiny_agent.encode(tokenizer, row)
    text = tokenizer.decode([token for token, is_trained in zip(ids, trained, strict=True) if is_trained])
    replies = [message for message in row["completion"] if message["role"] == "assistant"]
    read = [tiny_agent.message_of(f"{reply}<end>") for reply in text.split("<end>")[:-1]]
    assert [message["tool_calls"][0]["function"] for message in read] == [
        {name: reply["tool_calls"][0]["function"][name] for name in ("name", "arguments")} for reply in replies
    ]


def test_a_row_is_what_the_model_is_asked(tiny_agent, rows, tokenizer):
    ids, _ = tiny_agent.encode(tokenizer, {**rows[0], "completion": []})
    asked = tiny_agent.prompt_tokens(tokenizer, rows[0]["prompt"])
    assert asked[:-1] == ids
    whole = {"tokenize": True, "return_dict": False, "add_generation_prompt": True}
    assert asked == tokenizer.apply_chat_template(rows[0]["prompt"], **whole)


def test_a_model_plays_in_a_batch_what_it_plays_alone_and_its_records_replay(tiny_agent, tokenizer, taught):
    together, alone = episodes(range(3)), episodes(range(3))
    turns = tiny_agent.play(taught, tokenizer, together)
    for episode in alone:
        tiny_agent.play(taught, tokenizer, [episode])
    assert [each.result for each in together] == [each.result for each in alone]
    assert [each.result.turns for each in together] == [len(own) for own in turns]
    assert all(each.result.steps == 50 for each in together)


def test_a_reply_that_is_no_call_is_words(tiny_agent):
    assert tiny_agent.message_of("<tool_call>{half</tool_call>Hello<end>") == {"role": "assistant", "content": "Hello"}
    assert tiny_agent.message_of("<end>") == {"role": "assistant", "content": None}


def test_training_by_reward_changes_the_model_and_is_the_same_again(tiny_agent, tokenizer, taught):
    def rewarded():
        model = type(taught)(taught.config)
        model.load_state_dict(taught.state_dict())
        # Of different worlds, so that scores differ even where a model always does the same.
        groups = [[episodes(range(100, 106))]]
        return list(tiny_agent.reinforce(model, tokenizer, groups)), model.lm_head.weight.detach()

    (scores, weights), (scores_again, weights_again) = rewarded(), rewarded()
    assert scores == scores_again
    assert torch.equal(weights, weights_again)
    assert not torch.equal(weights, taught.lm_head.weight)


def test_the_example_runs(tmp_path):
    command = [sys.executable, "-W", "error", str(EXAMPLES / "20_train_a_tiny_agent.py"), "--quick"]
    shown = printed_by(*command, cwd=tmp_path, env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert "rewarded, no cap" in shown


def test_the_experiment_runs_and_its_records_replay(tmp_path):
    """A few cells of each kind: a script, a model, one trained by reward, one that may take notes, a swapped manual."""
    command = [sys.executable, "-W", "error", str(EXAMPLES.parent / "experiments" / "learned.py"), "--quick"]
    where = ["--out", str(tmp_path)]
    for _ in range(2):  # the second time everything is there
        printed_by(*command, *where)
    rows = (tmp_path / "episodes.csv").read_text(encoding="utf-8").splitlines()[1:]
    records = {path.stem: path for path in (tmp_path / "records").glob("*.jsonl")}
    assert len(rows) == len(records) == 5
    swapped = records.pop("full-0.none.drop.manual-swapped")
    assert sp.read_transcript(swapped)[0]["config"]["game"] not in sp.GAMES
    assert all(sp.replay(record).identical for record in records.values())


def test_an_adapter_is_trained_and_saved_for_llama_cpp(tmp_path):
    """What experiments/local_training.py does to the model of the extra `local`, in one step."""
    pytest.importorskip("gguf", reason="`.ci/framework train` has an environment with it")

    def run(*arguments):
        printed_by(sys.executable, *arguments)

    training = EXAMPLES.parent / "experiments" / "local_training.py"
    run(training, "teach", "--worlds", 1, "--out", tmp_path)
    run(training, "tune", "--tokens", 1, "--rewritten", 0.5, "--out", tmp_path)
    adapter = ("--player-option", f"adapter={tmp_path / 'adapter.gguf'}")
    run("-m", "smartplay_tools", "play", GAME, "--player", "local:smollm2-135m", *adapter, "--tool-calls", 1)
