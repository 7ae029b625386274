"""Summary: a run as a table, a line for every game, player and set of rules."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from statistics import fmean, stdev
from typing import Any

Z_95 = 1.96


@dataclass
class Line:
    """The episodes of one game, player and set of rules."""

    game: str
    player: str
    rules: str
    """What the model was allowed to see and how it was asked."""
    results: list[dict[str, Any]] = field(default_factory=list)
    failed: int = 0
    unfinished: int = 0

    @property
    def scores(self) -> list[float]:
        """The scores of the finished episodes."""
        return [result["score"] for result in self.results]

    @property
    def normalized(self) -> float | None:
        """Mean score with a human's as 1; None where the paper has no human baseline."""
        known = [result["normalized_score"] for result in self.results if result["normalized_score"] is not None]
        return fmean(known) if known else None

    @property
    def score(self) -> float | None:
        """Mean score."""
        return fmean(self.scores) if self.scores else None

    @property
    def margin(self) -> float | None:
        """Half of the 95 % interval of the mean by the normal approximation; None for a single episode."""
        return Z_95 * stdev(self.scores) / len(self.scores) ** 0.5 if len(self.scores) > 1 else None

    @property
    def steps(self) -> float | None:
        """Mean steps."""
        return self._mean(lambda result: result["steps"])

    @property
    def prompt_tokens(self) -> float | None:
        """Mean tokens of all prompts of an episode."""
        return self._mean(lambda result: result["tokens"]["prompt"])

    @property
    def stable(self) -> float | None:
        """The share of the prompts' tokens that a prompt cache could serve."""
        prompt = sum(result["tokens"]["prompt"] for result in self.results)
        return sum(result["tokens"]["prefix"] for result in self.results) / prompt if prompt else None

    @property
    def mistakes(self) -> float | None:
        """Mean illegal actions, malformed calls and replies without a call."""
        return self._mean(lambda r: r["illegal_actions"] + r["malformed_calls"] + r["idle_replies"])

    def _mean(self, number: Any) -> float | None:
        return fmean(map(number, self.results)) if self.results else None


def summarize(episodes: Iterable[Mapping[str, Any]]) -> list[Line]:
    """Return the table of some episodes (`episode_data`), in their order."""
    lines: dict[tuple[str, str, str], Line] = {}
    for episode in episodes:
        place = episode["game"], episode["player"] or "", rules(episode)
        line = lines.setdefault(place, Line(*place))
        if episode["status"] == "finished":
            line.results.append(episode["result"])
        else:
            line.failed += episode["status"] == "failed"
            line.unfinished += episode["status"] == "unfinished"
    return list(lines.values())


def rules(episode: Mapping[str, Any]) -> str:
    """Say in a few words under which budget and protocol an episode was played."""
    budget = episode["budget"]
    words = [f"history {'all' if budget['history'] is None else budget['history']}"]
    words += [f"prompts \N{LESS-THAN OR EQUAL TO} {budget['prompt_tokens']:,}"] if budget["prompt_tokens"] else []
    words += [f"slack {budget['slack']:g}"] if budget["slack"] else []
    words += [f"manual {episode['manual']}"] if episode["manual"] != "tool" else []
    words += [f"{episode['protocol']} protocol"] if episode["protocol"] != "tools" else []
    words += ["host's context"] if episode["context"] == "host" else []
    words += [episode["engine"]] if episode["engine"] else []
    words += [f"{name} {value}" for name, value in sorted((episode["options"] or {}).items())]
    return ", ".join(words)
