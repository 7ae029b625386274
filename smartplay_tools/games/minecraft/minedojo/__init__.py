"""The paper's engine: MineDojo 0.1, which is Minecraft itself, in a separate Python interpreter.

MineDojo needs versions of gym and NumPy that conflict with this package, and current versions of pip refuse to install
it. It therefore gets its own virtual environment (`requirements.txt`, docs/minecraft.md), in which a script (`worker`)
runs it and exchanges JSON with this process (`process`) over pipes. `engine` gives it the interface of every other
engine. MineDojo is installed as it was released, without changes. The game's client, which MineDojo builds and starts
with Java, has to be provided by the user.
"""
