"""The prefix: how much of a view's beginning is the same as in the view before the latest turn.

A provider's prompt cache can serve that part; records and costs count its tokens. A message is the same if both views
have it in the same place, masked in both or in neither. The views after two consecutive turns are compared, even if one
of them was never sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import Head, Selection
from smartplay_tools.context.window_state import Contents
from smartplay_tools.types.messages import Message

SUMMARY = -1
"""Stands for the summary among the numbers of turns."""


def common_tokens(before: Contents, now: Contents, tools: int, counter: TokenCounter) -> int:
    """Return the tokens of tools and messages at the beginning of two neighbouring views that are the same."""
    shared, is_same = common_head(before.state.head, now.state.head, tools, counter)
    if not is_same:
        return shared
    return shared + _common_turns(before, now, counter)


def common_head(was: Head, head: Head, tools: int, counter: TokenCounter) -> tuple[int, bool]:
    """Return the tokens of tools and messages that two heads begin with, and whether they are the same head."""
    if head is was:
        return head.tokens - PRIMING, True
    if head.tools != was.tools:
        return 0, False
    pairs = zip(head.messages, was.messages, strict=False)
    return tools + counter.messages(message for message, _ in takewhile(_are_equal, pairs)), False


def _common_turns(before: Contents, now: Contents, counter: TokenCounter) -> int:
    """The tokens of the turns, and of the messages of the first turn that differs, that both views begin with."""
    chosen, chosen_before, shared = now.selection, before.selection, 0
    # Pinned turns are compared one by one; past them both views are runs of neighbours.
    pinned, pinned_before = _before_run(now), _before_run(before)
    most = max(len(pinned), len(pinned_before))
    for place in range(most):
        index, was = _at(chosen, pinned, place), _at(chosen_before, pinned_before, place)
        if index is None or index != was:
            return shared
        if index == SUMMARY:
            if now.summary is None or now.summary != before.summary:
                return shared
            shared += now.summary.tokens
            continue
        turn = now.state.index.turns[index]
        tokens, is_whole = common_messages(turn, chosen_before, chosen, counter)
        shared += tokens
        if not is_whole:
            return shared
    first, first_before = chosen.first + most - len(pinned), chosen_before.first + most - len(pinned_before)
    if first != first_before or first > min(chosen.last, chosen_before.last):
        return shared
    return shared + _common_run(before, now, first, counter)


def _common_run(before: Contents, now: Contents, first: int, counter: TokenCounter) -> int:
    """The tokens that two runs from a turn have in common, up to the first message that is shown in another way."""
    state, chosen, state_before, chosen_before = now.state, now.selection, before.state, before.selection
    stop = chosen_before.last + 1
    stripped = state.index.first_wordy(max(first, state_before.spoken), min(stop, state.spoken))
    if stripped is not None:
        stop = stripped  # its first message differs; before it, every reply is as it was
    # What is masked, or loses its picture, is between where these boundaries were and where they are.
    passed: list[int] = []
    if chosen.oldest != chosen_before.oldest:
        passed += range(max(first, state_before.boundary), min(stop, state.boundary + 1))
    if chosen.pictures != chosen_before.pictures:
        passed += range(max(first, state_before.pictured), min(stop, state.pictured + 1))
    for index in passed:
        if index < stop and _first_change(state.index.turns[index], chosen_before, chosen) is not None:
            stop = index
    if stop > chosen_before.last or stop == stripped:
        return state.run(first, stop)
    return state.run(first, stop) + common_messages(state.index.turns[stop], chosen_before, chosen, counter)[0]


def common_messages(turn: Turn, before: Selection, now: Selection, counter: TokenCounter) -> tuple[int, bool]:
    """The tokens of a turn's messages up to the first that two views show differently, and whether there is none."""
    changed = _first_change(turn, before, now)
    return counter.messages(now.seen(turn)[:changed]), changed is None


def _first_change(turn: Turn, before: Selection, now: Selection) -> int | None:
    """The first of a turn's messages that two views show differently: each form of one is its own object."""
    pairs = zip(before.seen(turn), now.seen(turn), strict=True)
    return next((at for at, (was, is_now) in enumerate(pairs) if was is not is_now), None)


def _before_run(contents: Contents) -> Sequence[int]:
    """The pinned turns before a run, and the summary where it stands."""
    chosen = contents.selection
    if contents.summary is None:
        return chosen.pinned
    return (*chosen.pinned[: chosen.front], SUMMARY, *chosen.pinned[chosen.front :])


def _at(chosen: Selection, pinned: Sequence[int], place: int) -> int | None:
    """The turn, or the summary, at a place of a selection; None past its end."""
    if place < len(pinned):
        return pinned[place]
    index = chosen.first + place - len(pinned)
    return index if index <= chosen.last else None


def _are_equal(pair: tuple[Message, Message]) -> bool:
    return pair[0] == pair[1]
