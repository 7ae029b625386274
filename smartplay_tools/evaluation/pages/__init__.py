"""Pages: runs and records as HTML, for browsers and notebooks. Nothing here plays.

report/    the replay page, one file that opens from disk
notebook   tables and replays below a notebook's cells
templates  the environment of the HTML templates
"""

from smartplay_tools.evaluation.pages.templates import environment

__all__ = ["environment"]
