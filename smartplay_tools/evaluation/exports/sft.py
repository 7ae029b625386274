"""Rows for supervised fine-tuning, in the columns that TRL's `SFTTrainer` and most other trainers read.

`sft` has a row for every reply: the prompt exactly as the model saw it, and the reply. This is the data for a model
that will play under the same budget. `sft-chains` has the same prompts and replies with less repetition: a row
continues while each prompt extends the previous one by its reply and what followed.

Columns of one name have one type in every row (Arrow needs that): arguments and tool schemas are JSON text, which
`SFTTrainer` reads. What a provider wanted back (`provider_items`) is left out.

With `pictures` a row has the column `images`, the paths of its pictures in their order, and every content is a list of
parts, where `{"type": "image"}` stands for the next of them: the form of TRL's data for vision models.

EpisodeSelection: which finished episodes of a run are exported, and how many are left out and why.

Training on everything that was played teaches a model its mistakes, too: most data sets keep the completed or the best
episodes. What is left out is counted by its reason, so that a data set says what it is a part of.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from smartplay_tools.episode import schema
from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.evaluation.run_folder.folder import records_in
from smartplay_tools.records.damage import warn_damaged
from smartplay_tools.records.prompts import SentPrompt
from smartplay_tools.records.record import Record
from smartplay_tools.records.replays import recorded_pictures
from smartplay_tools.records.rows import recorded_score
from smartplay_tools.types import Purpose, SampledTokens
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.messages import Message, pictures_of, text_of
from smartplay_tools.types.pictures import is_picture

FILE = "data.jsonl"
PICTURES = "pictures"
"""The folder of the pictures, whose names are their sha256."""

Row = dict[str, Any]


def write_replies(
    episodes: Iterable[Record], folder: Path, *, summaries: bool = False, pictures: bool = False
) -> dict[str, int]:
    """Write a row for every reply, and with `summaries` for every summary; return the number of episodes and rows.

    `pictures` are written as files, here and below, and counted.
    """
    return _write(folder, episodes, lambda episode: reply_rows(episode, summaries=summaries), pictures=pictures)


def write_chains(
    episodes: Iterable[Record], folder: Path, *, summaries: bool = False, pictures: bool = False
) -> dict[str, int]:
    """Write the rows of `chain_rows`; return the number of episodes, rows and replies."""
    return _write(folder, episodes, lambda episode: chain_rows(episode, summaries=summaries), pictures=pictures)


def reply_rows(episode: Record, *, summaries: bool = False) -> Iterator[Row]:
    """Yield a row for every reply of an episode: `prompt`, `completion`, `tools`, and the facts of the episode.

    With `summaries`, the replies to prompts for a summary have rows, too; `purpose` tells them apart. If the record has
    the tokens of any reply, every row has `completion_ids`, `completion_logprobs` and `prompt_ids`, None where unknown.
    """
    drawn, asked = episode.sampled, Counter[tuple[int, Purpose]]()
    for sent, prompt, reply in _steps(episode, summaries=summaries):
        asking = sent.turn, sent.prompt.purpose
        tokens = _token_columns(drawn.get((*asking, asked[asking]))) if drawn else {}
        asked[asking] += 1
        about = {**_facts(episode), "turn": sent.turn, "purpose": sent.prompt.purpose}
        yield {"prompt": prompt, "completion": [reply], **_tools(sent), **tokens, **about}


def chain_rows(episode: Record, *, summaries: bool = False) -> Iterator[Row]:
    """Yield rows in which every reply is trained on once: `prompt`, `completion`, `tools`, and the episode's facts.

    The assistant messages of `completion` are the replies, each after exactly the prompt to which it was given: all
    messages before it. Assistant messages of `prompt` are replies that an earlier row has.
    """
    if episode.config.context == "host":
        whole = episode.conversation
        messages, first = list(map(plain, whole.messages)), len(whole.head)
        yield _chain(episode, messages, first, {"tools": json.dumps(whole.tools)}, turn=0, replies=len(whole.turns))
        return
    messages, first, tools, turn, replies = [], 0, Row(), 0, 0
    for sent, prompt, reply in _steps(episode, summaries=summaries):
        if messages and (tools != _tools(sent) or prompt[: len(messages)] != messages):
            yield _chain(episode, messages, first, tools, turn=turn, replies=replies)
            messages = []
        if not messages:
            first, tools, turn, replies = len(prompt), _tools(sent), sent.turn, 0
        messages, replies = [*prompt, reply], replies + 1
    if messages:
        yield _chain(episode, messages, first, tools, turn=turn, replies=replies)


def _chain(episode: Record, messages: list[Row], first: int, tools: Row, *, turn: int, replies: int) -> Row:
    about = {**_facts(episode), "turn": turn, "replies": replies}
    return {"prompt": messages[:first], "completion": messages[first:], **tools, **about}


def plain(message: Message) -> Row:
    """Return a message with text as its content, its parts if it has pictures, and without a provider's own items."""
    kept = ("role", "name", "tool_calls", "tool_call_id", "reasoning_content")
    content = message["content"] if pictures_of(message) else text_of(message)
    return {**{name: message[name] for name in kept if name in message}, "content": content}  # type: ignore[literal-required]


def with_images(row: Row) -> Row:
    """Return a row whose contents are parts, with the column `images`: the paths of the pictures that they name."""
    images: list[str] = []

    def in_parts(message: Row) -> Row:
        content = message["content"]
        parts = [{"type": "text", "text": content}] if isinstance(content, str) else content
        images.extend(f"{PICTURES}/{part['sha256']}.png" for part in parts if is_picture(part))
        return {**message, "content": [{"type": "image"} if is_picture(part) else part for part in parts]}

    changed = {name: list(map(in_parts, row[name])) for name in ("prompt", "completion")}
    return {**row, **changed, "images": images}


def _steps(episode: Record, *, summaries: bool) -> Iterator[tuple[SentPrompt, list[Row], Row]]:
    """Yield every prompt, and its messages and the reply as a row has them."""
    if episode.config.context == "host":
        raise InvalidArgumentError(
            f"The host managed the context of {episode.name or 'the record'}, so its prompts are not recorded; "
            "export it as sft-chains."
        )
    for sent, reply in episode.answered:
        if summaries or sent.prompt.purpose == "play":
            yield sent, list(map(plain, sent.prompt.messages)), plain(reply)


def _token_columns(sampled: SampledTokens | None) -> Row:
    return {
        "prompt_ids": sampled and sampled.prompt,
        "completion_ids": sampled and sampled.reply,
        "completion_logprobs": sampled and sampled.logprobs,
    }


def _tools(sent: SentPrompt) -> Row:
    """The column with the schemas of the tools as JSON text; nothing where there are none."""
    tools = [{"type": "function", "function": schema(tool, "json")} for tool in sent.prompt.tools]
    return {"tools": json.dumps(tools)} if tools else {}


def _facts(episode: Record) -> Row:
    result = episode.result
    return {
        "game": result.game,
        "seed": result.seed,
        "player": episode.player,
        "score": float(result.score),
        "normalized_score": result.normalized_score,
        "completed": result.completed,
    }


def _write(
    folder: Path, episodes: Iterable[Record], rows_of: Callable[[Record], Iterator[Row]], *, pictures: bool
) -> dict[str, int]:
    counts = {"episodes": 0, "rows": 0, **({"pictures": 0} if pictures else {})}
    with (folder / FILE).open("x", encoding="utf-8", newline="\n") as file:
        for episode in episodes:
            counts["episodes"] += 1
            if pictures:
                counts["pictures"] += _write_pictures(folder / PICTURES, episode)
            for row in rows_of(episode):
                row = with_images(row) if pictures else row
                counts["rows"] += 1
                if "replies" in row:
                    counts["replies"] = counts.get("replies", 0) + row["replies"]
                file.write(json.dumps(row, ensure_ascii=False) + "\n")
    return counts


def _write_pictures(folder: Path, episode: Record) -> int:
    """Write the pictures that an episode showed and that are not there yet; return their number."""
    folder.mkdir(exist_ok=True)
    files = {folder / f"{name}.png": picture for name, picture in recorded_pictures(episode.events).items()}
    new = [file for file in files if not file.exists()]
    for file in new:
        file.write_bytes(files[file].png)
    return len(new)


class EpisodeSelection(BaseModel):
    """The episodes to export. By default all that are finished."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    games: tuple[str, ...] = ()
    """Only these settings; all if empty."""
    players: tuple[str, ...] = ()
    """Only these players; all if empty."""
    completed: bool = False
    """Only episodes whose game was completed."""
    min_score: float | None = None
    """Only episodes with at least this score, as means count it (`records.rows.mean_score`); `best` does, too."""
    min_normalized_score: float | None = None
    """Only episodes with at least this normalised score; settings without a human score have none."""
    best: int | None = Field(default=None, ge=1)
    """Only the best episodes of every game and player, this many; of equal scores, those of the lower seeds."""

    def choose(self, source: Path, *, pictures: bool = False) -> tuple[list[Path], Counter[str]]:
        """Return the records of the chosen episodes, in order, and the number of those left out by reason.

        Episodes whose observations are pictures are chosen with `pictures` only.
        """
        matching: list[tuple[Path, Record]] = []
        left_out: Counter[str] = Counter()
        for path in records_in(source):
            try:
                record = Record.head(path)
            except TranscriptError as error:
                warn_damaged(error)
                left_out["damaged"] += 1
                continue
            if record.start is None:
                continue  # not the record of an episode: a run's own files are JSON Lines, too
            reason = (
                self._reason_against(record, pictures=pictures) if record.outcome == "finished" else record.end_reason
            )
            if reason is None:
                matching.append((path, record))
            else:
                left_out[reason] += 1
        chosen = self._best(matching)
        left_out.update({"not among the best": len(matching) - len(chosen)} if len(chosen) < len(matching) else {})
        return [path for path, _ in chosen], left_out

    def _reason_against(self, record: Record, *, pictures: bool) -> str | None:
        result = record.result_data
        assert result is not None
        score, normalized = recorded_score(record), result["normalized_score"]
        if record.config.observation != "text" and not pictures:
            return "observations are pictures"
        if self.games and result["game"] not in self.games:
            return "another game"
        if self.players and record.player not in self.players:
            return "another player"
        if self.completed and not result["completed"]:
            return "not completed"
        if self.min_score is not None and score < self.min_score:
            return "score too low"
        if self.min_normalized_score is not None and (normalized is None or normalized < self.min_normalized_score):
            return "normalised score too low"
        return None

    def _best(self, matching: Sequence[tuple[Path, Record]]) -> list[tuple[Path, Record]]:
        if self.best is None:
            return list(matching)
        ordered = sorted(matching, key=lambda pair: (-recorded_score(pair[1]), pair[1].result.seed, pair[0]))
        groups = grouped(ordered, lambda pair: (pair[1].game, pair[1].player))
        kept = {path for group in groups.values() for path, _ in group[: self.best]}
        return [pair for pair in matching if pair[0] in kept]
