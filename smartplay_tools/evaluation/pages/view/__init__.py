"""The site over run folders: which runs there are, their episodes, and what is being played now.

run_list      which runs there are now
site_runs     what a site shows of a run, as plain data, read again only where the folder has changed
site_record   the same of a single transcript
app           the routes, whom they answer, the stream of events; `playing` has those by which a person plays
http_answers  headers with the content security policy, pages, scripts and styles
site_server   an address that the site is served on, safe by default
templates/    the pages; static/ has their scripts; an episode is the replay page, made when it is opened

The site is read-only, unless it is started with a game that a person plays.
"""

from smartplay_tools.errors import extra_named

with extra_named("The site", "view"):
    from smartplay_tools.evaluation.pages.view.run_list import RunList, find_runs
    from smartplay_tools.evaluation.pages.view.site_record import SiteRecord
    from smartplay_tools.evaluation.pages.view.site_runs import SiteRun
    from smartplay_tools.evaluation.pages.view.site_server import ViewServer

__all__ = ["RunList", "SiteRecord", "SiteRun", "ViewServer", "find_runs"]
