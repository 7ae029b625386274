"""MESSENGER (paper section 3.5): bring the message to the goal, and read from a manual who is what.

rules.py    the rules: games, starts, movements, contacts, rewards
text.py     the texts: observation and manual
manuals.py  the choice of an episode's manual sentences from the texts
texts/      our sentences, by split, in the format of the original's data set
game.py     the environment that combines them
"""
