"""The engine of the paper: MineDojo 0.1, that is Minecraft itself, in an interpreter of its own.

MineDojo needs a gym and a NumPy that this package cannot live with, and today's pip refuses to install it. So it gets
a virtual environment (`install`), in which a script (`worker`) drives it and speaks JSON over its pipes with this
process (`process`), where it looks like every other engine (`engine`). What is installed is MineDojo as it was
released; nothing of it is changed. The game's client, which MineDojo builds and starts with Java, is the user's.
"""
