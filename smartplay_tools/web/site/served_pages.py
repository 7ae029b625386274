"""The pages that the site serves: the replay of a record, and what is new in one that is open."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from smartplay_tools.evaluation.pages.report.served import pack_episode, render_episode
from smartplay_tools.types.quantities import duration, short
from smartplay_tools.web.site.site_runs import ViewedRun
from smartplay_tools.web.site.site_threads import THREADS


class ServedPages:
    """Makes the pages; a record is named as in an address: `KIND/STEM`."""

    def __init__(self, *, plugins: bool) -> None:
        self._plugins = plugins

    def episode(self, run: ViewedRun, record: str) -> str:
        """Return the page of an episode; one that is being played asks for its new turns."""
        path, key = run.record(record), record.partition("/")[2]
        version, is_playing = self.version(run, record)
        before, after = _neighbours(run, record)
        site = {"home": f"/#run={quote(run.name)}", "previous": before, "next": after, "playing": is_playing}
        if is_playing:
            site |= {"updates": f"/api/episode/{address(run, record)}", "version": version}
        return render_episode(path, key, run.name, site, plugins=self._plugins)

    def version(self, run: ViewedRun, record: str) -> tuple[str, bool]:
        """Return what changes when an episode's page does, and whether the episode is being played."""
        path = run.record(record)
        return f"{path.parent.name}-{path.stat().st_size}", run.is_playing(path)

    def news(self, run: ViewedRun, record: str, *, is_new: bool) -> dict[str, Any]:
        """Return what an open page needs: the episode, if it is new, and the figures of its run in words."""
        data = None
        if is_new:
            data = pack_episode(run.record(record), record.partition("/")[2], plugins=self._plugins)
        return {"data": data, "figures": _figures(run.summary())}


def address(run: ViewedRun, record: str) -> str:
    """Return what names a record in addresses."""
    return f"{quote(run.name)}/{record}"


def _neighbours(run: ViewedRun, record: str) -> tuple[str | None, str | None]:
    """The addresses of the episodes before and after one in the plan."""
    listed = [None, *(row[0] for row in run.episodes() if row[0]), None]
    if record not in listed:
        return None, None
    at = listed.index(record)
    before, after = (each and f"/episode/{address(run, each)}" for each in (listed[at - 1], listed[at + 1]))
    return before, after


def _figures(run: dict[str, Any]) -> str:
    """The figures of a run that is being played, in words: tokens and money against its caps, and the time left."""
    if "error" in run:
        return "being played"
    if run["games"] == [THREADS]:
        return f"live, {short(run['tokens'])} tokens in {run['planned']} threads"
    caps = run["caps"] or {}
    cap_tokens, cap_cost = caps.get("tokens"), caps.get("cost")
    words = ["being played", f"run: {run['finished']} of {run['planned']} episodes"]
    words.append(f"{short(run['tokens'])}{'' if cap_tokens is None else f' of {short(cap_tokens)}'} tokens")
    if run["cost"] or cap_cost is not None:
        cost = "unknown" if run["cost"] is None else f"${run['cost']:.2f}"
        words.append(f"{cost}{'' if cap_cost is None else f' of ${cap_cost:.2f}'}")
    if run["seconds_left"] is not None:
        words.append(f"about {duration(run['seconds_left'])} left")
    return ", ".join(words)
