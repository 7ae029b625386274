"""The replay page: a run, or a single transcript, as one HTML file that opens from disk and needs no network.

    sources          the episodes, finished or not
    episodes         a transcript for the page: turns, the contents of each prompt, tokens
    drawings         the states of the game, from playing the record again; textures for Crafter
    figures          the figures of runs, drawn for the page
    episode_reading  an episode's record checked, drawn and packed, by several processes if there are many
    page             all of it put into one file; the templates, the styles and the scripts lie beside it
    served           the same for a site, with an episode that may still be played

The page does not contain prompts: it contains the turns and what each prompt showed of them, and its script assembles a
prompt when it is opened. Nothing that a model wrote becomes markup: texts are stored compressed and in base64, and a
script inserts them as text.
"""
