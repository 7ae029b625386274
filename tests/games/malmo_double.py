"""A test double of MineDojo's game client: it implements Malmo's protocol on top of the voxel world.

MineDojo's own launcher starts it in place of `java`, so that everything of MineDojo runs as it is, from the launch
script to the observation. The world is that of the mission's seed, entered where `VoxelEngine` would enter it, and a
tick is a tick of `VoxelEngine`'s walker: whatever an engine over MineDojo sees has to be what `VoxelEngine` sees.

The environment says the rest: `MALMO_DOUBLE_GOAL`, the biomes that a start keeps away from; `MALMO_DOUBLE_FAULT`,
what goes wrong: `start` (it does not), `exit:N` (gone in the N-th tick).
"""

from __future__ import annotations

import json
import math
import os
import re
import socket
import struct
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from smartplay_tools.games.minecraft.observation import heading
from smartplay_tools.games.minecraft.rules import Stride
from smartplay_tools.games.minecraft.voxel import animals
from smartplay_tools.games.minecraft.voxel.blocks import NAMES, SOLID, Block
from smartplay_tools.games.minecraft.voxel.rays import Fan, hit_boxes
from smartplay_tools.games.minecraft.voxel.start import make_world
from smartplay_tools.games.minecraft.voxel.walking import EYES, Walker

DISPLAY = NAMES["paper"].tolist()
LIQUID = [block == Block.WATER for block in Block]
BURNS = [name in ("wood", "leaves", "grass", "flower", "fern", "dead bush", "vines") for name in DISPLAY]
NO_ARGUMENT = ("none", "0", "")


def facts(block: int) -> list:
    """Malmo's facts about a block, apart from its name: needs no tool, blocks movement, liquid, solid, burns."""
    solid = bool(SOLID[block])
    return [block != Block.BEDROCK, solid, LIQUID[block], solid, BURNS[block]]


class Mission:
    """The parts of a mission's XML that the client uses."""

    def __init__(self, xml: bytes) -> None:
        root = ET.fromstring(re.sub(rb'\sxmlns="[^"]+"', b"", xml))
        self.seed = int(root.find(".//DefaultWorldGenerator").get("seed"))
        self.new_world = root.find(".//DefaultWorldGenerator").get("forceReset") == "true"
        self.pixels = int(root.find(".//VideoProducer/Width").text) * int(root.find(".//VideoProducer/Height").text)
        grid = root.find(".//ObservationFromGrid/Grid")
        self.grid = {axis: (int(grid.find("min").get(axis)), int(grid.find("max").get(axis))) for axis in "xyz"}
        rays = root.findall(".//ObservationFromRichLidar/RayOffset")
        self.rays = np.array([[float(ray.get(name)) for name in ("pitch", "yaw", "distance")] for ray in rays])


class Client:
    """The game: a world, a player in it, and the client's observation of both."""

    def __init__(self, goal: frozenset[int], statistics: dict) -> None:
        self._goal, self._statistics = goal, statistics
        self.mission = None

    def begin(self, mission: Mission) -> None:
        if self.mission is None or mission.new_world:
            self._world, feet = make_world(mission.seed, self._goal)
            self._player = Walker(self._world, *feet)
            self._yaw, self._time = 0.0, 0
        self.mission = mission

    def tick(self, commands: str) -> None:
        held = {}
        for line in commands.splitlines():
            name, *arguments = line.split()
            if name == "camera":
                pitch, yaw = map(float, arguments)
                assert pitch == 0, "the game never looks up or down"
                self._yaw = (self._yaw + yaw + 180) % 360 - 180
            elif name in ("craft", "craftNearby", "smeltNearby", "equip", "place"):
                assert arguments[0] in NO_ARGUMENT, f"not allowed: {line}"
            else:
                held[name] = int(arguments[0])
        keys = {name for name, value in held.items() if value}
        assert keys <= {"forward", "left", "right", "jump", "sprint"}, f"not allowed: {keys}"
        assert "forward" not in keys or ("jump" in keys) != ("sprint" in keys), "half of the ticks jump, half sprint"
        stride = Stride(("left" in keys) - ("right" in keys), jump="jump" in keys) if "forward" in keys else None
        self._player.tick(stride, *heading(self._yaw))
        self._time += 1

    def picture(self) -> bytes:
        return bytes(3 * self.mission.pixels)

    def facts(self) -> bytes:
        player, world = self._player, self._world
        x, y, z = math.floor(player.x), math.floor(player.y), math.floor(player.z)
        world.prepare(x, z)
        slot = {"name": "air", "variant": 0, "quantity": 0, "max_durability": -1, "cur_durability": -1}
        body = {"life": 20.0, "armor": 0, "food": 20, "saturation": 5.0, "xp": 0, "air": 300, "is_sleeping": False}
        place = {"xpos": player.x, "ypos": player.y, "zpos": player.z, "yaw": self._yaw, "pitch": 0.0}
        climate = {"biome_id": world.biome_at(x, z), "biome_temperature": 0.5, "biome_rainfall": 0.5, "sea_level": 63}
        sky = {"is_raining": False, "can_see_sky": True, "sun_brightness": 1.0, "sky_light_level": 1.0}
        about = {"light_level": 15, "nearby_crafting_table": False, "nearby_furnace": False}
        facts = body | place | climate | sky | about | self._statistics
        facts["inventory"] = [{"inventory": "inventory", **slot}] * 41
        facts["voxels"], facts["rays"] = self._voxels(x, y, z), self._rays(x, z)
        return json.dumps(facts).encode()

    def _voxels(self, x: int, y: int, z: int) -> list:
        """The blocks around the feet, x running fastest, then y, then z."""
        reach = self.mission.grid["x"][1]
        assert set(self.mission.grid.values()) == {(-reach, reach)}
        cube = self._world.cube(x, y, z, reach)
        voxels = []
        for block in cube.ravel(order="F").tolist():
            no_tool, *rest = facts(block)
            voxels += [
                DISPLAY[block],
                0,
                block not in (Block.AIR, Block.WATER),
                no_tool,
                *rest,
                bool(SOLID[block]),
                0.0,
            ]
        return voxels

    def _rays(self, x: int, z: int) -> list:
        player, offsets = self._player, self.mission.rays
        directions, ranges = malmo_directions(self._yaw, offsets), offsets[:, 2].astype(np.float32)
        eye = (player.x, player.y + EYES, player.z)
        hits, distances = Fan(directions, ranges).hit_blocks(self._world.blocks, eye)
        species, low, high = animals.animals_near(self._world, x, z, self._time)
        hit, entity_distances = hit_boxes(low, high, eye, directions, distances)
        names = animals.NAMES[np.append(species + 1, 0)[hit]].tolist()
        classes = ["null" if name == "null" else f"Entity{name.title()}" for name in names]
        rays = []
        for ray, block in enumerate(hits.tolist()):
            pitch, yaw, _ = offsets[ray].tolist()
            seen = [DISPLAY[block], float(distances[ray]), 0, -1, *facts(block)]
            rays += [*seen, classes[ray], float(entity_distances[ray]), pitch, yaw, 0.0, 0.0, 0.0]
        return rays


def malmo_directions(yaw: float, offsets: np.ndarray) -> np.ndarray:
    """Minecraft's `Vec3d.rotatePitch`, about the world's x axis, and then `rotateYaw`, of a look that is level."""
    sine, cosine = heading(yaw)
    pitched = np.stack(
        [np.full(len(offsets), -sine), cosine * np.sin(offsets[:, 0]), cosine * np.cos(offsets[:, 0])], axis=1
    )
    turn_sine, turn_cosine = np.sin(offsets[:, 1]), np.cos(offsets[:, 1])
    x = pitched[:, 0] * turn_cosine + pitched[:, 2] * turn_sine
    z = pitched[:, 2] * turn_cosine - pitched[:, 0] * turn_sine
    return np.stack([x, pitched[:, 1], z], axis=1).astype(np.float32)


class Connection:
    """Messages of Malmo's protocol: each has its length, four bytes, before it."""

    def __init__(self, connection: socket.socket) -> None:
        self._stream = connection.makefile("rwb")

    def receive(self) -> bytes:
        head = self._stream.read(4)
        return self._stream.read(struct.unpack("!I", head)[0]) if len(head) == 4 else b""

    def send(self, *messages: bytes) -> None:
        for message in messages:
            self._stream.write(struct.pack("!I", len(message)) + message)
        self._stream.flush()


def serve(connection: Connection, client: Client, fault: tuple[str, int]) -> None:
    """Answer one connection until it is closed."""
    done = struct.pack("!I", 1)
    assert connection.receive() == b"<MalmoEnv0.37.0/>"
    while message := connection.receive():
        if message.startswith(b"<StepClient0>"):
            serve.ticks += 1
            if serve.ticks == fault[1]:
                sys.exit()
            client.tick(message.removeprefix(b"<StepClient0>").removesuffix(b"</StepClient0 >").decode())
            connection.send(client.picture(), struct.pack("!dbb", 0, 0, 1), client.facts())
        elif message.startswith(b"<MissionInit"):
            assert connection.receive().endswith(b":0:0:1:true")
            client.begin(Mission(message))
            connection.send(done)
        elif message == b"<Peek/>":
            connection.send(client.picture(), client.facts(), b"\0")
        elif message == b"<Quit/>":
            connection.send(done)
        elif message == b"<Exit>NOW</Exit>":
            connection.send(done)
            sys.exit()
        elif message == b"<Disconnect/>":
            return
        else:
            assert message == b"<StepServer></StepServer>", message


serve.ticks = 0


def zero_statistics() -> dict:
    """The statistics that MineDojo asks for; it writes a line to its log for each that is missing."""
    (file,) = Path(os.environ["SMARTPLAY_MINEDOJO_PYTHON"]).parents[1].glob("lib/*/*/minedojo/sim/mc_meta/mc_con*.json")
    zeros: dict = {}
    for statistic in json.loads(file.read_text())["stats"]:
        keys = statistic["minerl_keys"]
        if len(keys) == 2:
            zeros.setdefault(keys[0], {})[keys[1]] = 0
    return zeros


def main() -> None:
    fault, _, tick = os.environ.get("MALMO_DOUBLE_FAULT", "").partition(":")
    if fault == "start":
        sys.exit("Error: the game could not be started")
    (folder,) = (argument.removeprefix("-PrunDir=") for argument in sys.argv if argument.startswith("-PrunDir="))
    settings = Path(folder, "config", "malmomodCLIENT.cfg").read_text()
    port = int(re.search(r"portOverride=(\d+)", settings).group(1))
    goal = frozenset(map(int, os.environ["MALMO_DOUBLE_GOAL"].split(",")))
    client = Client(goal, zero_statistics())
    listener = socket.create_server(("127.0.0.1", port))
    print(f"***** Start MalmoEnvServer on port {port}")
    print("CLIENT enter state: DORMANT", flush=True)
    while True:
        connection, _ = listener.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        serve(Connection(connection), client, (fault, int(tick or 0)))


if __name__ == "__main__":
    main()
