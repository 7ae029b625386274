"""Keys that no header can hold and proxies that no client can read: one sentence, before anything is asked."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import smartplay_tools as sp

PLAYERS = ["openai:m", "openai-responses:m", "anthropic:m", "langchain:openai:m", "langchain:anthropic:m"]
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


@pytest.mark.parametrize("player", PLAYERS)
@pytest.mark.parametrize("key", KEYS)
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


@pytest.mark.parametrize("player", PLAYERS)
@pytest.mark.parametrize("key", [SECRET, f" {SECRET}", f"\t{SECRET}", "two words"])
def test_other_keys_are_sent_as_they_are(player, key):
    sp.get_player(player, base_url="http://127.0.0.1:9/v1", api_key=key).check_ready()


PROGRAM = """
import sys
import smartplay_tools as sp
try:
    with sp.Episode("Hanoi3Disk-v0", seed=7) as episode:
        player = sp.get_player(sys.argv[1], base_url="http://model.invalid/v1", api_key="k", retries=0)
        print(sp.play(episode, player).error)
except sp.InvalidArgumentError as error:
    print("InvalidArgumentError:", error)
"""


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
def test_a_proxy_that_a_client_cannot_read_is_named_and_not_printed(player, name, value):
    """Clients differ in what they can read; what they cannot is never their own error."""
    others = {key: kept for key, kept in os.environ.items() if not key.lower().endswith("_proxy")}
    command = [sys.executable, "-c", PROGRAM, player]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**others, name: value})
    (said,) = done.stdout.splitlines()
    if "Error: No reply from the model" not in said or "ConnectError" not in said:
        assert f"InvalidArgumentError: The client of this model cannot read the proxies of the environment, {name}" in (
            said
        ) or "Connection error" in said
    assert "password" not in done.stdout + done.stderr
