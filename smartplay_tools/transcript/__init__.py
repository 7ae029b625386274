"""The transcript of an episode: its events, the file that contains them, and the hashes that verify them."""

from smartplay_tools.files.times import keep_times, read_times
from smartplay_tools.transcript.events import EVENTS, FORMAT, Event, concerns_summary
from smartplay_tools.transcript.file import TranscriptWriter, read_transcript, write_records

__all__ = [
    "EVENTS",
    "FORMAT",
    "Event",
    "TranscriptWriter",
    "concerns_summary",
    "keep_times",
    "read_times",
    "read_transcript",
    "write_records",
]
