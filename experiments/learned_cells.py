"""Who plays in `experiments/learned.py`, under what, and what the models among them are trained on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from learned_swapped import SWAPPED

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.games.seeds import trial_seed

GAME, BANDIT = "RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0"
CAPS = (600, 800, 1_200, None)
SMALL = 700
SEEDS = range(3)
"""The seeds of training: the weights at the beginning, and the order of the rows."""
PLAY_SEED, TEACH_SEED, REWARD_SEED = 0, 1, 2
"""The worlds of play, of the teacher's records and of the training by reward."""


@dataclass(frozen=True)
class Sizes:
    """How large the experiment is: as it was published, or `QUICK`."""

    episodes: int = 240
    """Episodes of the teacher for each kind of window."""
    tokens: int = 3_000_000
    """Tokens that a model reads in training, in its own tokenizer, whatever its windows are."""
    worlds: int = 40
    """Worlds that every cell plays."""
    updates: int = 30
    """Updates by reward."""


PUBLISHED = Sizes()
QUICK = Sizes(episodes=4, tokens=20_000, worlds=1, updates=1)
"""What shows that everything works, in a minute, and teaches nothing."""

WAYS: Mapping[str, Mapping[str, Any]] = {
    "drop": {},
    "mask": {"beyond_history": "mask", "history": 2},
    "recall": {"recall_tokens": 100},
    "notes": {"notes_tokens": 60},
    "summary": {"summary_tokens": 60, "slack": 0.5},
}
"""What happens to what no longer fits, as fields of a budget."""


@dataclass(frozen=True)
class Cell:
    """Who plays, and under what."""

    player: str
    """A scripted player; or a model: its regime and the seed of its training, such as `small-1`.

    `small-1-rewarded` was trained further by reward.
    """
    cap: int | None
    way: str = "drop"
    manual: Literal["tool", "none", "swapped"] = "tool"
    """The tool `read_manual` shows the game's manual, or nothing, or another game's."""
    game: str = GAME


@dataclass(frozen=True)
class Regime:
    """What a model is trained on: the windows of a teacher, and one of them in which it is trained by reward."""

    budgets: Sequence[sp.Budget]
    teacher: PlayerConfig
    rewarded: sp.Budget


def _budget(cap: int | None, way: str = "drop") -> sp.Budget:
    return sp.Budget(prompt_tokens=cap, **WAYS[way])


TEACHERS: Mapping[str, PlayerConfig] = {
    "random": PlayerConfig(name="random"),
    "rule": PlayerConfig(name="rule"),
    "count-last-5": PlayerConfig(name="count-last-5"),
    "leave-after-two": PlayerConfig(name="leave-after-two"),
    "rule-notes": PlayerConfig(name="rule-notes", options={"words": False}),
    "digits": PlayerConfig(
        name=f"{Path(__file__).parent / 'learned_teacher.py'}:DigitsPlayer", options={"words": False}
    ),
}
"""The scripted players."""
LINES = {GAME: "count-last-5", BANDIT: "leave-after-two"}
"""The baseline of one line that scores most at a game."""
RULE, NOTES, DIGITS = TEACHERS["rule"], TEACHERS["rule-notes"], TEACHERS["digits"]
REGIMES: Mapping[str, Regime] = {
    "small": Regime([_budget(SMALL)], RULE, _budget(CAPS[0])),
    "all": Regime([_budget(cap) for cap in CAPS], RULE, _budget(CAPS[0])),
    "full": Regime([_budget(None)], RULE, _budget(CAPS[0])),
    "notes": Regime([_budget(SMALL, "notes")], NOTES, _budget(SMALL, "notes")),
    "summary": Regime([_budget(SMALL, "summary")], NOTES, _budget(SMALL, "summary")),
    "digits-notes": Regime([_budget(SMALL, "notes")], DIGITS, _budget(SMALL, "notes")),
    "digits-summary": Regime([_budget(SMALL, "summary")], DIGITS, _budget(SMALL, "summary")),
}
TOKENIZED: Mapping[str, Sequence[str]] = {
    GAME: ("small", "all", "full", "notes", "summary"),
    BANDIT: ("small", "full"),
}
"""The regimes of whose rows the one tokenizer of a game's models is made."""


def cells() -> Iterator[Cell]:
    """All cells, in the order in which they are played: what matters most comes first."""
    for player in ("rule", "random"):
        yield from (Cell(player, cap, game=game) for game in (GAME, BANDIT) for cap in CAPS)
    yield from (Cell(player, cap, game=game) for game, player in LINES.items() for cap in CAPS)
    for player in ("rule", "rule-notes", "digits"):
        yield from (Cell(player, SMALL, way) for way in WAYS)
    models = [f"{regime}-{seed}" for regime in ("full", "small", "all") for seed in SEEDS]
    for player in (*models, *(f"full-{seed}-rewarded" for seed in SEEDS)):
        yield from (Cell(player, cap) for cap in CAPS)
    for player in ("rule", *(f"{regime}-{seed}" for regime in ("full", "small") for seed in SEEDS)):
        yield from (Cell(player, cap, manual=manual) for manual in ("none", "swapped") for cap in (CAPS[0], None))
    for player in ("small-0", "full-0", "small-1", "full-1"):
        yield from (Cell(player, cap, game=BANDIT) for cap in CAPS)
    for player in ("digits-notes-0", "small-1", "full-0", "notes-0", "summary-0", "digits-summary-0"):
        yield from (Cell(player, SMALL, way) for way in WAYS)
    for player in ("digits-notes-1", "digits-notes-2"):
        yield from (Cell(player, SMALL, way) for way in ("drop", "notes"))
    yield from (Cell("digits-notes-0-rewarded", SMALL, way) for way in WAYS)
    for player in ("small-2", "full-2"):
        yield from (Cell(player, cap, game=BANDIT) for cap in CAPS)
    for player in (f"small-{seed}-rewarded" for seed in SEEDS):
        yield from (Cell(player, cap) for cap in CAPS)


def quick_cells() -> Iterator[Cell]:
    """A cell of each kind."""
    yield from (Cell("rule", CAPS[0]), Cell("small-0", CAPS[0]), Cell("small-0-rewarded", CAPS[0]))
    yield from (Cell("notes-0", SMALL, "notes"), Cell("full-0", None, manual="swapped"))


def episodes_of(cell: Cell, folder: Path | None, worlds: int) -> list[sp.Episode]:
    """The episodes of a cell; the first is recorded."""
    names = [cell.player, str(cell.cap or "none"), cell.way]
    names += [f"manual-{cell.manual}"] * (cell.manual != "tool") + ["bandit"] * (cell.game == BANDIT)
    record = None if folder is None else folder / f"{'.'.join(names)}.jsonl"
    if record is not None:
        record.unlink(missing_ok=True)
    return [
        sp.Episode(
            SWAPPED if cell.manual == "swapped" else cell.game,
            seed=trial_seed(PLAY_SEED, cell.game, trial),
            budget=_budget(cell.cap, cell.way),
            manual="none" if cell.manual == "none" else "tool",
            transcript=None if trial else record,
        )
        for trial in range(worlds)
    ]
