"""Keys that no header can hold and proxies that no client can read: one sentence, before anything is asked."""

from __future__ import annotations

import os

import pytest

import smartplay_tools as sp

OTHERS = ("openai-responses:m", "anthropic:m", "langchain:openai:m", "langchain:anthropic:m")
"""Players that repeat the first one, or whose libraries take seconds to import."""
PLAYERS = ["openai:m", *(pytest.param(each, marks=pytest.mark.slow) for each in OTHERS)]


def rows(*values):
    """Each value with the first player, and the first value with the others, who check in the same place."""
    slow = [pytest.param(each, values[0], marks=pytest.mark.slow) for each in OTHERS]
    return [*(("openai:m", value) for value in values), *slow]


SECRET = "sk-topsecret"

KEYS = {
    f"{SECRET}\n": "a line break",
    f"{SECRET}\r\n": "a line break",
    f"{SECRET[:5]}\n{SECRET[5:]}": "a line break",
    f"\n{SECRET}": "a line break",
    f"{SECRET}…": "U+2026",
    f"“{SECRET}”": "U+201C",
    f"{SECRET}é": "U+00E9",
    f"{SECRET}\xa0": "U+00A0",
    f"{SECRET}\x00": "U+0000",
    f"{SECRET} ": "a blank at its end",
}


@pytest.mark.parametrize(("player", "key"), rows(*KEYS))
def test_a_key_that_no_header_can_hold_is_refused_without_printing_it(player, key):
    with pytest.raises(sp.InvalidArgumentError, match="key of") as refused:
        sp.get_player(player, base_url="http://127.0.0.1:9/v1", api_key=key)
    said = str(refused.value)
    assert KEYS[key] in said
    assert "topsecret" not in said
    assert "\n" not in said
    assert refused.value.__cause__ is None


@pytest.mark.parametrize("player", PLAYERS)
def test_a_key_from_the_environment_is_checked_as_well(player, monkeypatch):
    for name in ("OPENAI_API_KEY", "ANTHROPIC_API_KEY"):
        monkeypatch.setenv(name, f"{SECRET}\n")
    with pytest.raises(sp.InvalidArgumentError, match="a line break"):
        sp.get_player(player, base_url="http://127.0.0.1:9/v1")


@pytest.mark.parametrize(("player", "key"), rows(f" {SECRET}", SECRET, f"\t{SECRET}", "two words"))
def test_other_keys_are_sent_as_they_are(player, key):
    sp.get_player(player, base_url="http://127.0.0.1:9/v1", api_key=key).check_ready()


@pytest.mark.filterwarnings("ignore")  # a client that could not be made complains when it is collected
@pytest.mark.parametrize("player", PLAYERS)
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("NO_PROXY", "localhost,::1/128"),
        ("NO_PROXY", "[::1]"),
        ("ALL_PROXY", "http://user:password@host:port"),
        ("HTTP_PROXY", "htp://user:password@host"),
    ],
)
def test_a_proxy_that_a_client_cannot_read_is_named_and_not_printed(player, name, value, monkeypatch):
    for other in os.environ:
        if other.lower().endswith("_proxy"):
            monkeypatch.delenv(other)
    monkeypatch.setenv(name, value)
    if name == "NO_PROXY" and "openai" in player:  # its client can read them
        sp.get_player(player, base_url="http://model.invalid/v1", api_key="k").check_ready()
        return
    with pytest.raises(sp.InvalidArgumentError, match=f"cannot read the proxies of the environment, {name}") as refused:
        # LangChain keeps the clients of an address.
        sp.get_player(player, base_url=f"http://{name.lower()}.invalid/v1", api_key="k").check_ready()
    assert "password" not in str(refused.value)
    # A server on this machine is asked without a proxy.
    if "langchain" not in player:
        sp.get_player(player, base_url="http://127.0.0.1:9/v1", api_key="k").check_ready()
