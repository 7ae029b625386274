"""Statistics of the rows of a run: pure functions over plain data, which read no files and play nothing.

    summary     turns the rows of a run into scores with intervals, counts, tokens, cost, capabilities
    comparison  compares runs, pair by pair
    windows     compares the cells of a sweep with the widest window
    together    judges differences together: the level of their intervals, and their p values
    tables      writes rows as CSV, and a summary as JSON
    figures/    draws sweeps, capabilities and prompts

`grouping` decides which episodes are averaged together. Means are estimated in `smartplay_tools.statistics`.
"""
