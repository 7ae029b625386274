"""What every server of this package requires of a request: Host, Origin, token, and limits of time and size.

A page on the internet can make a browser send requests to a server on the same machine, under a name that
leads to 127.0.0.1. So a server answers only to names that it expects, and to pages of origins that it expects. An
address that other machines can reach also needs a token. A request has to come whole and in time, and its body has a
limit, so that nobody can fill a server's memory or its connections.
"""

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.web.bodies import (
        LARGEST_REQUEST as LARGEST_REQUEST,
        UNAUTHORIZED as UNAUTHORIZED,
        Bounded as Bounded,
    )
    from smartplay_tools.web.guard import carries as carries, check_address as check_address, guarded as guarded
    from smartplay_tools.web.hosted import HostedEpisode as HostedEpisode
    from smartplay_tools.web.server import Server as Server
    from smartplay_tools.web.store import (
        EpisodeStore as EpisodeStore,
        FullError as FullError,
        NotServedError as NotServedError,
        Store as Store,
    )

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
