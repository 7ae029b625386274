"""OpenEnv: its server and client on loopback. `.ci/run` has an environment with it."""

from __future__ import annotations

import sys
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("openenv", reason="needs smartplay-tools[openenv]; `.ci/run` has an environment with it")

import httpx
from openenv.core.env_server.mcp_types import CallToolAction
from openenv.core.mcp_client import MCPToolClient
from openenv.validation.parsers.openenv_yaml import OpenEnvYamlParser
from smartplay_openenv import SPLITS, SmartPlayEnvironment, new_app

import smartplay_tools as sp
from smartplay_tools.games import get_spec
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.types import TOOL_NAMES
from smartplay_tools.web import Server
from tests.adapters import conformance
from tests.adapters.conformance import (
    GAME,
    HOST_BUDGET,
    WAY,
    Host,
    Send,
    move,
)
from tests.processes import printed_by

pytestmark = pytest.mark.filterwarnings("ignore")

HUB = Path(__file__).parents[2] / "hub" / "openenv"


@contextmanager
def served(app: Any) -> Iterator[str]:
    with Server(app, "127.0.0.1", 0, lifespan=True, websockets=True) as server:
        yield server.url


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    patch = pytest.MonkeyPatch()
    patch.setenv("NO_PROXY", "127.0.0.1")
    with served(new_app(GAME, budget=HOST_BUDGET, sessions=8)) as address:
        yield address
    patch.undo()


@asynccontextmanager
async def clients(seeds: Sequence[int], folder: Path) -> AsyncIterator[list[Send]]:
    """Clients of a server that records its episodes."""
    app = new_app(GAME, budget=HOST_BUDGET, records=folder)
    with ExitStack() as stack:
        address = stack.enter_context(served(app))
        stack.enter_context(pytest.MonkeyPatch.context()).setenv("NO_PROXY", "127.0.0.1")
        senders = []
        for seed in seeds:
            client = stack.enter_context(MCPToolClient(base_url=address).sync())
            client.reset(seed=seed, episode_id=str(seed))

            async def send(name: str, arguments: Any, client: Any = client) -> tuple[str, bool | None]:
                answer = client.step(CallToolAction(tool_name=name, arguments=arguments)).observation
                return answer.result, answer.metadata["is_error"]

            senders.append(send)
        yield senders


ROW = Host(clients, "OpenEnv `SmartPlayEnvironment`")


async def test_the_game_cannot_tell_the_server_apart(tmp_path):
    await conformance.judge_hosts(ROW, tmp_path)


def test_the_rewards_of_a_client_sum_up_to_its_score(url):
    with MCPToolClient(base_url=url).sync() as client:
        assert "trying to play the game" in client.reset(seed=7).observation.text
        assert [tool.name for tool in client.list_tools()] == ["observe", "act", "read_manual"]
        illegal = client.step(CallToolAction(tool_name="act", arguments={"action": "Fly"}))
        assert (illegal.reward, illegal.done, illegal.observation.metadata) == (None, False, {"is_error": True})
        steps = [client.step(CallToolAction(tool_name="act", arguments={"action": move(short)})) for short in WAY]
        assert sum(step.reward for step in steps) == pytest.approx(1.0)
        assert [step.done for step in steps] == [False] * 6 + [True]
        assert client.state().step_count == 7


def test_the_state_is_for_the_trainer():
    environment = SmartPlayEnvironment(GAME)
    environment.reset(seed=7, episode_id="a")
    environment.step(CallToolAction(tool_name="act", arguments={"action": move(WAY[0])}))
    state = environment.state
    assert (state.episode_id, state.seed, state.score, state.end_reason) == ("a", 7, 1, None)


def test_tasks_are_seeds_and_those_of_an_evaluation_are_the_test(url):
    assert [split["name"] for split in httpx.get(f"{url}/smartplay/splits", trust_env=False, verify=False).json()] == [
        *SPLITS
    ]
    environment = SmartPlayEnvironment(GAME)
    environment.reset(split="test", index=3)
    assert environment.state.seed == trial_seed(0, GAME, 3) == environment.get_task("test", 3)["seed"]
    assert len(environment.list_tasks("train")) == 100 < environment.num_tasks("train")
    with pytest.raises(IndexError, match="0 to 99"):
        environment.get_task("test", 100)
    with pytest.raises(sp.InvalidArgumentError, match="train, test"):
        environment.reset(split="dev")


def test_the_train_split_has_the_games_own():
    """Another seed of MESSENGER's test split has the same names in the same roles."""
    environment = SmartPlayEnvironment("MessengerL1-v0")
    for split in SPLITS:
        environment.reset(split=split, index=0)
        assert environment.episode.config.options.get("split", "test") == split
    environment.reset()
    assert environment.episode.config.options == {"split": "train"}
    chosen = SmartPlayEnvironment("MessengerL1-v0", split="val")
    chosen.reset(split="train")
    assert chosen.episode.config.options == {"split": "val"}


@pytest.mark.parametrize("game", list(sp.GAMES))
def test_no_world_is_in_two_splits(game):
    starts = {name: trial_seed(split.run_seed, game, 0) for name, split in SPLITS.items()}
    worlds = [range(start, start + SPLITS[name].tasks) for name, start in starts.items()]
    assert all(world.stop <= 2**31 for world in worlds)
    first, second = sorted(worlds, key=lambda world: world.start)
    assert first.stop <= second.start


def test_half_a_character_in_an_action_is_answered(url):
    with MCPToolClient(base_url=url).sync() as connected:
        connected.reset(seed=7)
        answer = connected.step(CallToolAction(tool_name="act", arguments={"action": "half \ud83d"}))
        assert '"half \ufffd" is not' in answer.observation.result


def test_a_call_before_the_reset_is_an_error_of_the_client():
    answer = SmartPlayEnvironment(GAME).step(CallToolAction(tool_name="observe"))
    assert "Reset the environment first" in answer.error.message


def test_a_mistake_in_the_options_is_reported_where_the_server_is_made():
    with pytest.raises(sp.InvalidArgumentError, match="no human score"):
        new_app("Hanoi4Disk-v0")
    with pytest.raises(sp.InvalidArgumentError, match="reset takes seed"):
        SmartPlayEnvironment(GAME).reset(seed=1, world=3)


def test_every_game_that_an_environment_makes_is_closed():
    open_games = []

    class Counted(get_spec(GAME).load()):
        def reset(self, *, seed: int) -> None:
            open_games.append(self)
            super().reset(seed=seed)

        def close(self) -> None:
            if self in open_games:
                open_games.remove(self)
            super().close()

    environment = SmartPlayEnvironment(replace(get_spec(GAME), entry_point=Counted))
    assert not open_games
    environment.reset(seed=7)
    environment.reset(seed=8)
    assert len(open_games) == 1
    environment.close()
    assert not open_games


def test_the_folder_for_the_hub_is_valid_and_serves(monkeypatch):
    script = Path(sys.executable).with_name("openenv")
    command = [script, "validate", HUB, "--skip-build", "--level", "static", "--json"]
    printed_by(*command)
    monkeypatch.syspath_prepend(str(HUB))
    import server.app

    with served(server.app.app) as address:
        assert httpx.get(f"{address}/health", trust_env=False, verify=False).json()["status"] == "healthy"


def test_the_hubs_package_declares_what_the_environment_has():
    declared = OpenEnvYamlParser().parse(HUB).capabilities
    assert declared.task_api
    assert declared.declared_tools == list(TOOL_NAMES)
    assert declared.declared_task_count == {split: chosen.tasks for split, chosen in SPLITS.items()}
