"""OpenTelemetry: every episode of this process as spans, under the conventions for generative AI.

    import smartplay_otel

    stop = smartplay_otel.instrument()

An episode is an `invoke_agent` span, with a `chat` span for every reply of the model and an `execute_tool` span for
every call. What was said is left out unless `content=True`. Results and records do not change. `trace_record` makes the
same spans afterwards, from a record whose times were kept.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_otel", "otel"):
    import opentelemetry.trace as _trace  # noqa: F401

from smartplay_otel.spans import instrument, trace_record

__all__ = ["instrument", "trace_record"]
