"""The site over run folders: which runs there are, their episodes, and what is being played now.

run_list      which runs there are now
site_runs     what a site shows of a run, as plain data, read again only where the folder has changed
site_record   the same of a single transcript
browser_play  the episodes that a person plays in the browser, as `browser_player` answers
challenge     an episode to play and the score to beat, as the address of a link
app           the routes, whom they answer, the stream of events; `playing` has those by which a person plays
http_answers  headers with the content security policy, pages, scripts and styles
site_server   an address that the site is served on, safe by default
templates/    the pages; static/ has their scripts; an episode is the replay page, made when it is opened

The site is read-only, unless it is started with a game that a person plays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.web.site.app import ViewServer as ViewServer
    from smartplay_tools.web.site.browser_play import (
        BrowserGames as BrowserGames,
        BrowserPlay as BrowserPlay,
        human_cell as human_cell,
    )
    from smartplay_tools.web.site.challenge import Challenge as Challenge
    from smartplay_tools.web.site.site_record import SiteRecord as SiteRecord
    from smartplay_tools.web.site.site_runs import RunList as RunList, SiteRun as SiteRun, find_runs as find_runs

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "smartplay_tools.web.site.site_runs": "RunList find_runs SiteRun",
            "smartplay_tools.web.site.site_record": "SiteRecord",
            "smartplay_tools.web.site.app": "ViewServer",
            "smartplay_tools.web.site.browser_play": "BrowserGames BrowserPlay human_cell",
            "smartplay_tools.web.site.challenge": "Challenge",
        },
    )
