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
    from smartplay_tools.records.caches import CacheFields, CacheRule, cache_rules, openai_cache_fields, rule_of
    from smartplay_tools.records.charges import Charge, calls_under, charge
    from smartplay_tools.records.manifest import Manifest, Until, trial_seed
    from smartplay_tools.records.prices import Price
    from smartplay_tools.records.prompts import SentPrompt, recorded_turns, sent_prompts
    from smartplay_tools.records.record import Record
    from smartplay_tools.records.replayed_pictures import recorded_pictures
    from smartplay_tools.records.replays import Replay, replay
    from smartplay_tools.records.request_log import RequestLog
    from smartplay_tools.records.requests import requests_of
    from smartplay_tools.records.resumption import Resumed, fork, resume
    from smartplay_tools.records.run_folder import RunFolder
    from smartplay_tools.records.run_follower import run_snapshot
    from smartplay_tools.records.snapshot import CellSnapshot, RunSnapshot, Spending
    from smartplay_tools.records.spent import Spent
    from smartplay_tools.records.tariffs import Tariff, tariffs_of

__all__ = [
    "CacheFields",
    "CacheRule",
    "CellSnapshot",
    "Charge",
    "Manifest",
    "Price",
    "Record",
    "Replay",
    "RequestLog",
    "Resumed",
    "RunFolder",
    "RunSnapshot",
    "SentPrompt",
    "Spending",
    "Spent",
    "Tariff",
    "Until",
    "cache_rules",
    "calls_under",
    "charge",
    "fork",
    "openai_cache_fields",
    "recorded_pictures",
    "recorded_turns",
    "replay",
    "requests_of",
    "resume",
    "rule_of",
    "run_snapshot",
    "sent_prompts",
    "tariffs_of",
    "trial_seed",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_exports(
        __name__,
        {
            "manifest": ("Manifest", "Until", "trial_seed"),
            "caches": ("CacheFields", "CacheRule", "cache_rules", "openai_cache_fields", "rule_of"),
            "charges": ("Charge", "calls_under", "charge"),
            "replayed_pictures": ("recorded_pictures",),
            "prices": ("Price",),
            "prompts": ("SentPrompt", "recorded_turns", "sent_prompts"),
            "record": ("Record",),
            "replays": ("Replay", "replay"),
            "request_log": ("RequestLog",),
            "requests": ("requests_of",),
            "resumption": ("Resumed", "fork", "resume"),
            "run_folder": ("RunFolder",),
            "run_follower": ("run_snapshot",),
            "snapshot": ("CellSnapshot", "RunSnapshot", "Spending"),
            "spent": ("Spent",),
            "tariffs": ("Tariff", "tariffs_of"),
        },
    )
