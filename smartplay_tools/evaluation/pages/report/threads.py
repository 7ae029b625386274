"""The threads of context managers on the replay page: each is shown as an episode is, prompt by prompt, without a game.

The page holds every message once, as it was sent and in words, and for each prompt which of them it showed, and what
became of every unit of the conversation: a reply with its results, or one other message.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from smartplay_tools.context.view import ranges_of
from smartplay_tools.errors import SENSELESS, InvalidArgumentError
from smartplay_tools.evaluation.analysis.formats import TextTable
from smartplay_tools.evaluation.analysis.threads import threads_table
from smartplay_tools.evaluation.pages.report.episode_reading import ShownEpisode, json_text
from smartplay_tools.evaluation.run_folder.folder import read_each
from smartplay_tools.manager.forms import FORMS, Content, MessageForm
from smartplay_tools.manager.record import RecordedPrompt, RecordedThread, read_thread
from smartplay_tools.records.threads import thread_row
from smartplay_tools.visible import visible

PARTS = {"tools": "tools and schema", "head": "head", "summary": "summary", "pinned": "pinned", "turns": "run of units"}
"""The parts of a prompt and their names, in the order in which they are drawn."""

STATES = (("masked", "marked"), ("trimmed", "cut"), ("elided", "cut"), ("cut", "cut"))
"""What became of a message, and how a unit with such a message is drawn; the first that holds."""


def shown_threads(files: Sequence[Path]) -> tuple[list[ShownEpisode], TextTable]:
    """Return threads in the form that a page needs, and their table."""
    threads = read_each(files, read_thread)
    rows = [thread_row(thread) for thread in threads]
    read = zip(threads, rows, strict=True)
    shown = [ShownEpisode(_facts(row), json_text(thread_data(thread, row)), None) for thread, row in read]
    return shown, threads_table(rows)


def _facts(row: Mapping[str, Any]) -> dict[str, Any]:
    """What the lists of a page say of a thread."""
    name, status = row["thread"], "over" if row["over"] else "finished"
    return {"key": name, "game": name, "run": "", "player": None, "seed": "", "status": status, "family": None}


def thread_data(thread: RecordedThread, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a thread in the form that the page's script reads."""
    form = FORMS[thread.prompts[-1].facts["form"] if thread.prompts else "chat"]
    return {
        **_facts(row),
        "protocol": "thread",
        "figures": row,
        "settings": dict(thread.settings),
        "budget": {"prompt_tokens": row["cap"]},
        "refusals": [dict(parts) for parts in thread.refusals],
        "parts": [_words(form, part) for part in thread.parts],
        "tools": [],
        "turns": [*_turns(thread)],
        "departures": None,
        "drawing": {},
        "check": {"prompts": len(thread.prompts), "differ": list(thread.differing)},
    }


def _turns(thread: RecordedThread) -> Iterator[dict[str, Any]]:
    """Yield the prompts, each as the turn to which it led; units that the prompt before has, too, are not repeated."""
    before: list[list[int]] = []
    for prompt in thread.prompts:
        facts = prompt.facts
        head, units = _units(prompt, str(thread.settings.get("head")))
        numbers = [[prompt.given_parts[at] for at in unit] for unit in units]
        differs = [one != other for one, other in zip(numbers, before, strict=False)]
        same = differs.index(True) if True in differs else len(differs)
        counts: Any = facts["parts"]
        view = {
            "tokens": facts["tokens"],
            "prefix_tokens": facts["prefix_tokens"],
            "cap": facts["cap"],
            "parts": [counts.get(name, 0) for name in PARTS],
            "reported": prompt.reported,
            "shown": ranges_of(prompt.sent_parts),
            "states": [(state, len([*own])) for state, own in groupby(_states(prompt, units))],
            "head": head,
            "same": same,
            "added": numbers[same:],
            "repaired": len(prompt.changed("repaired")) + facts["made"],
        }
        beside = [f"{name}: {visible(json_text(value))}" for name, value in prompt.beside.items()]
        yield {"view": view, "items": [], "beside": beside}
        before = numbers


def _units(prompt: RecordedPrompt, head: str) -> tuple[int, list[list[int]]]:
    """The number of messages in the head, and the messages of each unit after it, by their positions."""
    form, units = FORMS[prompt.facts["form"]], list[list[int]]()
    begin, before, replies = len(prompt.given), None, False
    for at, message in enumerate(prompt.given):
        kind = _kind(form, message)
        is_system = kind == "word" and message.get("role") in ("system", "developer")
        if not units and kind != "reply" and (is_system or (head != "system" and kind == "word")):
            continue
        begin = min(begin, at)
        goes_on = kind == "reply" and before == "reply" and form.name == "responses"
        if units and replies and (kind == "result" or goes_on):
            units[-1].append(at)
        else:
            units.append([at])
        replies, before = kind == "reply" or (replies and kind == "result"), kind
    return begin, units


def _kind(form: MessageForm, message: Mapping[str, Any]) -> str:
    try:
        return str(form.kind(message))
    except (InvalidArgumentError, *SENSELESS):
        return "word"


def _states(prompt: RecordedPrompt, units: Sequence[Sequence[int]]) -> list[str]:
    """What became of each unit."""
    gone = {*prompt.changed("dropped")}
    changed = [({*prompt.changed(change)}, state) for change, state in STATES]
    states = []
    for unit in units:
        if gone.issuperset(unit):
            states.append("dropped")
        else:
            states.append(next((state for numbers, state in changed if not numbers.isdisjoint(unit)), "seen"))
    return states


def _words(form: MessageForm, message: Any) -> dict[str, Any]:
    """A message in words, and as it was sent."""
    try:
        said = [*form.said(message)]
        texts = [text for each in said for text in _texts(each.content)]
        calls = [(visible(name), visible(arguments)) for each in said for name, arguments in each.calls]
        words = {"role": visible(said[0].role), "name": visible(said[0].name), "content": visible("\n".join(texts))}
    except (InvalidArgumentError, *SENSELESS):  # what stands beside the messages, or comes from a stranger
        return {"role": "part", "content": "", "sent": message}
    called = [{"function": {"name": name, "arguments": arguments}} for name, arguments in calls]
    return {**words, "tool_calls": called, "sent": message}


def _texts(content: Content) -> Iterator[str]:
    """The text of a content, and the types of its other parts."""
    if content.text:
        yield content.text
    for part in (*content.pictures, *content.closed):
        yield f"[{part.get('type')}]"
