"""The rule players: one module per family of games, each a function of what the messages say.

A module here offers `plays(reading)`, whether these are its games (told by the legal actions), and `decide(reading)`,
the next assistant message. It keeps nothing between calls and writes no state into its replies, so what it knows is
what the window shows - and its score honestly depends on the window.
"""
