"""What every server of this package requires of a request: Host, Origin, token, and limits of time and size.

A page on the internet can make a browser send requests to a server on the same machine, under a name of its own that
leads to 127.0.0.1. So a server answers only to names that it expects, and to pages of origins that it expects. An
address that other machines can reach also needs a token. A request has to come whole and in time, and its body has a
limit, so that nobody can fill a server's memory or its connections.
"""

from typing import TYPE_CHECKING

from smartplay_tools.lazy import lazy_exports
from smartplay_tools.web.admission import LOCAL, Names, is_bearer, is_from_own_page, is_loopback

if TYPE_CHECKING:
    from smartplay_tools.web.bodies import LARGEST_REQUEST, UNAUTHORIZED, Bounded, hosted_or_refusal
    from smartplay_tools.web.guard import Guard, carries, check_address, guarded
    from smartplay_tools.web.hosted import HostedEpisode, check_budget
    from smartplay_tools.web.server import Server
    from smartplay_tools.web.store import EpisodeStore, FullError, Hosted, Store

__all__ = [
    "LARGEST_REQUEST",
    "LOCAL",
    "UNAUTHORIZED",
    "Bounded",
    "EpisodeStore",
    "FullError",
    "Guard",
    "Hosted",
    "HostedEpisode",
    "Names",
    "Server",
    "Store",
    "carries",
    "check_address",
    "check_budget",
    "guarded",
    "hosted_or_refusal",
    "is_bearer",
    "is_from_own_page",
    "is_loopback",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_exports(
        __name__,
        {
            "bodies": ("LARGEST_REQUEST", "UNAUTHORIZED", "Bounded", "hosted_or_refusal"),
            "guard": ("Guard", "carries", "check_address", "guarded"),
            "hosted": ("HostedEpisode", "check_budget"),
            "server": ("Server",),
            "store": ("EpisodeStore", "FullError", "Hosted", "Store"),
        },
    )
