"""Evaluation: runs of many episodes that are kept on disk, statistics with intervals, and pages.

runs/      plays episodes and keeps their records
analysis/  computes statistics from rows, and draws them
pages/     shows runs and records: the replay page, the site, notebooks
suites     the fixed lists of games and budgets that results are compared on

`analysis` and `pages` play nothing. What all of them read, records and the folders
that hold them, is `smartplay_tools.records`. Names are imported from the modules that define them, so that reading a
run does not load the code that plays one.
"""
