"""Records and the folders that hold them: read, replayed, continued, priced and added up.

record             an episode as its record tells it
replayed_pictures  the pictures that a model was shown, made again
conversations      an episode as one conversation, as if there had been no window
prompts            every prompt rebuilt from a record and verified
driver, replays    a record played again on a new game and compared
resumption         an episode continued from its record
chains             what a trial leaves to the next one
accounts           where the tokens of prompts went, and why turns left them
shown              how a prompt showed each turn before it
annotations        people's notes about the turns of an episode
rows               the results of episodes as plain data
prices             what tokens cost
manifest           what a run plays, and its seeds and shards
run_folder         the folder of a run
counts, spent      what the events of a record add up to, and what runs have used
snapshot           how far a run is; `run_follower` counts it, `time_left` estimates the rest
parallel           many records read by several processes
process_pool       processes of which one may die
blind              the player that repeats a recorded episode

`caches`, `requests`, `request_log`, `charges` and `tariffs` compute what a record costs where prompts are cached.
Nothing here plays: a model or a player is never called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.lazy import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.records.caches import (
        CacheFields as CacheFields,
        CacheRule as CacheRule,
        cache_rules as cache_rules,
        openai_cache_fields as openai_cache_fields,
        rule_of as rule_of,
    )
    from smartplay_tools.records.charges import Charge as Charge, calls_under as calls_under, charge as charge
    from smartplay_tools.records.manifest import Manifest as Manifest, Until as Until, trial_seed as trial_seed
    from smartplay_tools.records.prices import Price as Price
    from smartplay_tools.records.prompts import (
        SentPrompt as SentPrompt,
        recorded_turns as recorded_turns,
        sent_prompts as sent_prompts,
    )
    from smartplay_tools.records.record import Record as Record
    from smartplay_tools.records.replayed_pictures import recorded_pictures as recorded_pictures
    from smartplay_tools.records.replays import Replay as Replay, replay as replay
    from smartplay_tools.records.request_log import RequestLog as RequestLog
    from smartplay_tools.records.requests import requests_of as requests_of
    from smartplay_tools.records.resumption import Resumed as Resumed, fork as fork, resume as resume
    from smartplay_tools.records.run_folder import RunFolder as RunFolder
    from smartplay_tools.records.run_follower import run_snapshot as run_snapshot
    from smartplay_tools.records.snapshot import (
        CellSnapshot as CellSnapshot,
        RunSnapshot as RunSnapshot,
        Spending as Spending,
    )
    from smartplay_tools.records.spent import Spent as Spent
    from smartplay_tools.records.tariffs import Tariff as Tariff, tariffs_of as tariffs_of

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "smartplay_tools.records.manifest": "Manifest Until trial_seed",
            "smartplay_tools.records.caches": "CacheFields CacheRule cache_rules openai_cache_fields rule_of",
            "smartplay_tools.records.charges": "Charge calls_under charge",
            "smartplay_tools.records.replayed_pictures": "recorded_pictures",
            "smartplay_tools.records.prices": "Price",
            "smartplay_tools.records.prompts": "SentPrompt recorded_turns sent_prompts",
            "smartplay_tools.records.record": "Record",
            "smartplay_tools.records.replays": "Replay replay",
            "smartplay_tools.records.request_log": "RequestLog",
            "smartplay_tools.records.requests": "requests_of",
            "smartplay_tools.records.resumption": "Resumed fork resume",
            "smartplay_tools.records.run_folder": "RunFolder",
            "smartplay_tools.records.run_follower": "run_snapshot",
            "smartplay_tools.records.snapshot": "CellSnapshot RunSnapshot Spending",
            "smartplay_tools.records.spent": "Spent",
            "smartplay_tools.records.tariffs": "Tariff tariffs_of",
        },
    )
