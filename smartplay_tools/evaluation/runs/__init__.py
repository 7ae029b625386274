"""Playing the episodes of a run and keeping their records.

plan           the episodes of a run, their seeds and keys
players        the players of a run and their options
blind          the player that repeats a recorded episode
agents         programs and functions that play episodes in their own way
probe          the check of a run's models
faults         the sentences for what it finds
attempt        playing and recording one planned episode
roster         how each player is configured, where its episodes are played, and which can be sent to other processes
executors/     running attempts in processes, on an event loop or on a cluster
limits         caps on the tokens and cost of a whole run
estimate       the expected tokens, cost and time of a run
run_writer     writing the run's folder, by one process at a time
run_options    how a run is played: executor, workers, caps, prices
scheduler      the choice of the next episode, and the handling of every finished attempt
run_progress   the one thread that shows a run; Ctrl-C stops it between two turns
runner         `evaluate`
sweeps         runs over a grid of budgets, compared with the widest window
audit          replaying every episode of a run
"""
