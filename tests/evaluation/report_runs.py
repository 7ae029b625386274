"""Records for tests of the replay page: games under tight budgets, and a model that writes what a page must not run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.games import GameSpec
from smartplay_tools.types.messages import function_call

BANDIT, RPS, HANOI = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"

HOSTILE = "</script><script>document.title='taken'</script><img src=x onerror=\"document.title='taken'\">"
"""A text that a model may write. Everywhere on the page it has to be shown as text and never run."""

UNREADABLE = "half a pair \ud800, a \u2028 separator, a \x00 and \U0001f3b0"


def record(
    path: Path, game: str, player: str = "rule", *, seed: int = 7, protocol: Any = "tools", **rules: Any
) -> Path:
    """Play an episode; arguments that are not rules of the episode are its budget."""
    own = {
        name: rules.pop(name) for name in ("manual", "batch", "engine", "text", "level", "observation") if name in rules
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with sp.Episode(game, seed=seed, budget=sp.Budget(**rules), transcript=path, **own) as episode:
        sp.play(episode, sp.get_player(player, seed=seed), protocol=protocol)
    return path


def known_for_now(monkeypatch: pytest.MonkeyPatch, spec: GameSpec) -> None:
    """Register a setting until the end of the test."""
    monkeypatch.setattr(sp.GAMES, "_specs", dict(sp.GAMES._specs))
    sp.register(spec)


def reply(*calls: tuple[str, str], content: Any = None, **more: Any) -> dict[str, Any]:
    """Return an assistant message with some tool calls, (name, arguments)."""
    listed = [function_call("same", *call) for call in calls]
    return {"role": "assistant", "content": content, **({"tool_calls": listed} if listed else {}), **more}


def act(action: str) -> tuple[str, str]:
    return "act", json.dumps({"action": action})


def converse(path: Path, game: str, replies: Sequence[dict[str, Any]], **options: Any) -> Path:
    """Play given replies to their end, and close the episode."""
    path.parent.mkdir(parents=True, exist_ok=True)
    name = options.pop("player", "script")
    with sp.Episode(game, seed=7, transcript=path, **options) as episode:
        conversation = sp.Conversation(episode, player=name)
        for message in replies:
            if conversation.prompt() is None:
                break
            conversation.receive(message)
    return path


def hostile(path: Path) -> Path:
    """An episode in which everything that a model or a user can name is hostile."""
    replies = [
        reply(act("1"), content=HOSTILE, reasoning_content=HOSTILE),
        reply((HOSTILE, HOSTILE), act(HOSTILE), ("act", HOSTILE)),
        reply(content=UNREADABLE + HOSTILE),
        reply(("read_manual", ""), provider_items=[{"type": "thinking", "thinking": HOSTILE}]),
        reply(act("2"), content=[{"type": "text", "text": HOSTILE}]),
    ]
    return converse(path, BANDIT, replies, player=HOSTILE)
