"""The site over run folders: which runs there are, their episodes, and what is being played now.

listed        an episode in the list of a run
site_runs     which runs there are now, and what a site shows of each, read again where the folder has changed
served_pages  the pages of episodes
browser_play  the episodes that a person plays in the browser, as `browser_player` answers
app           the server, the routes, whom they answer, the stream of events; `playing` has the routes of play
http_answers  headers with the content security policy, pages, scripts and styles
templates/    the pages; static/ has their scripts; an episode is the replay page, made when it is opened

The site is read-only, unless it is started with a game that a person plays.
"""

from smartplay_tools.errors import extra_named

with extra_named("The site", "view"):
    from smartplay_tools.web.site.app import ViewServer
    from smartplay_tools.web.site.browser_play import BrowserGames
    from smartplay_tools.web.site.site_runs import RunList

__all__ = ["BrowserGames", "RunList", "ViewServer"]
