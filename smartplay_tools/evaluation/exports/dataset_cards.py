"""The dataset card: a README.md that says what the data is, in the form that the Hugging Face Hub shows and reads."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_tools.episode.seeds import trial_seed
from smartplay_tools.evaluation.exports.sft import FILE, EpisodeSelection
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import recorded_score
from smartplay_tools.types.groups import grouped

EVALUATED = 100
"""The number of worlds, the first that an evaluation plays by default, of which a card counts those in the data."""

WORDS = {
    "sft": "One row for every reply: `prompt` is exactly what the model saw, `completion` what it said, `tools` the "
    "schemas of its tools as JSON text.",
    "sft-chains": "One row for every stretch of an episode in which each prompt extends the one before. The assistant "
    "messages of `completion` are the replies, each after exactly the prompt to which it was given: all messages "
    "before it. Train on them only; assistant messages of `prompt` belong to an earlier row. `tools` are the "
    "schemas of the tools as JSON text.",
    "sft-episodes": "One row for every episode: `messages` is the whole conversation, `tools` the schemas of the tools "
    "as JSON text. A model under a budget saw parts of it at a time.",
    "atif": "One trajectory for every episode, in the Agent Trajectory Interchange Format.",
    "inspect": "Logs of Inspect AI, one for every game and player; `inspect view` shows them.",
}


def dataset_card(
    format: str,  # noqa: A002 - the word of the command line
    episodes: Sequence[Record],
    selection: EpisodeSelection,
    counts: Mapping[str, int],
    left_out: Counter[str],
) -> str:
    """Return the card's text."""
    groups = grouped(episodes, lambda e: (e.result.game, e.player, e.config.budget.describe() or "default"))
    lines = [
        *_front_matter(format),
        "# Episodes of SmartPlay's games",
        "",
        f"{WORDS[format]} The episodes were played and recorded by smartplay-tools {_versions(episodes)}.",
        "",
        f"{', '.join(f'{number:,} {name}' for name, number in counts.items())}. {_chosen(selection, left_out)}",
        "",
        "| game | player | budget as asked | episodes | mean score | completed |",
        "|---|---|---|---|---|---|",
        *(_row(*group, own) for group, own in sorted(groups.items())),
        "",
        "## Worlds",
        "",
        "Seeds: " + "; ".join(f"{game} {_seeds(episodes, game)}" for game in sorted({g for g, _, _ in groups})) + ".",
        "Do not train on the worlds with which you evaluate.",
        *_warnings(episodes),
    ]
    if privileged := sum(1 for episode in episodes if "player" in episode.result.deviations):
        lines += ["", f"In {privileged} episodes the player saw the state of the game in addition to its prompts."]
    return "\n".join(lines) + "\n"


def _front_matter(format: str) -> list[str]:  # noqa: A002
    data = ["configs:", "- config_name: default", f"  data_files: {FILE}"] if format.startswith("sft") else []
    tags = ["tags:", "- smartplay", "- tool-calling", "- games"]
    return ["---", "language: en", *tags, *data, "---", ""]


def _row(game: str, player: str, asked: str, episodes: Sequence[Record]) -> str:
    scores = list(map(recorded_score, episodes))
    completed = sum(episode.result.completed for episode in episodes)
    mean = f"{sum(scores) / len(scores):.4g}"
    cells: list[Any] = [game, f"`{player}`", asked, len(episodes), mean, completed]
    return f"| {' | '.join(map(str, cells))} |"


def _chosen(selection: EpisodeSelection, left_out: Counter[str]) -> str:
    asked = selection.model_dump(exclude_defaults=True)
    conditions = ", ".join(f"{name} = {_word(value)}" for name, value in asked.items())
    chosen = f"Selected by {conditions}." if conditions else "All finished episodes."
    if not left_out:
        return chosen
    reasons = ", ".join(f"{number:,} ({reason})" for reason, number in sorted(left_out.items()))
    return f"{chosen} Left out: {reasons}."


def _word(value: Any) -> str:
    return " or ".join(value) if isinstance(value, tuple) else str(value)


def _warnings(episodes: Sequence[Record]) -> list[str]:
    """Warnings: what the data's worlds teach beyond the games, and which of them an evaluation plays by default."""
    worlds = {(e.result.game, json.dumps(e.config.options, sort_keys=True)): e.config for e in episodes}
    about = ((game, config.spec.load().worlds(config.options)) for (game, _), config in sorted(worlds.items()))
    lines = [f"- {game} {words}" for game, words in about if words is not None]
    for game in sorted({game for game, _ in worlds}):
        evaluated = {trial_seed(0, game, trial) for trial in range(EVALUATED)}
        if shared := len(evaluated & {e.result.seed for e in episodes if e.result.game == game}):
            lines.append(
                f"- {game}: {shared} of these worlds are among the first {EVALUATED} that `smartplay-tools eval` plays "
                "by default. **Give `eval` another `--seed` for data to train on.**"
            )
    return ["", *lines] if lines else []


def _versions(episodes: Sequence[Record]) -> str:
    return ", ".join(sorted({episode.result.versions["smartplay-tools"] for episode in episodes}))


def _seeds(episodes: Sequence[Record], game: str) -> str:
    seeds = sorted({episode.result.seed for episode in episodes if episode.result.game == game})
    return str(seeds[0]) if len(seeds) == 1 else f"{len(seeds)} from {seeds[0]} to {seeds[-1]}"
