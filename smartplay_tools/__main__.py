"""`python -m smartplay_tools` is the command line."""

from smartplay_tools.cli import app

app(prog_name="smartplay-tools")
