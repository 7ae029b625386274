"""Episodes that a person plays in the browser, one after the other, as their own run.

The run is one like others, with the player `human`: its seeds follow from the run's seed, so a person meets the worlds
that `eval` gives to models, its records replay, and `results` and `compare` read its folder. An episode that was left
is continued from its record by the same command.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from smartplay_tools.conversation.loop import play
from smartplay_tools.episode.config import CellConfig, EpisodeConfig
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.plan import Plan, make_cells, plan_episodes
from smartplay_tools.evaluation.runs.run_options import RunOptions, RunProgress
from smartplay_tools.evaluation.runs.runner import Run, run_plan
from smartplay_tools.games.specs import get_spec
from smartplay_tools.players import get_player
from smartplay_tools.records.accounts import shown_turns
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row
from smartplay_tools.transcript.events import ViewEvent, concerns_summary
from smartplay_tools.types import Budget
from smartplay_tools.web.site.browser_player import PICTURES, BrowserPlayer

RANDOM_EPISODES = 20
BESIDE = ("rule", f"random, mean of {RANDOM_EPISODES}")
"""The players whose scores are shown beside a person's."""

SHOWN_CHARACTERS = 160
"""The most characters that are shown of a turn that has left the window."""

LONGEST_BESIDE = 300
"""Steps of the longest game that they play while a person waits."""


def human_cell(
    game: str,
    *,
    budget: Budget | None = None,
    pictures: bool = False,
    options: Mapping[str, Any] | None = None,
    **rules: Any,
) -> CellConfig:
    """Return what a person plays.

    Arguments:
        game: the id of a setting.
        budget: what may be seen and spent in an episode.
        pictures: whether the person may ask for pictures, in games that make some.
        options: the game's own options.
        rules: engine, tokenizer, and the fields of `Rules`.
    """
    draws_itself = pictures and PICTURES in get_spec(game).load().metadata["render_modes"]
    own = {"render_mode": PICTURES} if draws_itself else {}
    (cell,) = make_cells([game], ["human"], [budget or Budget()], options={**(options or {}), **own}, **rules)
    return cell


class BrowserPlay:
    """A person's run of one game; `with` plays it in a thread.

    Arguments:
        cell: what is played (`human_cell`).
        out: the run's folder; one that holds this run already is continued.
        seed: the seed of the run.
    """

    def __init__(self, cell: CellConfig, out: str | Path, *, seed: int = 0) -> None:
        self.game, self.folder, self.player = cell.game, RunFolder(out), BrowserPlayer()
        self._cell, self._seed = cell, seed
        self._row: Row | None = None
        self._error: str | None = None
        self._wants_next = False
        self._plan = self._next_plan()
        self._thread = threading.Thread(target=self._play, name="play", daemon=True)

    def __enter__(self) -> BrowserPlay:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.player.leave()
        self._thread.join()

    def state(self) -> dict[str, Any]:
        """Return what the page shows, as JSON: a prompt, the result of an episode, or why there is none."""
        with self.player.changed:
            asked = self.player.asked
            over = None if self._row is None or asked is not None else self._row
            state = "asking" if asked else "failed" if self._error else "over" if over else "waiting"
            return {"number": self.player.number, "state": state, "asked": asked, "over": over, "error": self._error}

    def beside(self) -> dict[str, float | None]:
        """Return what `rule` and `random` score in the world of the latest episode, under the same budget and rules.

        The score of `random` is the mean of 20 episodes. None stands for a game that takes too long.
        """
        row, cell = self._row, self._cell
        if row is None:
            return {}
        if cell.setting.rollout > LONGEST_BESIDE:
            return dict.fromkeys(BESIDE)
        options = {name: value for name, value in cell.options.items() if name != "render_mode"}
        cell = cell.model_copy(update={"options": options})
        config = cell.with_seed(row["seed"])
        random = [_played(config, "random", seed) for seed in range(RANDOM_EPISODES)]
        scores = (_played(config, "rule", config.seed), sum(random) / RANDOM_EPISODES)
        return dict(zip(BESIDE, scores, strict=True))

    def gone(self) -> dict[str, Any]:
        """Return how many turns the last prompt of the latest episode did not show as they were, of how many before it.

        `first` is the first of them that left the window: its number, what the game answered in it, and the turn whose
        prompt was the first without it.
        """
        record = None if self._row is None else Record.read(self.folder.transcript(self._row["key"]))
        views = [] if record is None else [view for view in record.views if not concerns_summary(view)]
        if record is None or not views:
            return {"gone": 0, "turns": 0, "first": None}
        first = next((view for view in views if _lost(record, view)), None)
        return {
            "gone": len(_lost(record, views[-1])),
            "turns": views[-1]["turn"],
            "first": None if first is None or record.is_paper else _shown_first(record, first),
        }

    def next(self) -> None:
        """Begin another episode, once one is over."""
        with self.player.changed:
            self._wants_next = self._row is not None or self._error is not None
            self.player.changed.notify_all()

    def _play(self) -> None:
        while not self.player.has_left:
            if self._row is None:
                error = self._play_one()
                with self.player.changed:
                    self._error = error
                    self.player.number += 1
            with self.player.changed:
                self.player.changed.wait_for(lambda: self._wants_next or self.player.has_left)
                self._wants_next, self._row, self._error = False, None, None
            self._plan = self._next_plan()

    def _play_one(self) -> str | None:
        """Play an episode; return what went wrong."""
        try:
            run = run_plan(
                self._plan,
                self.folder.path,
                {"human": self._player},
                RunOptions(executor="inline", on_progress=self._take_in),
            )
        except SmartPlayError as problem:
            return str(problem)
        return None if run.complete or self.player.has_left else _failure(run)

    def _player(self, *, seed: int, **options: Any) -> BrowserPlayer:
        return self.player

    def _take_in(self, progress: RunProgress) -> None:
        if progress.row is not None:
            self._row = progress.row

    def _next_plan(self) -> Plan:
        """The plan of the folder's run, with one more trial if all are finished."""
        trials = 1
        if (self.folder.path / "manifest.json").exists():
            planned = self.folder.manifest().planned
            finished = {row["key"] for row in self.folder.rows()}
            left = any(episode.key not in finished for episode in planned)
            trials = max((episode.trial for episode in planned), default=-1) + (1 if left else 2)
        return plan_episodes([self._cell], trials=trials, seed=self._seed)


class BrowserGames:
    """The games that a person may play in a site; each has its own run, which begins when it is first chosen.

    Arguments:
        games: the settings, by their ids or as `FILE.py:NAME`.
        out: the folder of the run; of several games, that of their runs, each in a folder with the name of its game.
        seed: the seed of the runs.
        options: those of `human_cell`, the same for all games.
    """

    def __init__(self, games: Sequence[str], out: str | Path, *, seed: int = 0, **options: Any) -> None:
        self.games, self.folder = tuple(get_spec(game).id for game in games), Path(out)
        self._seed, self._options = seed, options
        self._runs: dict[str, BrowserPlay] = {}
        self._begun = ExitStack()
        self._lock = threading.Lock()
        if len(self.games) == 1:
            self._made(self.games[0])  # what cannot be played is refused now
        elif self.games and (self.folder / "manifest.json").exists():
            raise InvalidArgumentError(f"{out} holds the run of one game; name another folder for several (--out).")

    def __enter__(self) -> BrowserGames:
        return self

    def __exit__(self, *_: object) -> None:
        self._begun.close()

    def run_of(self, name: str) -> BrowserPlay:
        """Return the run of a game, which begins now if it has not yet."""
        with self._lock:
            if name in self.games and name not in self._runs:
                self._runs[name] = self._begun.enter_context(self._made(name))
            if name not in self._runs:
                raise InvalidArgumentError(f"There is no game {name!r} to play here; /play has the list.")
            return self._runs[name]

    def _made(self, game: str) -> BrowserPlay:
        out = self.folder if len(self.games) == 1 else self.folder / game
        return BrowserPlay(human_cell(game, **self._options), out, seed=self._seed)


def _lost(record: Record, view: ViewEvent) -> list[int]:
    """The turns that a prompt did not show as they were."""
    shown = ["gone"] * view["dropped_turns"] if record.is_paper else shown_turns(record, view)
    return [turn for turn, how in enumerate(shown) if how != "whole"]


def _shown_first(record: Record, view: ViewEvent) -> dict[str, Any]:
    """The first turn that a prompt did not show: its number, what the game answered in it, and the prompt's turn."""
    (turn, *_) = _lost(record, view)
    text = " ".join(" ".join(call["text"] for call in record.calls if call["turn"] == turn).split())
    cut = text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}…"
    return {"turn": turn, "text": cut, "left": view["turn"]}


def _played(config: EpisodeConfig, name: str, seed: int) -> float:
    """The normalised score of a built-in player in an episode, or its score where the game has no human score."""
    with Episode.from_config(config) as episode:
        result = play(episode, get_player(name, seed=seed), protocol=config.protocol)
    return result.score if result.normalized_score is None else result.normalized_score


def _failure(run: Run) -> str:
    latest = run.failures[-1]
    return f"The episode failed: {latest['error'] or latest['end_reason']}"
