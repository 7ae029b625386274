"""The player of Anthropic's interface."""

from __future__ import annotations

from functools import partial

from smartplay_anthropic import AnthropicPlayer

import smartplay_tools as sp
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import Held, Play, Replies, Window, on_a_loop, waiting
from tests.adapters.situations import LOOP


def anthropic_player(
    episode: sp.Episode, script: Replies, *, play: Play, own_cap: int | None = None, situation: str = ""
) -> Held:
    with AnthropicStub(script) as stub:
        own = {} if own_cap is None else {"max_tokens": own_cap}
        play(episode, AnthropicPlayer("m", base_url=stub.url, retries=0, parameters=own))
    return Held(stub.received)


row = partial(Window, through="Anthropic player", broken_json=False, lacks=LOOP)
WINDOW = {
    "Anthropic player": row(partial(anthropic_player, play=waiting)),
    "Anthropic player, async": row(partial(anthropic_player, play=on_a_loop), slow=True, repeats=True),
}
