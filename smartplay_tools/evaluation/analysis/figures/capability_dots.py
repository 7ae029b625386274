"""The nine capabilities as dots: several players beside the paper's models and the human, a row for each capability.

All are scored on the same settings: those of the paper for which every player has a normalised score.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.capabilities import capability_scores
from smartplay_tools.evaluation.analysis.figures import style
from smartplay_tools.games.paper_tables import CAPABILITIES, PAPER_RESULTS, PAPER_SETTINGS
from smartplay_tools.statistics.intervals import MeanEstimate
from smartplay_tools.visible import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Scores = Mapping[str, Sequence[float | None]]
"""Normalised scores of a player's episodes, by game."""


@style.figure
def capability_dots(players: Mapping[str, Scores]) -> Figure:
    """Draw capability scores (1 is the human's) of players, and as small dots those of the paper's models.

    A mark at a player's name (`style.MARK_NOTES`) is explained below.
    """
    settings = _common_settings(players)
    drawn, (axes,) = style.panels(1, size=(8.6, 5.0))
    places = range(len(CAPABILITIES))
    models = [result for result in PAPER_RESULTS if result.player != "human"]
    for at, model in enumerate(models):
        means = [score.mean for score in _profile({game: [model.normalized[game]] for game in settings})]
        label = f"the paper's {len(models)} models" if at == 0 else None
        axes.plot(means, places, color=style.GREY, marker="o", markersize=4, alpha=0.45, linestyle="", label=label)
    found = []
    for index, (name, scores) in enumerate(players.items()):
        look, beside = style.Series.number(index), style.spread(index, len(players))
        profile = _profile({game: scores[game] for game in settings})
        ends = [(each.low, each.high) for each in profile if each.low is not None and each.high is not None]
        above, below = sum(low > 1 for low, _ in ends), sum(high < 1 for _, high in ends)
        found.append(f"{visible(name)}: above the human in {above} of {len(profile)} capabilities, below in {below}")
        style.draw_dots(axes, profile, [place + beside for place in places], look, name)
    axes.axvline(1, color=style.GREY, linestyle=(0, (1, 2)), linewidth=1.4, label="human (paper)")
    axes.set_yticks(places, CAPABILITIES)
    axes.invert_yaxis()
    title = f"Capability scores over {len(settings)} of the paper's {len(PAPER_SETTINGS)} settings"
    axes.set(title="\n".join([*found[:2], title]), xlabel="score as a share of the human's")
    episodes = [sum(len(scores[game]) for game in settings) for scores in players.values()]
    notes = [style.sample_note(episodes), *style.mark_notes(players)]
    style.legend_below(drawn, note="; ".join(notes))
    return drawn


def _common_settings(players: Mapping[str, Scores]) -> list[str]:
    if not players:
        raise InvalidArgumentError("A figure of capabilities needs at least one player.")
    normalized = [
        {game for game, scores in games.items() if any(score is not None for score in scores)}
        for games in players.values()
    ]
    settings = [game for game in PAPER_SETTINGS if all(game in played for played in normalized)]
    if not settings:
        raise InvalidArgumentError(
            "A figure of capabilities needs a setting that all its players played and that has a human score: "
            f"{', '.join(PAPER_SETTINGS)}."
        )
    return settings


def _profile(scores: Scores) -> list[MeanEstimate]:
    """All nine capabilities: by the paper's weights, every setting counts for each of them."""
    return [score.estimate for score in capability_scores(scores).scores if score.estimate is not None]
