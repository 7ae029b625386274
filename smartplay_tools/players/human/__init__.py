"""A person at a terminal as a player: `screen` draws the prompt, `player` reads the answer."""
