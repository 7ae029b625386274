"""Finished episodes as logs of Inspect's, for `inspect view` and Inspect's data frames: `smartplay-tools export`.

A log has the episodes of one game and player under one budget. Every prompt is an event of the model, exactly as it
was sent. Records have no times, so the times in a log are those of the export.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from inspect_ai.event import ModelEvent
from inspect_ai.log import (
    EvalConfig,
    EvalDataset,
    EvalLog,
    EvalMetric,
    EvalPlan,
    EvalResults,
    EvalSample,
    EvalScore,
    EvalSpec,
    EvalStats,
    write_eval_log,
)
from inspect_ai.model import (
    ChatCompletionChoice,
    ChatMessageAssistant,
    GenerateConfig,
    ModelOutput,
    ModelUsage,
)
from inspect_ai.scorer import Score

from smartplay_inspect.messages import InspectChat, tool_infos
from smartplay_inspect.scorer import score_of
from smartplay_tools import ToolSpec
from smartplay_tools.records import Record


def write_logs(episodes: Iterable[Record], folder: Path) -> dict[str, int]:
    """Write a log for every game, player and budget; return the number of episodes and logs."""
    groups: dict[str, list[EvalSample]] = {}
    for episode in episodes:
        cell = episode.config.model_copy(update={"seed": 0}).digest
        player = re.sub(r"[^\w.-]", "-", episode.player)  # a model's name may have characters that a file's cannot
        groups.setdefault(f"{episode.result.game}.{player}.{cell}", []).append(_sample(episode))
    for name, samples in sorted(groups.items()):
        write_eval_log(_log(samples), str(folder / f"{name}.eval"))
    return {"episodes": sum(map(len, groups.values())), "logs": len(groups)}


def _log(samples: list[EvalSample]) -> EvalLog:
    now = datetime.now(UTC).isoformat()
    config = (samples[0].metadata or {})["config"]
    ids = [sample.id for sample in samples]
    return EvalLog(
        status="success",
        eval=EvalSpec(
            created=now,
            task="smartplay",
            dataset=EvalDataset(name=config["game"], samples=len(samples), sample_ids=ids),
            model=_model(config.get("player")),
            config=EvalConfig(),
            metadata={"config": {key: value for key, value in config.items() if key != "seed"}},
        ),
        plan=EvalPlan(),
        results=EvalResults(total_samples=len(samples), completed_samples=len(samples), scores=_means(samples)),
        stats=EvalStats(started_at=now, completed_at=now),
        samples=samples,
    )


def _sample(episode: Record) -> EvalSample:
    chat = InspectChat(_model(episode.player))
    tools = tool_infos(ToolSpec(**tool["function"]) for tool in episode.conversation.tools)
    events = []
    for sent in episode.prompts:
        output = _output(episode, chat, sent.turn)
        events.append(
            ModelEvent(
                model=_model(episode.player),
                input=chat.write(sent.prompt.messages),
                tools=tools,
                tool_choice="auto",
                config=GenerateConfig(max_tokens=sent.prompt.max_tokens),
                output=output,
            )
        )
    return EvalSample(
        id=f"{episode.result.game}-{episode.result.seed}",
        epoch=1,
        input=f"Play {episode.result.game}, seed {episode.result.seed}.",
        target="",
        messages=chat.write(episode.conversation.messages),
        output=events[-1].output if events else ModelOutput(),
        scores={"smartplay_scorer": score_of(episode.result)},
        metadata={"game": episode.result.game, "seed": episode.result.seed, "config": episode.config.to_json()},
        events=list(events),
    )


def _output(episode: Record, chat: InspectChat, turn: int) -> ModelOutput:
    (message,) = chat.write([episode.turns[turn].assistant])
    assert isinstance(message, ChatMessageAssistant)
    usage = episode.usage[turn]
    return ModelOutput(
        model=_model(episode.player),
        choices=[ChatCompletionChoice(message=message, stop_reason="tool_calls" if message.tool_calls else "stop")],
        usage=ModelUsage(
            input_tokens=usage["prompt"], output_tokens=usage["reply"], total_tokens=usage["prompt"] + usage["reply"]
        ),
    )


def _means(samples: list[EvalSample]) -> list[EvalScore]:
    values: dict[str, list[float]] = {}
    for sample in samples:
        (score,) = (sample.scores or {}).values()
        for name, value in _plain(score).items():
            values.setdefault(name, []).append(value)
    return [
        EvalScore(
            name=name,
            scorer="smartplay_scorer",
            metrics={"mean": EvalMetric(name="mean", value=sum(scores) / len(scores))},
        )
        for name, scores in values.items()
    ]


def _plain(score: Score) -> dict[str, float]:
    assert isinstance(score.value, dict)
    return {name: float(value) for name, value in score.value.items() if value == value and value is not None}


def _model(player: str | None) -> str:
    return f"smartplay/{player}"
