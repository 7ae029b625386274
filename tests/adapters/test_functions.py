"""Plain functions: `Episode.functions()` in frameworks that take annotated callables, where these are installed."""

from __future__ import annotations

import pytest

import smartplay_tools as sp

# These frameworks warn while they are imported; what they warn of is theirs.
pytestmark = pytest.mark.filterwarnings("ignore")


def episode() -> sp.Episode:
    return sp.Episode("RockPaperScissorBasic-v0", seed=1, context="host")


def test_smolagents():
    smolagents = pytest.importorskip("smolagents", exc_type=ImportError)
    with episode() as played:
        observe, act, read_manual = (smolagents.tool(function) for function in played.functions())
        assert act.inputs["action"]["type"] == "string"
        assert "Rock" in act.description
        assert act(action="Rock").startswith("You chose Rock")
        assert "You chose Rock" in observe()
        assert read_manual() == played.game.manual
    assert played.result.tool_calls == 3


def test_llama_index():
    tools = pytest.importorskip("llama_index.core.tools", exc_type=ImportError)
    with episode() as played:
        observe, act, read_manual = (tools.FunctionTool.from_defaults(function) for function in played.functions())
        assert act.metadata.get_parameters_dict()["required"] == ["action"]
        assert act.call(action="Rock").content.startswith("You chose Rock")
        assert "You chose Rock" in observe.call().content
        assert read_manual.call().content == played.game.manual
    assert played.result.tool_calls == 3
