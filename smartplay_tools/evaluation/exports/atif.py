"""Trajectories in the Agent Trajectory Interchange Format (ATIF), one JSON file for every episode.

The format has a conversation, not what each prompt showed of it. That is in `extra.smartplay` of a step: the tokens of
its prompt, the ranges of turns that it showed, and its sha256. Records have no times, so steps have none.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from smartplay_tools.context.turns import Turn
from smartplay_tools.evaluation.run_folder.folder import as_list, read_notes
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import concerns_summary
from smartplay_tools.types import Usage
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import Call, Message, reasoning_of, text_of

SCHEMA = "ATIF-v1.7"
"""The version whose fields are written."""


def write_trajectories(episodes: Iterable[Record], folder: Path) -> dict[str, int]:
    """Write a trajectory for every episode; return the number of episodes and steps."""
    (folder / "trajectories").mkdir()
    counts = {"episodes": 0, "steps": 0}
    for episode in episodes:
        document = trajectory(episode)
        text = json.dumps(document, ensure_ascii=False, indent=1) + "\n"
        (folder / "trajectories" / f"{episode.name}.json").write_text(text, encoding="utf-8", newline="\n")
        counts["episodes"] += 1
        counts["steps"] += len(document["steps"])
    return counts


def trajectory(episode: Record) -> dict[str, Any]:
    """Return an episode as a trajectory."""
    result = episode.result
    steps = [{"step_id": number, **step} for number, step in enumerate(_steps(episode), start=1)]
    tokens = result.tokens
    return {
        "schema_version": SCHEMA,
        "session_id": episode.name,
        "agent": {
            "name": "smartplay-tools",
            "version": result.versions["smartplay-tools"],
            "model_name": episode.player,
            "tool_definitions": episode.conversation.tools,
        },
        "steps": steps,
        "final_metrics": {
            "total_prompt_tokens": tokens.prompt,
            "total_completion_tokens": tokens.reply,
            "total_steps": len(steps),
        },
        "extra": {"smartplay": _extra(episode)},
    }


def _extra(episode: Record) -> dict[str, Any]:
    """Configuration and result, and the notes of people about turns, if there are any."""
    facts = {"config": episode.config.to_json(), "result": episode.result.model_dump(mode="json")}
    notes = {} if episode.path is None else read_notes(episode.path)
    return {**facts, "notes": as_list(notes)} if notes else facts


def _steps(episode: Record) -> Iterator[dict[str, Any]]:
    views = {view["turn"]: view for view in episode.views if not concerns_summary(view)}
    for message in episode.conversation.head:
        yield _message_step(message)
    for turn in episode.conversation.turns:
        yield _reply(turn, episode.usage.get(turn.number, {}), views.get(turn.number, {}))
        for item in turn.items:
            if item.position is None:
                yield _message_step(item.message)


def _message_step(message: Message) -> dict[str, Any]:
    source = {"user": "user", "assistant": "agent"}.get(message["role"], "system")
    return {"source": source, "message": text_of(message)}


def _reply(turn: Turn, usage: Mapping[str, Any], view: Mapping[str, Any]) -> dict[str, Any]:
    step: dict[str, Any] = {"source": "agent", "message": text_of(turn.assistant)}
    if reasoning := reasoning_of(turn.assistant):
        step["reasoning_content"] = reasoning
    if turn.calls:
        step["tool_calls"] = [_call(call) for call in turn.calls]
        results = [(turn.calls[i.position].id, i.message) for i in turn.items if i.position is not None]
        step["observation"] = {
            "results": [{"source_call_id": call_id, "content": text_of(message)} for call_id, message in results]
        }
    if usage:
        step["metrics"] = {"prompt_tokens": usage["prompt"], "completion_tokens": usage["reply"]}
        if (reported := Usage.reported(usage)) is not None:
            if reported.cached is not None:
                step["metrics"]["cached_tokens"] = reported.cached
            step["metrics"]["extra"] = {"provider": usage["provider"]}
    shown = {name: view[name] for name in ("tokens", "turns", "masked", "shown_steps", "sha256") if name in view}
    step["extra"] = {"smartplay": {"turn": turn.number, "prompt": shown}}
    return step


def _call(call: Call) -> dict[str, Any]:
    """A call; arguments that are not an object do not fit the format, so their text is kept beside the call."""
    written: dict[str, Any] = {"tool_call_id": call.id, "function_name": call.name}
    arguments = object_in(call.arguments.text or "{}")
    if arguments is not None:
        return {**written, "arguments": arguments}
    return {**written, "arguments": {}, "extra": {"sent": call.arguments.text}}
