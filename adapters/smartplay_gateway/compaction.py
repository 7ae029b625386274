"""Edits and compactions at the endpoints: what a request asks its provider for is done here, as the provider would.

Edits that clear are applied to the messages before these are fitted. Then a summary by the model stands in the place of
a conversation: Anthropic's `compact_20260112` and `compaction` of Messages, and OpenAI's `compaction` and
`/responses/compact` of Responses, with any model behind the endpoint. The endpoint keeps nothing: the summary is in the
answer, as an item or a block that clients send back and that is read here. A provider's own item, which is not, stays
as it is, and the compaction of its conversation stays with the provider. docs/provider-edits.md has the definitions,
and what we chose.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import math
import uuid
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from smartplay_gateway.answers import Report
from smartplay_gateway.surfaces import COMPACT, Json, Surface
from smartplay_tools import ContextManager, InvalidArgumentError, PromptOverflowError
from smartplay_tools.compactors.provider_edits import (
    SUMMARY,
    ClearThinking,
    Compact,
    OpenAICompaction,
    applied,
    clearing_edits,
    summary_in,
)
from smartplay_tools.players.wire import RequestError
from smartplay_tools.types.arguments import object_in

FIELD = "context_management"
EDITS_BETA, THRESHOLD_BETA, DEMAND_BETA = "context-management-2025-06-27", "compact-2026-01-12", "compact-2026-09-04"

MARK = "smartplay-tools:"
"""How the content of our items, and the signature of our blocks, begins."""

LONGEST = 4_096
"""The most tokens of a summary in Responses, where a request may have no cap."""

LONGEST_INSTRUCTIONS = 16_384
"""Characters of the instructions of `compaction`, as its definition says."""

NOT_ASKED = ("stream", "stream_options", "background", "stop_sequences", "output_format", FIELD, "compaction")
"""Fields of a request that a question for a summary does not have."""

Kind = Literal["threshold", "pause", "summarize", "trigger", "compact"]
"""Above a threshold, without or with a pause; or at once, by Messages, by an item of Responses, or by its path."""


class _Summary(dict[str, Any]):
    """The message with a summary of ours; a user's message may begin with the same text."""


refused = partial(RequestError, 400)
"""A request that the provider would refuse, with the field that is wrong, or its own code of the error."""

Ask = Callable[[Json], Awaitable[Json]]
"""Asks the model: a request whose prompt has been fitted, and the answer."""


@dataclass(frozen=True)
class Managed:
    """What the management that a request asks for has made of it."""

    body: Json
    """The request, managed."""
    report: Report | None = None
    """What its answer says of that; None if there is nothing to say."""
    answer: Json | None = None
    """The whole answer, where nothing is left to ask."""


def is_managed(body: Json, surface: Surface) -> bool:
    """Whether a request asks for a compaction, or holds what one has left."""
    messages = surface.conversation(body) or []
    has_trigger = bool(messages) and _type(messages[-1]) == "compaction_trigger"
    return body.get(FIELD) is not None or has_trigger or any(_compactions(messages))


async def managed(body: Json, surface: Surface, betas: str, manager: ContextManager, ask: Ask) -> Managed:
    """Return a request after the edits and the compaction that it asks for.

    `betas` is the header `anthropic-beta`. What the provider would refuse raises, and so does a compaction without a
    summary where nothing else is asked for.
    """

    def read() -> tuple[Json, list[Json] | None, Wish | None]:
        given, edits = opened(body, surface, betas), None
        if surface.form == "anthropic" and surface.conversation(given) is not None:
            given, edits = _cleared(given, surface, betas, manager)
        rest, wish = wish_of(given, surface, betas)
        return rest, edits, wish

    asked, edits, wish = await asyncio.to_thread(read)
    done = None if wish is None else await compacted(wish, asked, manager, ask)
    if done is not None and done.report is not None:
        done.report.edits = edits
        return done
    return Managed(asked, None if edits is None else Report(surface.form, edits))


def _cleared(body: Json, surface: Surface, betas: str, manager: ContextManager) -> tuple[Json, list[Json] | None]:
    """Return a request without the edits that clear, applied, and what they cleared; None if it asks for none."""
    if (wanted := body.get(FIELD)) is None:
        return body, None
    given = wanted.get("edits", []) if isinstance(wanted, Mapping) else None
    if not (edits := clearing_edits(given, Compact.name)):
        return body, None
    if EDITS_BETA not in _names(betas):
        raise refused(f"{FIELD}: Extra inputs are not permitted without the beta {EDITS_BETA}.")
    thinking = body.get("thinking")
    is_thinking = isinstance(thinking, Mapping) and thinking.get("type") in ("enabled", "adaptive")
    if isinstance(edits[0], ClearThinking) and not is_thinking:
        raise refused(f"`{ClearThinking.name}` strategy requires `thinking` to be enabled.")
    if not all(isinstance(message, Mapping) for message in body["messages"]):
        return body, None  # the upstream says what is wrong with it
    made, reports = applied(edits, body["messages"], lambda messages: surface.count(body, messages, manager))
    edited = {name: value for name, value in body.items() if name != FIELD} | {"messages": made}
    rest = [edit for edit in given or () if edit["type"] == Compact.name]
    return edited | ({FIELD: {**wanted, "edits": rest}} if rest else {}), reports


@dataclass(frozen=True)
class Wish:
    """The compaction that a request asks for."""

    surface: Surface
    rule: Compact
    kind: Kind

    @property
    def is_now(self) -> bool:
        """Whether it does not wait for a threshold."""
        return self.kind not in ("threshold", "pause")

    def question(self, body: Json) -> Json:
        """Return the request that asks for the summary."""
        asked = {name: value for name, value in body.items() if name not in NOT_ASKED}
        own = {"role": "user", "content": self.rule.instructions}
        for holder in ("text", "output_config"):
            if isinstance(value := asked.get(holder), Mapping):
                asked[holder] = {name: each for name, each in value.items() if name != "format"}
        if self.surface.form == "responses":
            given = body.get("max_output_tokens")
            asked["max_output_tokens"] = min(given, LONGEST) if type(given) is int else LONGEST
            own["type"] = "message"
        if body.get("tools"):
            asked["tool_choice"] = "none" if self.surface.form == "responses" else {"type": "none"}
        return {**asked, self.surface.messages: [*(self.surface.conversation(body) or ()), own]}

    def kept(self, body: Json) -> list[Any]:
        """Return the messages that stay word for word in front of the summary."""
        if not self.rule.keeps_words_of_users:
            return []
        items = (item for item in self.surface.conversation(body) or () if isinstance(item, Mapping))
        words = [item for item in items if item.get("role") in ("user", "system", "developer")]
        return [item for item in words if not isinstance(item, _Summary)]

    def shown(self, body: Json, summary: str | None) -> Json | None:
        """Return the item or the block with a summary."""
        if self.surface.form == "responses":
            content = json.dumps({"kept": self.kept(body), "summary": summary}, ensure_ascii=False)
            own = {"id": f"cmp_{uuid.uuid4().hex}", "type": "compaction", "encrypted_content": MARK + content}
            return None if summary is None else own
        if self.kind == "summarize":
            return None if summary is None else {**_block(summary), "signature": _signature(summary)}
        return _block(summary)  # without a summary its content is null


def opened(body: Json, surface: Surface, betas: str) -> Json:
    """Return a request with the newest compaction that can be read here as words, without what stood before it."""
    messages = surface.conversation(body)
    if messages is None or surface.form == "chat":
        return body
    made = _opened_items(messages) if surface.form == "responses" else _opened_blocks(messages, _names(betas))
    return body if made is messages else {**body, surface.messages: made}


def _opened_items(items: list[Any]) -> list[Any]:
    texts = {at: str(block.get("encrypted_content")) for at, _, block in _compactions(items)}
    at = next((at for at in reversed(texts) if texts[at].startswith(MARK)), None)
    if at is None:
        return items
    held = object_in(texts[at].removeprefix(MARK)) or {}
    kept, summary = held.get("kept"), held.get("summary")
    if not (isinstance(summary, str) and isinstance(kept, list) and all(isinstance(each, Mapping) for each in kept)):
        problem = f"The encrypted content of input[{at}] could not be verified; send the item as it came."
        raise refused(problem, param=f"input[{at}]", code="invalid_encrypted_content")
    own = _Summary(type="message", role="user", content=SUMMARY + summary)
    return [*kept, own, *items[at + 1 :]]


def _opened_blocks(messages: list[Any], betas: Sequence[str]) -> list[Any]:
    found = [*_compactions(messages)]
    ours = [(at, index, block) for at, index, block in found if block.get("content") is None or _is_read(block)]
    if not ours:
        return messages
    first = ours[0]
    if DEMAND_BETA not in betas and (THRESHOLD_BETA not in betas or any(each[2].get("signature") for each in ours)):
        raise refused(f"messages.{first[0]}.content.{first[1]}: Input tag 'compaction' is not expected here.")
    full = [each for each in ours if each[2].get("content") is not None]
    if any(block.get("signature") for _, _, block in full):
        if len([each for each in found if each[2].get("content") is not None]) > 1:
            raise refused("Send only the newest `compaction` block.", code="compaction_block_ambiguous")
        if full[0][:2] != (0, 0):
            raise refused("The `compaction` block has to come first.", code="compaction_block_misplaced")
        if full[0][2]["signature"] != _signature(full[0][2]["content"]):
            raise refused("`content` differs from what was signed.", code="compaction_content_mismatch")
    at, index, newest = full[-1] if full else (0, -1, {})
    made: list[Any] = [{"role": "user", "content": SUMMARY + newest["content"]}] if full else []
    for number in range(at, len(messages)):
        message = messages[number]
        if isinstance(message, Mapping) and isinstance(blocks := message.get("content"), list):
            left = [block for block in blocks[index + 1 if number == at else 0 :] if not _is_failed(block)]
            message = message if left == blocks else {**message, "content": left} if left else None
        made += [] if message is None else [message]
    return made


def wish_of(body: Json, surface: Surface, betas: str) -> tuple[Json, Wish | None]:
    """Return a request without the compaction that it asks for, and this; what a provider would refuse raises."""
    messages = surface.conversation(body)
    if messages is None or surface.form == "chat":
        return body, None
    if surface.form == "responses":
        asked, rest = _asked_of_responses(body, surface)
    else:
        asked, rest = _asked_of_messages(body, surface, betas)
    if asked is None or any(_compactions(messages)):
        return body, None
    return rest, asked


def _asked_of_responses(body: Json, surface: Surface) -> tuple[Wish | None, Json]:
    items = surface.conversation(body) or []
    triggers = [at for at, item in enumerate(items) if _type(item) == "compaction_trigger"]
    rest = {name: value for name, value in body.items() if name != FIELD}
    if triggers:
        if triggers != [len(items) - 1]:
            raise refused("A compaction_trigger must be the final input item.", param=f"input[{triggers[0]}]")
        rest[surface.messages] = items[:-1]
    entries = body.get(FIELD)
    if surface is COMPACT or triggers:
        return Wish(surface, OpenAICompaction(1), "compact" if surface is COMPACT else "trigger"), rest
    if entries is None or entries == []:
        return None, rest
    if not isinstance(entries, list) or len(entries) != 1 or not isinstance(entries[0], Mapping):
        raise refused("context_management is a list with one entry.", param=FIELD, code="invalid_value")
    entry, param = entries[0], f"{FIELD}[0]"
    if entry.get("type") != "compaction":
        problem = f"Invalid value: {entry.get('type')!r}. Supported values are: 'compaction'."
        raise refused(problem, param=f"{param}.type", code="invalid_value")
    if unknown := set(entry) - {"type", "compact_threshold"}:
        raise refused(f"Unknown parameter: {sorted(unknown)[0]!r}.", param=param, code="unknown_parameter")
    try:
        return Wish(surface, OpenAICompaction(entry.get("compact_threshold")), "threshold"), rest
    except InvalidArgumentError as error:
        raise refused(str(error), param=f"{param}.compact_threshold", code="invalid_value") from None


def _asked_of_messages(body: Json, surface: Surface, betas: str) -> tuple[Wish | None, Json]:
    rest = {name: value for name, value in body.items() if name not in (FIELD, "compaction")}
    if body.get("compaction") is not None:
        return Wish(surface, _on_demand(body, surface, _names(betas)), "summarize"), rest
    edits = [edit for edit in (body.get(FIELD) or {}).get("edits") or () if edit.get("type") == Compact.name]
    if not edits:
        return None, body
    if THRESHOLD_BETA not in _names(betas):
        raise refused(f"{FIELD}.edits.0: requires anthropic-beta: {THRESHOLD_BETA}.")
    if len(edits) > 1:
        raise refused(f"{FIELD}.edits: only one edit of a type is permitted.")
    options = {name: value for name, value in edits[0].items() if name != "type"}
    pauses = options.pop("pause_after_compaction", False)
    if unknown := set(options) - {"trigger", "instructions"}:
        raise refused(f"{FIELD}.edits.0.{sorted(unknown)[0]}: Extra inputs are not permitted.")
    if not isinstance(pauses, bool):
        raise refused(f"{FIELD}.edits.0.pause_after_compaction: Input should be a valid boolean.")
    if options.get("trigger", 0) is None:
        del options["trigger"]
    try:
        return Wish(surface, Compact(**options), "pause" if pauses else "threshold"), rest
    except InvalidArgumentError as error:
        raise refused(f"{FIELD}.edits.0: {error}") from None


def _on_demand(body: Json, surface: Surface, betas: Sequence[str]) -> Compact:
    """The rule of a request that asks for a summary now."""
    wanted = body["compaction"]
    if DEMAND_BETA not in betas:
        raise refused(f"compaction: requires anthropic-beta: {DEMAND_BETA}.")
    if not isinstance(wanted, Mapping) or wanted.get("type") != "summarize":
        raise refused("compaction: Input should be an object of the type 'summarize'.")
    if unknown := set(wanted) - {"type", "instructions"}:
        raise refused(f"compaction.{sorted(unknown)[0]}: Extra inputs are not permitted.")
    instructions, config, choice = wanted.get("instructions"), body.get("output_config"), body.get("tool_choice")
    if instructions is not None and not isinstance(instructions, str):
        raise refused("compaction.instructions: Input should be a valid string.")
    if len(instructions or "") > LONGEST_INSTRUCTIONS:
        raise refused(f"compaction.instructions: at most {LONGEST_INSTRUCTIONS} characters.")
    others = {
        FIELD: body.get(FIELD),
        "stop_sequences": body.get("stop_sequences"),
        "output_config.format": isinstance(config, Mapping) and config.get("format"),
        "output_format": body.get("output_format"),
        "tool_choice": isinstance(choice, Mapping) and choice.get("type") in ("any", "tool"),
    }
    for name, value in others.items():
        if value:
            raise refused(f"{name}: cannot be combined with `compaction`.")
    messages = [each for each in surface.conversation(body) or () if isinstance(each, Mapping)]
    if not any(each.get("content") for each in messages if each.get("role") in ("user", "assistant")):
        raise refused("`messages` holds nothing to summarize.", code="compaction_nothing_to_summarize")
    last = messages[-1]
    if last.get("role") == "assistant" and any(_type(each) == "tool_use" for each in _parts(last)):
        raise refused("Send the results of the last tool calls first.", code="compaction_incomplete_turn")
    return Compact(1, instructions if instructions and instructions.strip() else None)


async def compacted(wish: Wish, body: Json, manager: ContextManager, ask: Ask) -> Managed | None:
    """Return what a compaction makes of a request; None if it is not due."""
    surface, cap = wish.surface, manager.prompt_tokens
    given = surface.conversation(body) or []
    tokens = await asyncio.to_thread(surface.count, body, given, manager)
    if not wish.is_now and tokens <= wish.rule.trigger:
        return None
    field, kept = surface.messages, wish.kept(body)

    def standing(summary: str) -> list[Any]:
        own = {"role": "user", "content": SUMMARY + summary}
        return [*kept, own | ({"type": "message"} if surface.form == "responses" else {})]

    def size(summary: str) -> int:
        """The tokens of what would stand in the place of the conversation."""
        return surface.count(body, standing(summary), manager)

    least = await asyncio.to_thread(size, "")
    if cap is not None and least > cap and wish.is_now and kept:
        raise refused(
            f"A compaction keeps the words of users, which take {least:,} of {cap:,} tokens; nothing was asked.",
            param=field,
        )
    if not wish.is_now and least > min(wish.rule.trigger, math.inf if cap is None else cap):
        return None
    try:
        answer = await ask(wish.question(body))
    except PromptOverflowError:
        if wish.is_now:
            raise
        return None
    summary, stop = read_summary(surface.form, answer)
    if summary is not None and not wish.is_now and cap is not None and await asyncio.to_thread(size, summary) > cap:
        summary = None
    if summary is None and wish.kind in ("trigger", "compact"):
        raise RequestError(500, f"The model gave no summary; its answer ended with {stop!r}.", code="no_summary")
    ends = None
    if wish.is_now:
        ends = "compaction" if summary is not None else stop or "end_turn"
    elif wish.kind == "pause":
        ends = "compaction"
    report = Report(surface.form, None, wish.shown(body, summary), answer.get("usage"), is_alone=ends is not None)
    if wish.kind == "compact":
        return Managed(body, report, report.compacted_response([item for item in kept if item["role"] == "user"]))
    whole = None if ends is None else report.empty(body.get("model"), ends)
    return Managed(body if summary is None else {**body, field: standing(summary)}, report, whole)


def read_summary(form: str, answer: Json) -> tuple[str | None, str]:
    """Return the summary in an answer, None if it did not end with words, and why it ended."""
    if form == "responses":
        output = [item for item in answer.get("output") or () if isinstance(item, Mapping)]
        parts = [part for item in output if item.get("type") == "message" for part in _parts(item)]
        stop, calls = str(answer.get("status", "completed")), [i for i in output if _type(i).endswith("_call")]
    else:
        parts = _parts(answer)
        stop, calls = str(answer.get("stop_reason")), [part for part in parts if _type(part) == "tool_use"]
    texts = [part.get("text") for part in parts if _type(part) in ("text", "output_text")]
    summary = summary_in("".join(text for text in texts if isinstance(text, str)))
    ended = not calls and stop in ("completed", "end_turn", "stop_sequence", "None")
    return (summary if summary and ended else None), stop


def _compactions(messages: Sequence[Any]) -> Iterator[tuple[int, int, Mapping[str, Any]]]:
    """Items and blocks that a compaction has left, with the numbers of their messages and blocks."""
    for at, message in enumerate(messages):
        if isinstance(message, Mapping):
            places = [(-1, message), *enumerate(_parts(message))]
            yield from ((at, index, part) for index, part in places if _type(part) == "compaction")


def _is_read(block: Mapping[str, Any]) -> bool:
    """Whether a block has all it says in words, or was signed here; other signatures are a provider's."""
    seals = [str(block[name]) for name in ("signature", "encrypted_content") if block.get(name)]
    return isinstance(block.get("content"), str) and all(seal.startswith(MARK) for seal in seals)


def _is_failed(block: Any) -> bool:
    """Whether a block is the null one of a compaction that failed, which stands for nothing."""
    return _type(block) == "compaction" and block.get("content") is None


def _block(summary: str | None) -> Json:
    return {"type": "compaction", "content": summary}


def _signature(summary: str) -> str:
    return MARK + hashlib.sha256(summary.encode("utf-8", "surrogatepass")).hexdigest()


def _type(part: Any) -> str:
    return str(part.get("type")) if isinstance(part, Mapping) else ""


def _parts(message: Mapping[str, Any]) -> list[Any]:
    content = message.get("content")
    return [part for part in content if isinstance(part, Mapping)] if isinstance(content, list) else []


def _names(betas: str) -> list[str]:
    return [name.strip() for name in betas.split(",")]
