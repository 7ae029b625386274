"""The notebooks contain no output of an earlier run, and `make docs` runs them; what people do in notebooks works."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "notebooks").glob("*.ipynb"))


def cells(path, kind):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return [cell for cell in notebook["cells"] if cell["cell_type"] == kind]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_holds_no_output(path):
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells(path, "code"))


# What people do in notebooks, in one that is executed by a kernel.

PLAYER = """
import smartplay_tools as sp
from smartplay_tools.players import call


class Stubborn:
    name = "stubborn"

    def __init__(self, *, seed):
        pass

    def reply(self, prompt):
        return sp.Reply(call("act", action="Rock"))
"""

RUN = """
run = sp.evaluate(["RockPaperScissorBasic-v0"], {"stubborn": Stubborn}, out="run", trials=2)
assert run.complete, run.failures
run
"""

REFUSED = """
try:
    sp.evaluate(["RockPaperScissorBasic-v0"], {"stubborn": Stubborn}, out="refused", trials=2, executor="processes")
except sp.InvalidArgumentError as error:
    print(error)
"""

GAME = """
import dataclasses
from smartplay_tools.games import get_spec

HANOI = get_spec("Hanoi3Disk-v0")


class Mine(HANOI.load()):
    pass


sp.register(dataclasses.replace(HANOI, id="MyHanoi-v0", entry_point=Mine))
swept = sp.sweep(["MyHanoi-v0"], ["rule"], out="sweep", vary={"history": [1, 5]}, trials=1)
assert len(swept.rows) == 2, swept.failures
try:
    sp.evaluate(["MyHanoi-v0"], out="refused", trials=1, executor="processes")
except sp.InvalidArgumentError as error:
    print(error)
"""

MODEL = """
import asyncio


class Waiting(Stubborn):
    name = "waiting"
    reply = None

    async def areply(self, prompt):
        await asyncio.sleep(0)
        return sp.Reply(call("act", action="Paper"))


asyncio.get_running_loop()
many = sp.evaluate(["RockPaperScissorBasic-v0"], {"waiting": Waiting}, out="many", trials=3)
assert many.complete, many.failures
"""

LOOK = """
run.show(0, height=400)
"""

FRAME = """
len(run.to_pandas())
"""


def executed(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """Execute a notebook in a kernel of this environment, in a folder; a cell that fails fails the test."""
    client = nbclient.NotebookClient(
        notebook, timeout=240, kernel_name="python3", resources={"metadata": {"path": folder}}
    )
    return client.execute()


def test_players_and_games_of_a_notebook_are_played_in_it(tmp_path):
    code = [PLAYER, RUN, REFUSED, GAME, MODEL, LOOK, FRAME]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text.strip()) for text in code])
    _, run, refused, game, _, look, frame = executed(notebook, tmp_path).cells

    (table,) = (output["data"]["text/html"] for output in run.outputs)
    assert "2 of 2 episodes finished" in table
    assert "is defined in this notebook, which worker processes cannot import" in output_of(refused)
    assert "MyHanoi-v0 was registered in this notebook" in output_of(game)
    (widget,) = look.outputs
    assert widget["data"]["text/html"].startswith("<iframe srcdoc=")
    assert 'height="400"' in widget["data"]["text/html"]
    assert frame.outputs[0]["data"]["text/plain"] == "2"


def output_of(cell: nbformat.NotebookNode) -> str:
    return "".join(output["text"] for output in cell.outputs if output["output_type"] == "stream")
