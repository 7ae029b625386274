"""Replay pages for a site that serves them: each is one episode, which may still be played.

Such a page knows the site (`site`): where the list is, which episodes are its neighbours, and where new turns come
from. It may ask this server, and no other.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from smartplay_tools.evaluation.pages.report.episode_reading import packs, read_episodes
from smartplay_tools.evaluation.pages.report.page import render_runs, render_threads
from smartplay_tools.evaluation.pages.report.sources import ShownRun, Source, Sources
from smartplay_tools.evaluation.pages.report.threads import shown_threads
from smartplay_tools.games.game_registry import importing_packages
from smartplay_tools.manager.record import is_thread_record
from smartplay_tools.records.damage import DamageError


def render_episode(record: Path, key: str, title: str, site: Mapping[str, Any], *, plugins: bool = False) -> str:
    """Return the page of one episode, or of a thread, which is called `key` in it; the page is called `title`."""
    if is_thread_record(record):
        return render_threads([record], title, site)
    run = ShownRun(record, "", Sources([Source(key, record)]))
    with importing_packages(plugins):
        return render_runs([run], title, plugins=plugins, opened="first", site=site)


def pack_episode(record: Path, key: str, *, plugins: bool = False) -> str:
    """Return what such a page unpacks of an episode or a thread, as far as its record goes."""
    if is_thread_record(record):
        return packs(shown_threads([record])[0])[0][1]
    shown, damaged = read_episodes([Source(key, record)], "", plugins=plugins)
    if damaged:
        raise DamageError(damaged[0])
    return packs(shown)[0][1]
