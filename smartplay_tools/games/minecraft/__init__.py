"""Minecraft creative navigation (paper section 3.7): walk until the biome of the task is found.

The tasks and the text are the same for all engines, which are interchangeable:

    observation    the data that an engine returns after an action: arrays, and the rays that filled them
    text           the observation text, in the original's words
    rules          the goals, and what an action does
    engines        the interface of an engine, and which engines work on this machine
    game           `Minecraft`, the environment that combines them
    voxel/         the embedded engine: a world of blocks in NumPy
    minedojo/      MineDojo, the engine of the paper, in its own environment
"""
