"""The settings of the benchmark, as data.

No game is imported: a setting names its class as a string, and the class is loaded when an episode asks for it.
`GAMES` also has the settings of other packages and programs (`smartplay_tools.games.game_registry`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from smartplay_tools.errors import InvalidArgumentError, name_of
from smartplay_tools.games.game_registry import Games, GameSpec, Pack
from smartplay_tools.games.paper_tables import CAPABILITIES, HUMAN_SCORES, MIN_SCORES
from smartplay_tools.registry import InFile, NamedInFiles, is_in_file, without_folders

if TYPE_CHECKING:
    from pathlib import Path


def _challenges(*degrees: int) -> Mapping[str, int]:
    return MappingProxyType(dict(zip(CAPABILITIES, degrees, strict=True)))


# The degree of each capability is that of the paper's table 3; docs/metrics.md has the scale. MESSENGER level 1 is not
# in that table, so its degrees come from the file evaluation.yml of the original code.
_BANDIT = _challenges(1, 1, 1, 1, 2, 3, 2, 1, 1)
_ROCK_PAPER_SCISSORS = _challenges(2, 1, 3, 1, 2, 3, 3, 1, 1)
_HANOI = _challenges(2, 3, 2, 3, 1, 1, 1, 2, 1)
_MESSENGER_L1 = _challenges(3, 1, 2, 1, 2, 2, 1, 1, 2)
_MESSENGER = _challenges(3, 2, 2, 2, 2, 2, 1, 1, 2)
_CRAFTER = _challenges(4, 3, 3, 3, 3, 2, 4, 3, 2)
_MINECRAFT = _challenges(1, 1, 2, 1, 3, 2, 1, 2, 3)

_GAMES = "smartplay_tools.games"
_FAMILIES: Mapping[str, Mapping[str, Any]] = {
    "bandit": {"entry_point": f"{_GAMES}.bandit:Bandit", "action_count": 2, "worst_step": 0, "best_step": 1},
    "rock_paper_scissors": {
        "entry_point": f"{_GAMES}.rock_paper_scissors:RockPaperScissors",
        "action_count": 3,
        "worst_step": 0,
        "best_step": 1,
    },
    "hanoi": {"entry_point": f"{_GAMES}.hanoi:Hanoi", "action_count": 6},
    "messenger": {"entry_point": f"{_GAMES}.messenger.game:Messenger", "action_count": 5},
    "crafter": {
        "entry_point": f"{_GAMES}.crafter.game:Crafter",
        "action_count": 17,
        "worst_step": 0,
    },
    "minecraft": {"entry_point": f"{_GAMES}.minecraft.game:Minecraft", "action_count": 4, "two_valued": True},
}
"""What the settings of a game have in common."""

# fmt: off
_SETTINGS: tuple[
    tuple[str, str, Mapping[str, Any], int, int, int, tuple[float, float] | None, Mapping[str, int]], ...
] = (
    # family, id, arguments, history, rollout, trials, score bounds, challenges
    ("bandit", "BanditTwoArmedDeterministicFixed-v0", {"arms": ((1.0, 1), (0.0, 1))}, 50, 50, 20, (0, 50), _BANDIT),
    ("bandit", "BanditTwoArmedHighHighFixed-v0", {"arms": ((0.8, 1), (0.9, 1))}, 50, 50, 20, (0, 50), _BANDIT),
    ("bandit", "BanditTwoArmedHighLowFixed-v0", {"arms": ((0.8, 1), (0.2, 1))}, 50, 50, 20, (0, 50), _BANDIT),
    ("bandit", "BanditTwoArmedLowLowFixed-v0", {"arms": ((0.1, 1), (0.2, 1))}, 50, 50, 20, (0, 50), _BANDIT),
    ("rock_paper_scissors", "RockPaperScissorBasic-v0",
     {"probabilities": (0.2, 0.2, 0.6), "scores": (1, 1, 1)}, 50, 50, 20, (0, 50), _ROCK_PAPER_SCISSORS),
    ("rock_paper_scissors", "RockPaperScissorDifferentScore-v0",
     {"probabilities": (0.3, 0.3, 0.4), "scores": (1, 2, 1)}, 50, 50, 20, (0, 50), _ROCK_PAPER_SCISSORS),
    ("hanoi", "Hanoi3Disk-v0", {"disks": 3}, 30, 30, 10, (0, 3), _HANOI),
    ("hanoi", "Hanoi4Disk-v0", {"disks": 4}, 30, 30, 10, (0, 4), _HANOI),
    ("messenger", "MessengerL1-v0", {"level": 1}, 2, 4, 100, (-1, 1), _MESSENGER_L1),
    ("messenger", "MessengerL2-v0", {"level": 2}, 2, 64, 100, (-1, 1), _MESSENGER),
    # At level 3 the enemy and both decoys can touch the avatar at once.
    ("messenger", "MessengerL3-v0", {"level": 3}, 2, 128, 100, (-3, 1), _MESSENGER),
    ("crafter", "Crafter-v0", {}, 5, 10_000, 10, None, _CRAFTER),
    *(("minecraft", f"MinedojoCreative{task}-v0", {"task": task}, 2, 200, 20, (0, 1), _MINECRAFT)
      for task in (0, 1, 2, 4, 5, 7, 8, 9)),
)
# fmt: on


def _points_of_step(scores: Sequence[float] = (), arms: Sequence[tuple[float, float]] = (), **_: Any) -> Any:
    """What a step of the bandit or of Rock Paper Scissors pays: as much as an amount of the setting, won or lost."""
    amounts = [*scores, *(amount for _, amount in arms)]
    return (-max(amounts), max(amounts)) if amounts else None


GAMES = Games(
    GameSpec(
        family=family,
        id=id,
        kwargs=kwargs,
        history=history,
        rollout=rollout,
        trials=trials,
        score_bounds=score_bounds,
        challenges=challenges,
        human_score=HUMAN_SCORES.get(id),
        min_score=MIN_SCORES.get(id),
        points_of_step=_points_of_step(**kwargs),
        **_FAMILIES[family],
    )
    for family, id, kwargs, history, rollout, trials, score_bounds, challenges in _SETTINGS  # noqa: A001 - its name
)
"""Every setting that can be played, by id: the benchmark's, then those that were registered or installed."""


def lockers_setting(
    name: str,
    *,
    facts: int = 6,
    distractors: int = 0,
    distance: int = 0,
    updates: int = 0,
    order: Literal["free", "told", "reversed"] = "free",
) -> GameSpec:
    """Return a setting of the game `smartplay_tools.games.lockers` with these dials, which `Lockers` explains."""
    dials = {"facts": facts, "distractors": distractors, "distance": distance, "updates": updates, "order": order}
    rollout = 2 * facts + distractors + distance + updates
    return GameSpec(
        id=name,
        family="lockers",
        entry_point=f"{_GAMES}.lockers:Lockers",
        kwargs=dials,
        history=rollout,
        rollout=rollout,
        trials=20,
        memory="all",
        action_count=9,
        score_bounds=(0, facts),
        worst_step=0,
        best_step=1,
        points_of_step=(0, 1),
    )


LOCKERS = Pack(
    None,
    (),
    (
        lockers_setting("Lockers4-v0", facts=4),
        lockers_setting("Lockers6-v0"),
        lockers_setting("Lockers8-v0", facts=8),
        lockers_setting("Lockers12-v0", facts=12),
        lockers_setting("Lockers6Distractors12-v0", distractors=12),
        lockers_setting("Lockers6Distance12-v0", distance=12),
        lockers_setting("Lockers6Updates6-v0", updates=6),
        lockers_setting("Lockers12Told-v0", facts=12, order="told"),
    ),
)
"""A game of memory of this package's own, which is no part of the benchmark."""


IN_FILES = NamedInFiles("game", "setting", lambda held: isinstance(held, GameSpec))
"""The settings in files that the user has named in this process."""


def get_spec(game: str | GameSpec) -> GameSpec:
    """Return the setting of that id, or the one that `FILE.py:NAME` names.

    An unknown id raises `UnknownNameError`, which lists similar ids.
    """
    if not isinstance(game, str):
        return _checked(game)
    return load_game(game) if is_in_file(game) else GAMES[game]


def load_game(name: str, digest: str | None = None, path: Path | None = None) -> GameSpec:
    """Import and register a setting that the user has named as `FILE.py:NAME`; see `NamedInFiles.load`."""
    found = IN_FILES.load(name, digest, path)
    return GAMES.register(_in_file(name, found))


def recorded_game(name: str, digest: str | None) -> GameSpec:
    """Return the setting in a file that a record names, without importing the file for it."""
    return _in_file(name, IN_FILES.recorded(name, digest))


def _in_file(name: str, found: InFile) -> GameSpec:
    spec: GameSpec = replace(found.value, file=without_folders(name), sha256=found.sha256)
    return spec


def _checked(spec: object) -> GameSpec:
    if not isinstance(spec, GameSpec):
        raise InvalidArgumentError(f"{name_of(spec)} is not a setting; give a GameSpec, or an id: Hanoi3Disk-v0.")
    return spec


def register(spec: GameSpec) -> GameSpec:
    """Register a setting of your own by its id, here and in Gymnasium, for this process; return it.

    A package that declares it as an entry point makes it available in every process: see
    `smartplay_tools.games.game_registry`.
    """
    return GAMES.register(_checked(spec))
