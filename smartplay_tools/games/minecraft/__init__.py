"""Minecraft creative navigation (paper section 3.6): walk until the biome of the task is found.

One contract in front of interchangeable engines:

    tasks          the eight goals, the four actions and how one action becomes 51 game ticks
    observation    what an engine tells after an action: arrays, and the rays that filled them
    text           those arrays in the original's words
    engines        the interface of an engine, and the table of those that exist
    game           `Minecraft`, the environment that glues them
    doctor         which engines work on this machine
    voxel/         the embedded engine: a world of blocks in NumPy
"""
