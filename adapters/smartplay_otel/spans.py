"""Spans from the events of an episode, made at the moments at which the events are recorded.

A `view` event is recorded when a prompt is ready, and the reply's `message` when it has come: between them is the
model's time. A `call` event is recorded when a call has been answered, after the event before it. The conventions are
those of OpenTelemetry for generative AI, which are still in development; a test compares the names used here with the
released ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from opentelemetry import trace
from opentelemetry.context import Context
from opentelemetry.trace import Span, SpanKind, Status, StatusCode, Tracer, TracerProvider

from smartplay_tools import Episode, EpisodeConfig, Usage
from smartplay_tools.episode import Listener, add_listener
from smartplay_tools.transcript import concerns_summary
from smartplay_tools.types.messages import calls_of

PROVIDERS = {"anthropic": "anthropic", "openai": "openai", "openai-responses": "openai"}
"""The provider by the name of the player that speaks to it, where the conventions have a name for it."""

FIGURES = ("end_reason", "score", "completed", "steps", "illegal_actions", "malformed_calls")
"""The fields of an episode's result that are attributes of its span."""


def instrument(tracer_provider: TracerProvider | None = None) -> Callable[[], None]:
    """Trace every episode that is made from now on in this process; return a function that stops this.

    Arguments:
        tracer_provider: where the spans go; the global provider if not given.

    The span of an episode is a child of the span that is current when it begins. Evaluations that run in worker
    processes are traced if `instrument` is called in those.
    """
    tracer = trace.get_tracer("smartplay_tools", tracer_provider=tracer_provider)

    def new_listener(episode: Episode) -> Listener:
        spans = _EpisodeSpans(tracer)
        return lambda event: spans.note(event, time.time_ns())

    return add_listener(new_listener)


VIEWED = ("turn", "prefix_tokens", "shown_steps", "dropped_turns")
"""The fields of a prompt's event that are attributes of the reply's span."""


class _EpisodeSpans:
    """The spans of one episode."""

    def __init__(self, tracer: Tracer) -> None:
        self._tracer = tracer
        self._root: Span | None = None
        self._context: Context | None = None
        self._chat: Span | None = None
        self._model = ""
        self._common: dict[str, str] = {}
        """The attributes of the span of the episode and of those of its replies."""
        self._is_heard = False
        """Whether the usage of a reply is to come."""
        self._ids: Sequence[str] = ()
        """The call ids of the latest reply."""
        self._latest = 0
        """When the latest event was recorded."""

    def note(self, event: Mapping[str, Any], now: int) -> None:
        """Take an event that was recorded at a time in nanoseconds."""
        match event["event"]:
            case "start":
                self._begin(event, now)
            case "view":
                self._ask(event, now)
            case "message" if event["by"] == "player":
                self._is_heard = True
                self._ids = event.get("ids") or [call["id"] for call in calls_of(event["message"])]
            case "usage":
                self._charge(event, now)
            case "call":
                self._execute(event, now)
            case "end":
                self._end(event, now)
        self._latest = now

    def _begin(self, start: Mapping[str, Any], now: int) -> None:
        config = EpisodeConfig.from_event(start)
        player = config.player or "host"
        name, _, model = player.partition(":")
        self._model = model or name
        self._common = {
            "gen_ai.provider.name": PROVIDERS.get(name, "smartplay"),
            "gen_ai.request.model": self._model,
            "gen_ai.conversation.id": config.key,
        }
        attributes: dict[str, Any] = {
            "gen_ai.operation.name": "invoke_agent",
            "gen_ai.agent.name": player,
            "smartplay.game": config.game,
            "smartplay.seed": config.seed,
            **self._common,
        }
        self._root = self._tracer.start_span(f"invoke_agent {player}", attributes=attributes, start_time=now)
        self._context = trace.set_span_in_context(self._root)

    def _ask(self, view: Mapping[str, Any], now: int) -> None:
        attributes: dict[str, Any] = {"gen_ai.operation.name": "chat", **self._common}
        attributes |= {f"smartplay.{name}": view[name] for name in VIEWED}
        attributes["smartplay.prompt_tokens"] = view["tokens"]
        if concerns_summary(view):
            attributes["smartplay.summary"] = True
        if view["max_tokens"] is not None:
            attributes["gen_ai.request.max_tokens"] = view["max_tokens"]
        self._is_heard = False
        self._chat = self._tracer.start_span(
            f"chat {self._model}", self._context, SpanKind.CLIENT, attributes=attributes, start_time=now
        )

    def _charge(self, usage: Mapping[str, Any], now: int) -> None:
        """End the chat span; the usage of a reply is recorded with it, and that of failed attempts without one."""
        if self._chat is None:
            return
        reported = Usage.reported(usage)
        counted = Usage(prompt=usage.get("prompt", 0), reply=usage.get("reply", 0)).replaced_by(reported)
        self._chat.set_attribute("gen_ai.usage.input_tokens", counted.prompt)
        self._chat.set_attribute("gen_ai.usage.output_tokens", counted.reply)
        if reported is not None:
            if reported.cached is not None:
                self._chat.set_attribute("gen_ai.usage.cache_read.input_tokens", reported.cached)
            self._chat.set_attribute("gen_ai.usage.cache_creation.input_tokens", reported.written)
            self._chat.set_attribute("gen_ai.usage.reasoning.output_tokens", reported.reasoning)
        if "reply" in usage:
            if self._is_heard:  # a summary is not a reply of the game
                is_cut = reported is not None and reported.cut > 0
                reason = "length" if is_cut else "tool_calls" if self._ids else "stop"
                self._chat.set_attribute("gen_ai.response.finish_reasons", [reason])
            self._chat.set_attribute("smartplay.reply_tokens", usage["reply"])
            self._chat.end(now)
            self._chat = None

    def _execute(self, event: Mapping[str, Any], now: int) -> None:
        attributes: dict[str, Any] = {
            "gen_ai.operation.name": "execute_tool",
            "gen_ai.tool.name": event["name"],
            "gen_ai.tool.type": "function",
            "smartplay.turn": event["turn"],
        }
        if event["position"] < len(self._ids):
            attributes["gen_ai.tool.call.id"] = self._ids[event["position"]]
        if event["is_error"]:
            attributes["error.type"] = str(event["data"].get("mistake", "error"))
        span = self._tracer.start_span(
            f"execute_tool {event['name']}", self._context, attributes=attributes, start_time=self._latest
        )
        if event["is_error"]:
            span.set_status(Status(StatusCode.ERROR))
        span.end(now)

    def _end(self, event: Mapping[str, Any], now: int) -> None:
        result = event["result"]
        failed = result["error"] is not None
        if self._chat is not None:
            # A prompt that no reply has answered.
            if failed:
                _fail(self._chat, result)
            self._chat.end(now)
            self._chat = None
        if self._root is None:
            return
        tokens = result["tokens"]
        reported = None if tokens["provider"] is None else Usage(**tokens["provider"])
        counted = Usage(prompt=tokens["prompt"], reply=tokens["reply"]).replaced_by(reported)
        self._root.set_attributes(
            {
                "gen_ai.usage.input_tokens": counted.prompt,
                "gen_ai.usage.output_tokens": counted.reply,
                **{f"smartplay.{name}": result[name] for name in FIGURES},
            }
        )
        for name in ("score", "normalized_score"):
            if result[name] is not None:
                figure = {"gen_ai.evaluation.name": name, "gen_ai.evaluation.score.value": float(result[name])}
                self._root.add_event("gen_ai.evaluation.result", figure, now)
        if failed:
            _fail(self._root, result)
        self._root.end(now)


def _fail(span: Span, result: Mapping[str, Any]) -> None:
    kind = str(result["error"]).partition(":")[0]
    span.set_attribute("error.type", kind)
    span.set_status(Status(StatusCode.ERROR, result["end_reason"]))
