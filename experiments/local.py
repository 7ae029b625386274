"""A real model of 135 million parameters, as it is and fine-tuned on a teacher's records: the rows of `docs/local.md`.

    smartplay-tools model get
    python experiments/local.py tune --out runs/local    # extra `train`, with accelerate and gguf; goes on if stopped
    python experiments/local.py play --out runs/local    # extra `local`; both models and two scripts, a row an episode
    python experiments/local.py syntax                   # what the grammar is worth: its prompts without it
    python experiments/tables.py local                   # the tables of the page, from the published rows

`tune` lets `rule` play worlds that nobody is evaluated on, exports the records as `sft-chains`, and trains the last
layers of SmolLM2 on the replies, in exactly the text that `--player local` sends (`local_tune.py`). A file of the same
format is written, so that both models are played by the same engine. `tune --source FILE.gguf` trains a model of your
own, `play --player local:FILE.gguf` plays any.
"""

from __future__ import annotations

import json
import random
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from page_tables import HERE, Experiment, arguments, markdown_table, mean_score
from smartplay_local.model_files import find_model

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.names import strategy_name
from smartplay_tools.evaluation.exports import export
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.records.rows import Row, read_rows
from smartplay_tools.types import MISTAKES

GAMES = ("RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0")
CAPS = (700, 1_000, 1_500)
MODEL, TUNED = "smollm2-135m", "smollm2-135m-taught.gguf"
WAYS: tuple[Mapping[str, Any], ...] = (
    {"beyond_history": "mask", "history": 2},
    {"notes_tokens": 60},
    {"summary_tokens": 60},
    {"recall_tokens": 100},
)
"""What is played under the smallest cap beside dropping, as fields of a budget."""
SCRIPTS = ("random", "rule")
"""What the model's scores are read against."""
TEACHING_SEED, SEED = 1, 0
"""The worlds of teaching and of playing are different ones."""
LAYERS = 4
"""How many of the 30 layers are trained, the last ones."""
REPLIES = 8
"""Rows with fewer replies are mostly head, and are left out of training."""
PUBLISHED = HERE / "local"


def budgets() -> list[sp.Budget]:
    """The three caps; half of a full window is dropped at once, so that the engine keeps what it has read."""
    return [sp.Budget(prompt_tokens=cap, slack=0.5) for cap in CAPS]


def teach(out: Path, worlds: int) -> list[dict[str, Any]]:
    """Let `rule` play, and return the rows of its records, shuffled."""
    data = out / "data"
    if not data.exists():
        sp.evaluate(
            GAMES, ["rule"], budgets=budgets(), trials=worlds, seed=TEACHING_SEED, out=out / "taught", executor="inline"
        )
        export(out / "taught", data, "sft-chains")
    rows = [json.loads(line) for line in (data / "data.jsonl").read_text(encoding="utf-8").splitlines()]
    random.Random(0).shuffle(rows)
    return rows


def tune(out: Path, *, source: str, worlds: int, rows: int, tokens: int, rate: float) -> None:
    """Train the last layers until `tokens` tokens were read; a training that was stopped goes on."""
    import torch
    from local_tune import Training

    torch.set_num_threads(1)
    dense = [row for row in teach(out, worlds) if row["replies"] >= REPLIES]
    chosen = [row for game in GAMES for row in [row for row in dense if row["game"] == game][: rows // len(GAMES)]]
    Training(find_model(source), out / TUNED, chosen, LAYERS).run(tokens, rate)


def play(out: Path, *, players: Sequence[str], trials: int) -> None:
    """Play one world of every cell after the other; what was played is not played again."""
    smallest = budgets()[0]
    ways = [smallest.model_copy(update=way) for way in WAYS]
    for player in players:
        options = {"threads": 1} if player.startswith("local:") else {}
        for worlds in range(1, trials + 1):
            sp.evaluate(
                GAMES,
                [PlayerConfig(name=player, options=options)],
                budgets=[*budgets(), *ways],
                trials=worlds,
                seed=SEED,
                out=out / Path(player.removeprefix("local:")).stem,
                executor="inline",
            )


def syntax() -> None:
    """Ask the prompts of the model's published records again without the grammar, and count the calls in the replies.

    A call is one JSON object and nothing else, as the prompt asks, which names one of the tools.
    """
    from smartplay_local import LocalPlayer, LocalServer
    from smartplay_local.text import call_in

    player, server = LocalPlayer(MODEL), LocalServer(find_model(MODEL))
    for record in sorted((PUBLISHED / MODEL / "records").glob("*.jsonl")):
        replies = []
        for sent in sent_prompts(sp.read_transcript(record)):
            body = {**player.request(sent.prompt), "max_tokens": 100}
            del body["grammar"]
            text = server.ask("/v1/chat/completions", body)["choices"][0]["message"]["content"]
            call = call_in(text)
            replies.append(call is not None and call["name"] in {tool.name for tool in sent.prompt.tools})
            print(repr(text))
        print(f"{record.stem}: {sum(replies)} of {len(replies)} replies are calls", flush=True)


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the two tables of the page in Markdown: scores under every budget, and what became of the calls."""
    cells: dict[tuple[str, str], dict[str, list[Row]]] = {}
    for cell, members in by_cell(rows):
        way = strategy_name(cell)
        budget = f"{cell.budget['prompt_tokens']:,}" if way == "dropping" else way
        line = cells.setdefault((cell.player.removeprefix("local:").removesuffix(".gguf"), cell.game), {})
        line[budget] = list(members)
    heads = list(dict.fromkeys(budget for line in cells.values() for budget in line))
    scores: tuple[list[str], list[list[str]]] = (["player", "game", *heads], [])
    calls: tuple[list[str], list[list[str]]] = (["player", "game", "episodes", "steps", *WRONG, "ended as"], [])
    for about, line in cells.items():
        names = [about[0], about[1].partition("-")[0]]
        scores[1].append(names + [_score(line.get(head, [])) for head in heads])
        every = [row for members in line.values() for row in members]
        sums = [str(sum(row[name] for row in every)) for name in ("steps", *WRONG.values())]
        calls[1].append([*names, str(len(every)), *sums, ", ".join(sorted({row["end_reason"] for row in every}))])
    return {"local": markdown_table(*scores), "local-calls": markdown_table(*calls)}


WRONG = {"calls": "tool_calls", "illegal": MISTAKES[0], "malformed": MISTAKES[1]}
"""Columns of the table that count, and their fields of a row."""


def _score(rows: Sequence[Row]) -> str:
    """The mean score with its interval, and of how many worlds."""
    if not rows:
        return "not played"
    estimate = mean_score(rows)
    bounds = "" if estimate.low is None or estimate.high is None else f" [{estimate.low:.1f}, {estimate.high:.1f}]"
    return f"{estimate.mean:.1f}{bounds} ({len(rows)})"


def published() -> list[Row]:
    """Return the rows of the published runs."""
    return [row for path in sorted(PUBLISHED.glob("*/results.jsonl")) for row in read_rows(path)]


EXPERIMENT = Experiment("local", tables, read=published)


def main() -> None:
    """Tune, play, or ask without a grammar."""
    parser = arguments(__doc__, "runs/local", publishes=False)
    parser.add_argument("what", choices=("tune", "play", "syntax"))
    parser.add_argument("--source", default=MODEL, help="train this: a name, or a GGUF file of a Llama with ChatML")
    parser.add_argument("--worlds", type=int, default=20, help="worlds of each game and cap that the teacher plays")
    parser.add_argument("--rows", type=int, default=100, help="rows that are trained on, of different worlds")
    parser.add_argument("--tokens", type=int, default=240_000, help="tokens that are read in training")
    parser.add_argument("--rate", type=float, default=5e-4, help="the learning rate")
    parser.add_argument("--player", action="append", help="play with this player alone, such as local:FILE.gguf")
    parser.add_argument("--trials", type=int, default=5, help="worlds of each game that are played")
    asked = parser.parse_args()
    if asked.what == "syntax":
        syntax()
    if asked.what == "play":
        players = asked.player or (*SCRIPTS, f"local:{MODEL}", f"local:{asked.out / TUNED}")
        play(asked.out, players=players, trials=asked.trials)
    if asked.what == "tune":
        tune(asked.out, source=asked.source, worlds=asked.worlds, rows=asked.rows, tokens=asked.tokens, rate=asked.rate)


if __name__ == "__main__":
    main()
