"""The players of OpenAI's two interfaces."""

from __future__ import annotations

from functools import partial

from smartplay_openai import OpenAIPlayer, ResponsesPlayer

import smartplay_tools as sp
from tests.adapters.conformance import Held, Play, Replies, Window, on_a_loop, waiting
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.situations import LOOP


def openai_player(
    episode: sp.Episode,
    script: Replies,
    *,
    play: Play,
    own_cap: int | None = None,
    situation: str = "",
    kind: type[OpenAIPlayer] = OpenAIPlayer,
    cap_field: str = "max_tokens",
) -> Held:
    with OpenAIStub(script) as stub:
        own = {} if own_cap is None else {cap_field: own_cap}
        play(episode, kind("m", base_url=stub.base_url, retries=0, parameters=own))
    return Held(stub.received)


responses_player = partial(openai_player, kind=ResponsesPlayer, cap_field="max_output_tokens")
row = partial(Window, through="OpenAI players", lacks=LOOP)
WINDOW = {
    "OpenAI player": row(partial(openai_player, play=waiting)),
    "OpenAI player, async": row(partial(openai_player, play=on_a_loop), slow=True, repeats=True),
    "OpenAI Responses player": row(partial(responses_player, play=waiting), repeats=True),
    "OpenAI Responses player, async": row(partial(responses_player, play=on_a_loop), slow=True, repeats=True),
}
