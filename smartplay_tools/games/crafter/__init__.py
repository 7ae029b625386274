"""Crafter (paper section 3.6): an open world of 64 by 64 cells in which a player gathers, crafts, fights and survives.

The modules, lowest first: `facts` (the rules as tables), `stream` (the random stream of a world), `noise` and
`worldgen` (the generation of a world), `world` (ground, things and chunks), `player`, `creatures` and `balance` (what
happens in a step), `fast` (the engine, made of these), `text` (the observation text), `views` and `pictures`, and
`game` (the environment).
"""
