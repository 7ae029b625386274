"""Train an agent on many worlds of Crafter at once, with PPO from Stable-Baselines3, and print its achievements.

    pip install 'smartplay-tools[rl]' stable-baselines3
    python examples/ppo_crafter.py            # some minutes on two CPU cores
    STEPS=100000 python examples/ppo_crafter.py

The agent sees the symbolic observation: 1,345 numbers, as in Craftax-Classic. After each rollout a line shows in which
share of the last episodes each achievement was unlocked.
"""

import os
import time
from collections import deque

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import smartplay_tools  # noqa: F401 - it registers the environments

STEPS, WORLDS = int(os.environ.get("STEPS", 1_000_000)), 64


class Worlds(VecEnv):
    """A Gymnasium vector with the interface of Stable-Baselines3: worlds reset at once, and each has its own info."""

    def __init__(self, vector):
        self.vector, self.finished = vector, deque(maxlen=200)
        super().__init__(vector.num_envs, vector.single_observation_space, vector.single_action_space)

    def reset(self):
        return self.vector.reset(seed=0)[0]

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        seen, rewards, dead, over, info = self.vector.step(self.actions)
        infos = [{} for _ in rewards]
        for world in np.flatnonzero(dead | over):
            infos[world] = {"terminal_observation": info["final_obs"][world], "TimeLimit.truncated": not dead[world]}
            reached = info["final_info"]["achievements"]
            self.finished.append({name: reached[name][world] > 0 for name in reached if name[0] != "_"})
        return seen, rewards.astype(np.float32), dead | over, infos

    def close(self):
        self.vector.close()

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs

    def get_attr(self, name, indices=None):
        return [getattr(self.vector, name)] * self.num_envs

    def set_attr(self, name, value, indices=None):
        raise NotImplementedError

    def env_method(self, name, *arguments, indices=None, **options):
        raise NotImplementedError


class Report(BaseCallback):
    """Prints after each rollout how many achievements an episode unlocks, and how often each."""

    def _on_step(self):
        return True

    def _on_rollout_end(self):
        finished, seconds = self.training_env.finished, time.perf_counter() - began
        tenth = STEPS // 10
        if finished and self.num_timesteps // tenth > (self.num_timesteps - WORLDS * self.model.n_steps) // tenth:
            shares = {name: np.mean([episode[name] for episode in finished]) for name in finished[0]}
            best = sorted(((share, name) for name, share in shares.items() if share > 0.01), reverse=True)
            print(
                f"{self.num_timesteps:9,} steps, {seconds:4.0f} s: {sum(shares.values()):.2f} achievements an episode"
            )
            print("    " + ", ".join(f"{name} {share:.0%}" for share, name in best), flush=True)


vector = gymnasium.make_vec(
    "smartplay/Crafter-v0", num_envs=WORLDS, observation="symbolic", autoreset_mode=AutoresetMode.SAME_STEP
)
model = PPO(
    "MlpPolicy",
    Worlds(vector),
    n_steps=64,
    batch_size=1024,
    n_epochs=4,
    learning_rate=3e-4,
    gamma=0.99,
    gae_lambda=0.8,
    ent_coef=0.01,
    policy_kwargs={"net_arch": [256, 256]},
    seed=0,
)
began = time.perf_counter()
model.learn(STEPS, callback=Report())
