"""Evaluation: runs of many episodes that are kept on disk, statistics with intervals, pages and submissions.

runs/      plays episodes and keeps their records
analysis/  computes statistics from rows, and draws them
pages/     shows runs and records: the replay page, the site, notebooks
board/     submissions, and the leaderboard of those that were verified
suites     the fixed lists of games and budgets that results are compared on

`analysis` and `pages` play nothing; `board` does not import what plays. What all of them read, records and the folders
that hold them, is `smartplay_tools.records`. Names are imported from the modules that define them, so that reading a
run does not load the code that plays one.
"""
