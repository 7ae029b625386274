"""Crafter (paper section 3.6): an open world of 64 by 64 cells in which a player gathers, crafts, fights and survives.

The modules, lowest first: `facts` (the rules as tables), `stream` (the random stream of a world), `noise` and
`worldgen` (the generation of a world), `world` (ground, things and chunks), `player`, `creatures` and `balance` (what
happens in a step), `fast` (the default engine, made of these), `reference` (PyPI `crafter` with the same interface, for
comparison), `text` (the observation text), `textures` and `pictures`, and `game` (the text environment).

For agents that read no text: `observations` (a picture, ids or numbers) and `environment` (the Gymnasium environment
that returns them).
"""
