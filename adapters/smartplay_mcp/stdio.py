"""MCP on standard input and output: one process serves one game, and every message is a line."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from smartplay_tools import SmartPlayError
from smartplay_tools.streams import keep_streams, own_input, own_output
from smartplay_tools.web import HostedEpisode
from smartplay_tools.web.mcp import INTERNAL_ERROR, PARSE_ERROR, ProtocolError, respond

if TYPE_CHECKING:
    from smartplay_tools import Episode


MOMENT = 0.1
"""Seconds that a host gets to ask its first question before the game is loaded, which would delay the answer."""


async def serve_stdio(
    episode: Episode | Callable[[], Episode], *, reading: BinaryIO | None = None, writing: BinaryIO | None = None
) -> Episode:
    """Serve one episode on this process's standard input and output, or other files, until the input ends; return it.

    Messages are answered one after the other, in the order of arrival. An episode that is given as a function
    is made after the first answer, or a moment after the start: a host hears at once what the server is, and waits for
    the game when it asks for its tools.
    """
    with keep_streams():
        return await _serve(HostedEpisode(episode), reading or _standard_input(), writing or own_output().buffer)


async def _serve(hosted: HostedEpisode, reading: BinaryIO, writing: BinaryIO) -> Episode:
    lines = _lines(reading)
    has_answered = asyncio.Event()
    asyncio.get_running_loop().call_later(MOMENT, has_answered.set)
    making = asyncio.ensure_future(_made(hosted, has_answered))
    # What cannot be made ends the server, whether or not a client is writing.
    making.add_done_callback(lambda made: lines.put_nowait(None) if made.exception() else None)
    while (line := await lines.get()) is not None:
        if line.strip():
            answer = await _answer(hosted, line)
            if answer is not None:
                # ASCII, because a message may contain a lone surrogate, which UTF-8 cannot encode.
                writing.write(json.dumps(answer).encode("ascii") + b"\n")
                writing.flush()
                has_answered.set()
    has_answered.set()
    return await making


async def _made(hosted: HostedEpisode, when: asyncio.Event) -> Episode:
    await when.wait()
    return await hosted.ready()


def open_episode(game: str, *, transcript: Path | None, **settings: Any) -> Episode:
    """Return the episode of a transcript in its last state, or a new one if there is no such file.

    Hosts that start a new server for every session, or even for every call, can continue their game in this way.
    """
    from smartplay_tools import Episode, EpisodeConfig, InvalidArgumentError, read_transcript, resume
    from smartplay_tools.games import get_spec

    spec = get_spec(game)  # a record imports no file
    if transcript is None or not transcript.exists():
        return Episode(spec, transcript=transcript, context="host", **settings)
    recorded = EpisodeConfig.from_event(read_transcript(transcript)[0])
    if (recorded.game, recorded.seed) != (spec.id, settings["seed"]):
        raise InvalidArgumentError(
            f"{transcript} is the record of {recorded.game} with seed {recorded.seed}, not of {game} with seed "
            f"{settings['seed']}; name another file."
        )
    return resume(transcript, tokenizer=settings.get("tokenizer")).episode


async def _answer(hosted: HostedEpisode, line: bytes) -> Any:
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        return ProtocolError(PARSE_ERROR, "Each line is one JSON object.").body(None)
    try:
        return await respond(hosted, message)
    except SmartPlayError as error:  # the episode cannot be made, which also ends the server
        return ProtocolError(INTERNAL_ERROR, str(error)).body(message.get("id") if isinstance(message, dict) else None)


def _standard_input() -> BinaryIO:
    """Standard input with its own buffer: Python's would be locked by the reading thread, and abort the exit."""
    return open(own_input().fileno(), "rb", closefd=False)


def _lines(reading: Iterable[bytes]) -> asyncio.Queue[bytes | None]:
    """A queue of the lines, None at the end. The thread that reads is a daemon: nothing waits for a silent host."""
    queue: asyncio.Queue[bytes | None] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def put(line: bytes | None) -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(queue.put_nowait, line)

    def read() -> None:
        for line in reading:
            put(line)
        put(None)

    threading.Thread(target=read, name="standard input", daemon=True).start()
    return queue
