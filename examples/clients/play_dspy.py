"""An agent of DSPy plays one episode, with its own context; docs/clients.md says how it is started.

pip install smartplay-tools dspy==3.4.1
"""

import dspy

import smartplay_tools as sp

with sp.Episode("Hanoi3Disk-v0", seed=7, context="host") as episode:
    react = dspy.ReAct("task -> answer", tools=list(episode.functions()), max_iters=100)
    with dspy.context(lm=dspy.LM("openai/gpt-4o-mini")):
        react(task="Play until the game is over.")
    print(episode.result)
