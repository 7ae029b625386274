"""The compiled Crafter engine: the rules of `fast`, compiled by numba (the extra `rl`) and run on many worlds at once.

Worlds, draws and states are equal to those of `fast` bit for bit; tests step both side by side. The modules, lowest
first: `layout` (a world as one record), `jit`, `twister` (the random stream), `ground` (map, things, chunks),
`body` (the player), `others` (creatures, and how many there are), `step`, `noise`, `terrain` and `worldgen` (new
worlds), `views` and `pictures` (what can be seen), `entry` (what Python calls) and `worlds` (the worlds as one object).
"""
