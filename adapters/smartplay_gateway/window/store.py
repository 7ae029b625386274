"""The episodes of the window endpoint, by handle."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from smartplay_gateway.window.episode import WindowEpisode
from smartplay_gateway.window.names import Shown
from smartplay_tools import AgentSession, AsyncPlayer, Episode, InvalidArgumentError, Player, resume
from smartplay_tools.players import ModelPlayer
from smartplay_tools.web import Store

PlayerOf = Callable[[int], Player | AsyncPlayer]
"""Returns the player of an episode, given its seed."""


class WindowStore(Store[WindowEpisode]):
    """Episodes by handle whose window the endpoint keeps.

    Arguments:
        player: who plays: one player for all episodes, or a function that returns one for a seed.
        closing: the name of a tool by which frameworks want a run to be closed; None for none.
        shown: what the model is shown of the host's own messages and tools.
        options: `folder`, `most` and `idle`, as for the episodes of the MCP server.
    """

    def __init__(
        self,
        player: Player | AsyncPlayer | PlayerOf,
        *,
        closing: str | None = "final_answer",
        shown: Shown | None = None,
        **options: Any,
    ) -> None:
        super().__init__(**options)
        if not isinstance(player, Player | AsyncPlayer) and not callable(player):
            raise InvalidArgumentError(
                f"{player!r} is not a player: it needs a `name`, and a method `reply` or `areply`."
            )
        self._player = player
        self._options: Any = {"closing": closing, "shown": shown}
        self._ignored: dict[str, str] = {}
        """What was ignored in episodes that are closed."""
        self._players: list[Player | AsyncPlayer] = []

    async def aclose(self) -> None:
        """Stop the turns under way, whose replies are lost, and close the players' connections of this event loop."""
        for episode in self.hosted():
            await episode.stop()
        for player in self._players:
            if isinstance(player, ModelPlayer):
                await player.aclose()

    def serve(self, episode: Episode, *, handle: str | None = None, session: AgentSession | None = None) -> str:
        """Give a handle to an existing episode whose context is "window".

        An episode that was continued from its record has its earlier `handle` and the `session` that continues.
        """
        player = self._player_of(episode.config.seed)

        def make(handle: str) -> WindowEpisode:
            return WindowEpisode(handle, episode, player, session=session, **self._options)

        return self.add(make, handle)

    def ignored(self, handle: str) -> str:
        """Say which of a host's messages and fields have not reached the model; `KeyError` for an unknown handle."""
        episode = None if handle in self._ignored else self.find(handle)
        return self._ignored[handle] if episode is None else episode.ignored

    def _let_go(self, handle: str, hosted: WindowEpisode, why: str) -> None:
        super()._let_go(handle, hosted, why)
        self._ignored[handle] = hosted.ignored

    def _player_of(self, seed: int) -> Player | AsyncPlayer:
        player = self._player if isinstance(self._player, Player | AsyncPlayer) else self._player(seed)
        if all(player is not other for other in self._players):
            self._players.append(player)
        return player

    def _begin(self, handle: str, game: str, **options: Any) -> WindowEpisode:
        player = self._player_of(options["seed"])
        episode = Episode(game, **options)
        episode.begin(player=player.name)
        return WindowEpisode(handle, episode, player, **self._options)

    def _again(self, handle: str, record: Path) -> WindowEpisode:
        resumed = resume(record, session=True)
        player = self._player_of(resumed.episode.config.seed)
        session: Any = resumed.conversation
        return WindowEpisode(handle, resumed.episode, player, session=session, **self._options)
