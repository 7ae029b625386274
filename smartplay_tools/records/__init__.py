"""Records of episodes: read, replayed, continued, priced and added up. What a run keeps is in `evaluation.run_folder`.

record             an episode as its record tells it
prompts            every prompt rebuilt from a record and verified
driver, replays    a record played again on a new game and compared; the pictures that a model was shown
resumption         an episode continued from its record, and what a trial leaves to the next one
accounts           where the tokens of prompts went, how turns were shown, and why they left
rows               the results of episodes as plain data
spent              what the events of a record add up to, and what runs have used
best_choices       the score of the best choice of whole turns in a world, for rows
requests           the requests that an episode sent, as a provider's cache saw them

A model or a player is never called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.records.best_choices import best_choice as best_choice
    from smartplay_tools.records.prompts import sent_prompts as sent_prompts
    from smartplay_tools.records.record import Record as Record
    from smartplay_tools.records.replays import recorded_pictures as recorded_pictures, replay as replay
    from smartplay_tools.records.requests import requests_of as requests_of
    from smartplay_tools.records.resumption import resume as resume

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
