"""Evaluation: many episodes, played once each, kept on disk, and made into figures that say how sure they are.

plan          the episodes of a run, their seeds and keys
attempt       one planned episode, played and recorded
executors/    where and how many at a time attempts are made
meter, prices caps on what a whole run may spend
store         the run's folder
work, runner  what is left to be played; `evaluate`
merging       shards put together
cells         which episodes may be put into one figure
metrics       rows into figures: intervals, capabilities, bracket
standing      how far a run is
display       figures as tables for a terminal
tables        rows as CSV and Parquet, figures as JSON
report/       a run as a page that replays its episodes
"""
