"""OpenTelemetry: every episode of this process as spans, under the conventions for generative AI.

    import smartplay_otel

    stop = smartplay_otel.instrument()

An episode is an `invoke_agent` span, with a `chat` span for every reply of the model and an `execute_tool` span for
every call. What was said is in the record, not in the spans. Results and records do not change.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_otel", "otel"):
    import opentelemetry.trace as _trace  # noqa: F401

from smartplay_otel.spans import instrument

__all__ = ["instrument"]
