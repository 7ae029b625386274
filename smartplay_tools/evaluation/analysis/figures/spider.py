"""The spider chart of the nine capabilities: several players beside the paper's models and the human.

All are scored on the same settings: those of the paper for which every player has a normalised score. The paper's
models are in a separate panel, because nine shapes in one chart would be unreadable.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.capabilities import Weights, capability_scores
from smartplay_tools.evaluation.analysis.figures.style import GREY, Series, figure, sample_note
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate
from smartplay_tools.games.paper import CAPABILITIES, PAPER_RESULTS, PAPER_SETTINGS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Scores = Mapping[str, Sequence[float | None]]
"""Normalised scores of a player's episodes, by game."""

RIM = 1.5
"""The largest score on a chart; higher scores are drawn at the rim, and the legend states their value."""


@figure
def capability_spider(players: Mapping[str, Scores], *, weights: Weights = "paper") -> Figure:
    """Draw capability scores (1 is the human's) of players, beside those of the paper's models on the same settings."""
    settings = _common_settings(players)
    profiles = {name: _profile({game: scores[game] for game in settings}, weights) for name, scores in players.items()}
    paper = {
        result.player: _profile({game: [result.normalized[game]] for game in settings}, weights)
        for result in PAPER_RESULTS
    }
    human = paper.pop("human")
    top = min(RIM, max(1.0, *(found.high or found.mean for p in (*profiles.values(), *paper.values()) for found in p)))
    drawn, webs = _two_webs()
    drawn.suptitle(
        f"Capability scores over {len(settings)} of the paper's {len(PAPER_SETTINGS)} settings; 1 is the human's\n"
        + sample_note([sum(len(scores[game]) for game in settings) for scores in players.values()]),
        fontsize=10,
    )
    for web, title, shapes in zip(webs, ("These players", "The paper's models"), (profiles, paper), strict=True):
        axes = web.add_subplot(projection="polar")
        _prepare(axes, top)
        web.suptitle(title, fontsize=11, fontweight="bold")
        _draw(axes, human, top, Series(GREY, "", (0, (1, 2))), "human (paper)")
        for index, (name, profile) in enumerate(shapes.items()):
            _draw(axes, profile, top, Series.number(index), name)
        # Each web has its own series, so each has its own legend.
        web.legend(loc="outside lower center", ncols=3 if len(shapes) > 3 else 2, handlelength=2.8, fontsize=9)
    return drawn


def _two_webs() -> tuple[Figure, Sequence[SubFigure]]:
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(10.8, 5.9), layout="constrained")
    webs: Any = drawn.subfigures(1, 2, wspace=0.04)
    return drawn, list(webs)


def _common_settings(players: Mapping[str, Scores]) -> list[str]:
    if not players:
        raise InvalidArgumentError("A spider chart needs at least one player.")
    normalized = [
        {game for game, scores in games.items() if any(score is not None for score in scores)}
        for games in players.values()
    ]
    settings = [game for game in PAPER_SETTINGS if all(game in known for known in normalized)]
    if not settings:
        raise InvalidArgumentError(
            "A spider chart needs a setting that all its players played and that has a human score: "
            f"{', '.join(PAPER_SETTINGS)}."
        )
    return settings


def _profile(scores: Scores, weights: Weights) -> list[MeanEstimate]:
    found = capability_scores(scores, weights=weights).scores
    if missing := [score.capability for score in found if score.estimate is None]:
        raise InvalidArgumentError(f"These settings give no score for {', '.join(missing)}; use the paper's weights.")
    return [score.estimate for score in found if score.estimate is not None]


def _prepare(axes: Axes, top: float) -> None:
    polar: Any = axes
    polar.set_theta_offset(math.pi / 2)
    polar.set_theta_direction(-1)
    polar.set_xticks(_angles(), [_in_two_lines(name) for name in CAPABILITIES], fontsize=8.5)
    polar.set_ylim(0, top)
    polar.set_yticks([tick for tick in (0.25, 0.5, 0.75, 1.0, 1.25, 1.5) if tick <= top])
    polar.tick_params(axis="y", labelleft=False)
    for tick in polar.get_yticks():
        # Above the shapes, and readable on them.
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
        place = {"ha": "center", "va": "center", "fontsize": 7.5, "color": GREY, "zorder": 6, "bbox": box}
        polar.text(math.radians(20), tick, f"{tick:g}", **place)
    polar.tick_params(axis="x", pad=4)
    for angle, label in zip(_angles(), polar.get_xticklabels(), strict=True):
        # Names are outside the chart, on every side of it.
        sideways = math.sin(angle)
        label.set_horizontalalignment("center" if abs(sideways) < 0.2 else "left" if sideways > 0 else "right")
        label.set_verticalalignment(
            "bottom" if math.cos(angle) > 0.9 else "top" if math.cos(angle) < -0.9 else "center"
        )


def _draw(axes: Axes, profile: Sequence[MeanEstimate], top: float, look: Series, name: str) -> None:
    highest = max(found.mean for found in profile)
    label = name if highest <= top else f"{name} (up to {highest:.1f}, drawn at the rim)"
    angles = [*_angles(), _angles()[0]]
    radii = [min(max(found.mean, 0.0), top) for found in (*profile, profile[0])]
    axes.plot(angles, radii, color=look.colour, linestyle=look.line, marker=look.marker, markersize=4, label=label)
    for angle, found in zip(_angles(), profile, strict=True):
        if found.low is not None and found.high is not None and found.low < found.high:
            ends = [min(max(end, 0.0), top) for end in (found.low, found.high)]
            axes.plot([angle, angle], ends, color=look.colour, linewidth=3.5, alpha=0.35, solid_capstyle="butt")


def _angles() -> list[float]:
    return [2 * math.pi * at / len(CAPABILITIES) for at in range(len(CAPABILITIES))]


def _in_two_lines(name: str) -> str:
    """Break a name at the space nearest to its middle."""
    spaces = [at for at, letter in enumerate(name) if letter == " "]
    middle = min(spaces, key=lambda at: abs(2 * at - len(name)), default=None)
    return name if middle is None else f"{name[:middle]}\n{name[middle + 1 :]}"
