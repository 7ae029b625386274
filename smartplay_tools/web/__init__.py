"""What every server of this package asks of a request: a Host and an Origin that are expected, and the token.

A page on the internet can make a browser send requests to a server on the same machine, under a name of its own that
leads to 127.0.0.1. So a server answers only to names that it expects, and to pages of origins that it expects. An
address that other machines can reach also needs a token.
"""

from typing import TYPE_CHECKING

from smartplay_tools.lazy import lazy_exports
from smartplay_tools.web.admission import LOCAL, Names, is_bearer, is_from_own_page, is_loopback

if TYPE_CHECKING:
    from smartplay_tools.web.bodies import TOO_LARGE, UNAUTHORIZED, asked, read_body
    from smartplay_tools.web.guard import carries, check_address, guarded
    from smartplay_tools.web.hosted import HostedEpisode, check_budget
    from smartplay_tools.web.server import Server
    from smartplay_tools.web.store import EpisodeStore, FullError, Hosted, Store

__all__ = [
    "LOCAL",
    "TOO_LARGE",
    "UNAUTHORIZED",
    "EpisodeStore",
    "FullError",
    "Hosted",
    "HostedEpisode",
    "Names",
    "Server",
    "Store",
    "asked",
    "carries",
    "check_address",
    "check_budget",
    "guarded",
    "is_bearer",
    "is_from_own_page",
    "is_loopback",
    "read_body",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_exports(
        __name__,
        {
            "bodies": ("TOO_LARGE", "UNAUTHORIZED", "asked", "read_body"),
            "guard": ("carries", "check_address", "guarded"),
            "hosted": ("HostedEpisode", "check_budget"),
            "server": ("Server",),
            "store": ("EpisodeStore", "FullError", "Hosted", "Store"),
        },
    )
