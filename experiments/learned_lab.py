"""The training and the play of `experiments/learned.py`: tiny models, made once and kept in a folder."""

from __future__ import annotations

import random
import re
import sys
import time
from pathlib import Path
from statistics import fmean, median
from typing import Any

from learned_cells import (
    PUBLISHED,
    QUICK,
    REGIMES,
    REWARD_SEED,
    TEACH_SEED,
    TEACHERS,
    TOKENIZED,
    Sizes,
    cells,
    episodes_of,
    quick_cells,
)
from learned_tables import Played
from transformers import LlamaForCausalLM, PreTrainedTokenizerFast

import smartplay_tools as sp
from smartplay_tools.evaluation.exports import export
from smartplay_tools.games.seeds import trial_seed

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

import tiny_agent
import torch

PARTS = re.compile(r"(.+)-(\d+)(-rewarded)?")
"""The regime of a model, the seed of its training, and whether it was trained further by reward."""


class Lab:
    """Makes the models of a game and keeps them in a folder."""

    def __init__(self, out: Path, game: str, sizes: Sizes = PUBLISHED) -> None:
        self._out, self._game, self._sizes = out / game, game, sizes

    def rows(self, regime: str) -> list[dict[str, Any]]:
        """The rows of a regime's records, which are played the first time; their order is drawn."""
        data = self._out / "data" / regime
        if not data.exists():
            asked = REGIMES[regime]
            run = self._out / "teacher" / regime
            trials = self._sizes.episodes // len(asked.budgets)
            sp.evaluate(
                [self._game],
                [asked.teacher],
                budgets=asked.budgets,
                trials=trials,
                seed=TEACH_SEED,
                out=run,
                executor="inline",
            )
            made = export(run, data, "sft-chains", summaries=True)
            print(regime, made.counts, flush=True)
        rows = tiny_agent.read_rows(data)
        random.Random(0).shuffle(rows)
        return rows

    def tokenizer(self) -> PreTrainedTokenizerFast:
        """The one tokenizer of all models of the game, made from some rows of its regimes."""
        folder = self._out / "tokenizer"
        if not folder.exists():
            rows = [row for regime in TOKENIZED[self._game] for row in self.rows(regime)[:400]]
            tiny_agent.make_tokenizer(rows).save_pretrained(folder)
        made: PreTrainedTokenizerFast = PreTrainedTokenizerFast.from_pretrained(folder)
        return made

    def model(self, name: str) -> LlamaForCausalLM:
        """The model of a name, which is trained the first time; its folder has the tokenizer, too."""
        folder = self._out / "models" / name
        if not folder.exists():
            began = time.process_time()
            regime, number, rewarded = PARTS.fullmatch(name).groups()
            if rewarded:
                model = self.model(f"{regime}-{number}")
                self._reward(model, REGIMES[regime].rewarded)
            else:
                tokenizer = self.tokenizer()
                samples = [tiny_agent.encode(tokenizer, row) for row in self.rows(regime)]
                model = tiny_agent.new_model(tokenizer, seed=int(number))
                loss = tiny_agent.train(model, samples, self._sizes.tokens, seed=int(number))
                print(f"{name}: {len(samples)} rows, loss {loss:.4f}", flush=True)
            print(f"{name}: {time.process_time() - began:.0f} s of processor time", flush=True)
            self.tokenizer().save_pretrained(folder)
            model.save_pretrained(folder)
        made: LlamaForCausalLM = LlamaForCausalLM.from_pretrained(folder)
        return made

    def _reward(self, model: LlamaForCausalLM, budget: sp.Budget) -> None:
        def world(number: int) -> list[sp.Episode]:
            seed = trial_seed(REWARD_SEED, self._game, number)
            return [sp.Episode(self._game, seed=seed, budget=budget) for _ in range(6)]

        groups = ([world(4 * update + at) for at in range(4)] for update in range(self._sizes.updates))
        for update, score in enumerate(tiny_agent.reinforce(model, self.tokenizer(), groups)):
            print(f"update {update}: {score:.2f}", flush=True)


def play(out: Path, *, quick: bool = False) -> None:
    """Train and play what is missing."""
    torch.set_num_threads(1)
    (out / "records").mkdir(parents=True, exist_ok=True)
    played, sizes = Played(out / "episodes.csv"), QUICK if quick else PUBLISHED
    for cell in quick_cells() if quick else cells():
        if cell in played.rows:
            continue
        episodes = episodes_of(cell, out / "records", sizes.worlds)
        lab = Lab(out, cell.game, sizes)
        began = time.process_time()
        if teacher := TEACHERS.get(cell.player):
            for trial, episode in enumerate(episodes):
                sp.play(episode, sp.get_player(teacher.name, seed=trial, **teacher.options))
        else:
            tiny_agent.play(lab.model(cell.player), lab.tokenizer(), episodes, name=cell.player)
        played.add(cell, episodes)
        scores = [row["score"] for row in played.rows[cell]]
        seconds = time.process_time() - began
        print(cell, f"{fmean(scores):.2f}, median {median(scores):g}, {seconds:.0f} s of processor time", flush=True)
