"""Episodes that a person plays in the browser, one after the other, as a run of their own.

The run is one like others, with the player `human`: its seeds follow from the run's seed, so a person meets the worlds
that `eval` gives to models, its records replay, and `results` and `compare` read its folder. An episode that was left
is continued from its record by the same command.
"""

from __future__ import annotations

import shlex
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from smartplay_tools.conversation.loop import play
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.evaluation.runs.plan import Plan, make_cells, plan_episodes
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import Run, run_plan
from smartplay_tools.evaluation.runs.scheduler import RunProgress
from smartplay_tools.games.specs import get_spec
from smartplay_tools.players import get_player
from smartplay_tools.players.human.browser import PICTURES, BrowserPlayer
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row
from smartplay_tools.records.run_folder import RunFolder
from smartplay_tools.types import Budget

BESIDE = ("rule", "random")
"""The players whose score is shown beside a person's."""

LONGEST_BESIDE = 300
"""Steps of the longest game that they play while a person waits."""


class BrowserPlay:
    """A person's run of one game; `with` plays it in a thread.

    Arguments:
        game: the id of a setting.
        out: the run's folder; one that holds this run already is continued.
        budget: what may be seen and spent in an episode.
        seed: the seed of the run.
        pictures: whether the person may ask for pictures, in games that make some.
        options: the game's own options.
        rules: engine, tokenizer, and the fields of `Rules`.
    """

    def __init__(
        self,
        game: str,
        out: str | Path,
        *,
        budget: Budget | None = None,
        seed: int = 0,
        pictures: bool = False,
        options: Mapping[str, Any] | None = None,
        **rules: Any,
    ) -> None:
        self.game, self.folder, self.player = game, RunFolder(out), BrowserPlayer()
        draws_itself = pictures and PICTURES in get_spec(game).load().metadata["render_modes"]
        own = {"render_mode": PICTURES} if draws_itself else {}
        self._cells = make_cells([game], ["human"], [budget or Budget()], options={**(options or {}), **own}, **rules)
        self._seed = seed
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

    @property
    def games(self) -> tuple[str, ...]:
        """The one game; a `BrowserGames` has more."""
        return (self.game,)

    def run_of(self, game: str) -> BrowserPlay:
        """Return the run of a game."""
        if game != self.game:
            raise InvalidArgumentError(f"{self.game} is played here, and not {game!r}.")
        return self

    @property
    def number(self) -> int:
        """Changes when something else is to be shown."""
        return self.player.number

    def state(self) -> dict[str, Any]:
        """Return what the page shows, as JSON: a prompt, the result of an episode, or why there is none."""
        with self.player.changed:
            asked = self.player.asked
            over = None if self._row is None or asked is not None else self._row
            state = "asking" if asked else "failed" if self._error else "over" if over else "waiting"
            return {"number": self.number, "state": state, "asked": asked, "over": over, "error": self._error}

    def beside(self) -> dict[str, float | None]:
        """Return what `rule` and `random` score in the world of the latest episode, under the same budget and rules.

        None stands for a game that is too long to be played meanwhile.
        """
        row = self._row
        if row is None:
            return {}
        (cell,) = self._cells
        if cell.setting.rollout > LONGEST_BESIDE:
            return dict.fromkeys(BESIDE)
        options = {name: value for name, value in cell.options.items() if name != "render_mode"}
        cell = cell.model_copy(update={"options": options})
        return {name: _played(cell.with_seed(row["seed"]), name) for name in BESIDE}

    def challenge(self) -> str:
        """Return the command that has somebody else play the same worlds under the same budget."""
        (cell,) = self._cells
        words = ["smartplay-tools", "view", "--play", self.game, "--seed", str(self._seed)]
        usual = dict(Budget())
        for name, value in ((name, value) for name, value in cell.budget if value != usual[name]):
            words += [f"--{name.replace('_', '-')}", "none" if value is None else str(value)]
        return shlex.join([*words, "--open"])

    def gone(self) -> tuple[int, int]:
        """Return how many turns the last prompt of the latest episode did not show, of how many before it."""
        row = self._row
        views = [] if row is None else Record.read(self.folder.transcript(row["key"])).views
        return (views[-1]["dropped_turns"], views[-1]["turn"]) if views else (0, 0)

    def next(self) -> None:
        """Begin another episode, once one is over."""
        with self.player.changed:
            self._wants_next = self._row is not None or self._error is not None
            self.player.changed.notify_all()

    def _play(self) -> None:
        while not self.player.has_left:
            try:
                run = run_plan(
                    self._plan,
                    self.folder.path,
                    {"human": self._player},
                    RunOptions(executor="inline", on_progress=self._take_in),
                )
                error = None if run.complete or self.player.has_left else _failure(run)
            except SmartPlayError as problem:
                error = str(problem)
            with self.player.changed:
                self._error = error
                self.player.number += 1
                self.player.changed.wait_for(lambda: self._wants_next or self.player.has_left)
                self._wants_next, self._row, self._error = False, None, None
            self._plan = self._next_plan()

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
        return plan_episodes(self._cells, trials=trials, seed=self._seed)


class BrowserGames:
    """Games to choose from; each has a run of its own, which begins when the game is first chosen.

    Arguments:
        games: the ids of the settings.
        out: the folder of the runs; each is in a folder with the name of its game.
        options: those of `BrowserPlay`, the same for all games.
    """

    def __init__(self, games: Sequence[str], out: str | Path, **options: Any) -> None:
        self.games, self.folder = tuple(games), Path(out)
        if (self.folder / "manifest.json").exists():
            raise InvalidArgumentError(f"{out} holds the run of one game; name another folder for several (--out).")
        self._options = options
        self._runs: dict[str, BrowserPlay] = {}
        self._begun = ExitStack()
        self._lock = threading.Lock()

    def __enter__(self) -> BrowserGames:
        self.folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._begun.close()

    def run_of(self, game: str) -> BrowserPlay:
        """Return the run of a game, which begins now if it has not yet."""
        if game not in self.games:
            raise InvalidArgumentError(f"There is no game {game!r} to play here; /play has the list.")
        with self._lock:
            if game not in self._runs:
                run = BrowserPlay(game, self.folder / game, **self._options)
                self._runs[game] = self._begun.enter_context(run)
            return self._runs[game]


def _played(config: EpisodeConfig, name: str) -> float | None:
    """The normalised score of a player of ours in an episode, or its score where the game has no human score."""
    with Episode.from_config(config) as episode:
        result = play(episode, get_player(name, seed=config.seed), protocol=config.protocol)
    return result.score if result.normalized_score is None else result.normalized_score


def _failure(run: Run) -> str:
    latest = run.failures[-1]
    return f"The episode failed: {latest['error'] or latest['end_reason']}"
