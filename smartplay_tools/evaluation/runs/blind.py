"""`blind:RUN`: a player that replays the actions of the best recorded episode of a setting, whatever it is shown.

How well it scores on other seeds says how far a setting is solved by memory alone: a model that has seen one good
episode needs no observation to score as much. RUN is a run's folder, a folder of records or one record. The best
episode has the highest score among those of the setting whose seed is not the one being played; of several, it is the
one with the lowest seed. When its actions are used up, they are repeated from the start.
"""

from __future__ import annotations

import json
from operator import itemgetter
from pathlib import Path

from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.run_folder.folder import records_in
from smartplay_tools.players.prompt_reading import call
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import recorded_score
from smartplay_tools.types import Prompt, Reply


class BlindPlayer:
    """Replays the best recorded episode of the setting that it plays."""

    name = "blind"

    def __init__(self, run: str, *, seed: int = 0) -> None:
        """Every player takes a seed; this one draws nothing."""
        self._run = Path(run)
        if not self._run.exists():
            raise InvalidArgumentError(f"There is no {run} to replay; name a run's folder, as blind:runs/first.")
        self._episode: Episode | None = None
        self._actions: list[str] = []

    def attach(self, conversation: BaseConversation) -> None:
        """Find the episode to replay by the setting and the seed, which is avoided; nothing is asked of the game."""
        episode = self._episode = conversation.episode
        record = best_record(self._run, episode.spec.id, episode.config.seed)
        self._actions = played_actions(record)
        if not self._actions:
            raise InvalidArgumentError(f"{record.path} has no actions by tool calls that could be replayed.")

    def reply(self, prompt: Prompt) -> Reply:
        """Play the next action of the recorded episode."""
        if self._episode is None:
            raise InvalidArgumentError(
                "The blind player needs its setting, so it must be attached to a conversation: use `play` or eval."
            )
        if prompt.purpose != "play":
            return Reply({"role": "assistant", "content": "-"})
        action = self._actions[self._episode.stats.steps % len(self._actions)]
        return Reply(call("act", action=action) if prompt.tools else {"role": "assistant", "content": action})


def best_record(source: Path, game: str, seed: int) -> Record:
    """Return the finished record of a game with the highest score that was played with another seed."""
    heads = ((path, Record.head(path)) for path in records_in(source))
    finished = ((path, head) for path, head in heads if head.outcome == "finished" and head.game == game)
    others = ((recorded_score(head), -head.result.seed, path) for path, head in finished if head.seed != seed)
    best = max(others, key=itemgetter(0, 1), default=None)
    if best is None:
        raise InvalidArgumentError(f"{source} has no finished episode of {game} with another seed than {seed}.")
    return Record.read(best[2])


def played_actions(record: Record) -> list[str]:
    """Return the actions that were played, in their order; what the game did not play is left out."""
    return [
        str(json.loads(event["arguments"])["action"])
        for event in record.calls
        if event["name"] == "act" and "reward" in event["data"]
    ]
