"""What keeps a reply from being played, in one sentence with its remedy: the texts of `check`."""

from __future__ import annotations

from collections.abc import Sequence

from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.records.rows import MORE_TOKENS, without_calls
from smartplay_tools.types import Reply
from smartplay_tools.types.arguments import value_in
from smartplay_tools.types.messages import FunctionCall, calls_of, reasoning_of, text_of


def fault_of(reply: Reply, conversation: Conversation, cap: int) -> str | None:
    """Return what was wrong with the reply of the latest turn; None if at least one of its calls was played."""
    calls, turn = calls_of(reply.message), conversation.latest_turn
    assert turn is not None
    results = {item.position: text_of(item.message) for item in turn.items if item.position is not None}
    error = conversation.episode.words("error", reason="")
    if calls and not all(text.startswith(error) for text in results.values()):
        return None
    text, reasoning = text_of(reply.message), reasoning_of(reply.message)
    if reply.usage is not None and reply.usage.cut:
        thought = ", in its reasoning" if reasoning or "<think>" in text else ""
        where = "within a call" if calls else f"before it called a tool{thought}"
        return f"was cut at its length of {cap} tokens {where}; {MORE_TOKENS}."
    if calls:
        names = [tool.name for tool in conversation.episode.tools]
        return _of_call(calls[0]["function"], names, results.get(0, "").removeprefix(error))
    if reasoning and not text.strip():
        return (
            f"has reasoned ({len(reasoning)} characters of reasoning_content) and then said nothing: raise "
            "--reply-tokens, or look at the reasoning parser of its server."
        )
    return f"{without_calls(text)}."


def _of_call(function: FunctionCall, names: Sequence[str], reason: str) -> str:
    name, arguments = function["name"], function["arguments"]
    if name not in names:
        like = next((own for own in names if name.endswith(own)), None)
        prefix = (
            f": its server's parser or chat template adds `{name.removesuffix(like)}`; use another --tool-call-parser"
            if like
            else "; look at its server's parser, or use another model"
        )
        return f"has called `{name}`, which is not a tool ({', '.join(names)}){prefix}."
    shown = arguments if len(arguments) <= 80 else f"{arguments[:77]}..."
    if value_in(arguments) is arguments:
        return (
            f"has called `{name}` with arguments that are not JSON ({shown}): use another --tool-call-parser, a model "
            "that is trained on tools, or a server with guided decoding."
        )
    why = " ".join(reason.split())[:120].rstrip()
    return (
        f"has called `{name}` with {shown}, which cannot be played ({why}): "
        "the model does not follow the tool's description; a larger model, or a lower temperature, may."
    )
