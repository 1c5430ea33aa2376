"""Train a driver by reinforcement learning: PPO of stable-baselines3 on the kinematic environment with true depth.

    pip install "mars-m3depth[rl]"
    python -m envs.train_ppo --out runs/ppo --max-minutes 20 --workers 2
    python -m envs.evaluate --driver runs/ppo/policy.zip straight --perception ground_truth --dynamics kinematic \\
        --goal-distance 10 --out out/ppo

The policy observes and acts as envs.drivers.corridors.Corridors documents: it sees how far each of 13 ways is free, and
chooses one of them. OUT/policy.zip is the policy, OUT/train_ppo.json its courses, its time of training and
the versions of packages of all runs, OUT/log.jsonl its progress. The same command continues where it was stopped, with
the rest of the time. Of policy.zip it reads tensors and JSON alone: nothing in the file is executed.
"""

from __future__ import annotations

import io
import json
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from multiprocessing import parent_process
from pathlib import Path
from time import monotonic
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro
from gymnasium.wrappers import TransformReward

from envs.courses.course import CourseConfig, check_rocks
from envs.drivers.corridors import Corridors
from envs.drivers.policy_archive import mark_corridors, read_policy, restore_training
from envs.drives.place_note import place_note
from envs.drives.records import NUMBER, is_number
from envs.mars_nav import MarsNavEnv
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.compute.workers import signals_left_to_parent
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, json_text
from marssim.base.files.no_link import append_line
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import joined_versions, versions
from marssim.scene.place_file import PLACE_VALUES, load_place
from marssim.scene.presets import PRESETS

POLICY, SETTINGS_FILE, LOG = "policy.zip", "train_ppo.json", "log.jsonl"  # in OUT
LEARNING = ("gymnasium", "stable-baselines3")  # packages that learn, beside those of versions()
SECONDS, VERSIONS = "seconds", "versions"  # keys in SETTINGS_FILE: time of training [s], versions of packages
LOST = "a worker process ended: its error is above, or it was killed, perhaps for lack of memory"
RATE = 1e-3  # learning rate at the start
EPISODES_PER_SCENE = 8  # a new scene takes as long as some thirty steps
BATCH = 64  # largest number of choices in a batch
REWARD_SHARE = 0.1  # factor on rewards: PPO's defaults suit returns of about one
SETTINGS: dict[str, Any] = {
    "n_epochs": 10,
    # with so few choices, larger updates than this undo what earlier ones learnt
    "target_kl": 0.03, "ent_coef": 0.005,
    # a detour is a few choices long
    "gamma": 0.95, "gae_lambda": 0.9,
}  # fmt: skip


@dataclass(frozen=True)
class PPOConfig:
    """Train PPO on MarsNav-v0 and save OUT/policy.zip, which envs.evaluate takes as a driver."""

    out: Path
    """Folder for policy.zip, train_ppo.json and log.jsonl."""
    max_minutes: float = 20.0
    """Time of training [min], above 0, that of earlier runs in OUT included. The learning rate falls to zero over this
    time."""
    max_steps: int = 100_000_000
    """Most choices of a way, above 0, rounded up to whole rollouts (128 in each environment). A choice is three steps
    of the environment."""
    workers: int = 2
    """Number of environments, 1 or more, each in its own process."""
    scene: Annotated[str, tyro.conf.arg(metavar=PLACE_VALUES)] = PRESETS[0]
    """Place of the courses: a preset, or the JSON file of a place (marssim.scene.place_file)."""
    k: tuple[float, float] = (0.1, 0.2)
    """Range from which the rock abundance of each scene is drawn, Golombek's k, 0 to 0.4."""
    goal_distance: float = 10.0
    """Distance from start to goal [m], 3 to 100: shorter than in evaluation, so that the policy meets goals early. A
    scene holds 50,000 rocks, so with the default --k and --scene it is at most 47 m."""
    seed: int = 0
    """Seed of the courses and of the policy, 0 to 4294967295."""

    def __post_init__(self) -> None:
        for name in ("max_minutes", "max_steps", "workers"):
            if not getattr(self, name) > 0:
                raise ValueError(f"--{name.replace('_', '-')} must be positive, got {getattr(self, name)}")
        if not 0 <= self.seed < 2**32:
            raise ValueError(f"--seed must lie in [0, 4294967295], got {self.seed}")
        CourseConfig(self.goal_distance)  # raises ValueError for a value out of range
        place = load_place(self.scene)  # raises ValueError for an unknown place
        if not 0 <= self.k[0] <= self.k[1] <= 0.4:
            raise ValueError(f"--k must be two values in [0, 0.4], the lower one first, got {self.k[0]} {self.k[1]}")
        check_rocks(place, CourseConfig(self.goal_distance, k=self.k[1]))

    def courses(self) -> dict[str, Any]:
        """Return the settings of the courses. With other values it would be another training."""
        return {
            **place_note(self.scene), "k": list(self.k), "goal_distance": float(self.goal_distance), "seed": self.seed
        }  # fmt: skip


def training_env(config: PPOConfig) -> gymnasium.Env:
    """Return the environment of training: Corridors, with rewards of the size that suits PPO's defaults."""
    from stable_baselines3.common.monitor import Monitor

    if parent_process() is not None:
        for name in ("SIGINT", "SIGHUP"):  # they reach all processes; the command ends the others
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), signal.SIG_IGN)
    env = MarsNavEnv(
        "ground_truth", "kinematic", scene=config.scene, goal_distance=config.goal_distance, map_observation=True,
        k=config.k, episodes_per_scene=EPISODES_PER_SCENE,
    )  # fmt: skip
    monitored = Monitor(Corridors(env), info_keywords=("outcome",))
    return TransformReward(monitored, lambda reward: REWARD_SHARE * float(reward))


def train(config: PPOConfig, rollout: int = 128) -> Path:
    """Train until the time or the steps are used up, and return the policy's path.

    Args:
        config: The settings.
        rollout: Choices in each environment between two updates.

    Raises:
        ImportError: If stable-baselines3 is not installed.
        ValueError: If the folder's policy.zip is no policy of this command.
        DatasetError: If the folder's policy learnt on other courses.
        FolderInUse: If another command writes to the folder.
    """
    if find_spec("stable_baselines3") is None:
        raise ImportError('envs.train_ppo needs stable-baselines3: pip install "mars-m3depth[rl]"')
    folder, path = _folder(config), config.out / POLICY
    folder.check_place(config.out)
    if path.is_file() and not read_policy(path).corridors:  # raises ValueError for a file of another kind
        raise ValueError(f"{path}: is not a policy of envs.train_ppo; choose another --out")
    with folder.claim() as previous:
        if previous is None:
            (config.out / LOG).unlink(missing_ok=True)  # of a policy that was deleted
        used = 0.0 if previous is None else _seconds(folder.mark_path, previous)
        _train(config, folder, path, rollout, used, _versions(previous))
    return path


def _train(
    config: PPOConfig, folder: ResultFolder, path: Path, rollout: int, used: float, used_versions: dict[str, Any]
) -> None:
    """Train the policy until the time or the steps are used up.

    Args:
        config: The settings.
        folder: The run's folder, claimed; the time of training and the versions are noted in it.
        path: File of the policy.
        rollout: Choices in each environment between two updates.
        used: Time of training of earlier runs [s].
        used_versions: The versions of this and of earlier runs.
    """
    from stable_baselines3.common.callbacks import BaseCallback

    budget, log = 60 * config.max_minutes, config.out / LOG
    if used >= budget:
        print(f"{config.out}: already at --max-minutes {config.max_minutes:g}; raise it to go on")
        return
    began = monotonic() - used

    def trained() -> float:
        """Return the time of training so far [s], that of earlier runs included."""
        return monotonic() - began

    def rate(_: float) -> float:
        """Return the learning rate. It falls to zero over the time, or late updates would undo early ones."""
        return RATE * max(0.0, 1 - trained() / budget)

    def save(model: Any) -> None:
        _save(model, path)
        folder.note(**{SECONDS: round(trained(), 1), VERSIONS: used_versions})

    class Clock(BaseCallback):
        """Ends the training in time, saves the policy after each update, and prints the progress before it."""

        learnt = 0  # choices that the policy has learnt from
        in_time = True

        def _on_training_start(self) -> None:
            self.learnt = self.num_timesteps

        def _on_step(self) -> bool:
            self.in_time = trained() < budget
            return self.in_time

        def _on_rollout_start(self) -> None:  # the first call comes before, each other one after an update
            if self.num_timesteps > self.learnt:
                self.learnt = self.num_timesteps
                save(self.model)

        def _on_rollout_end(self) -> None:
            if ended := list(self.model.ep_info_buffer or []):
                row = _summary(ended)
                append_line(log, json_text({"choices": self.num_timesteps, **row}))
                share = f"{100 * row['arrived']:.0f} % arrived, reward {row['reward']:.1f}"
                left = f"{max(0.0, budget - trained()) / 60:.0f} min to go"
                print(
                    f"{self.num_timesteps} choices: last {counted(row['episodes'], 'episode')}, {share}, {left}",
                    flush=True,
                )

    with _environments(config) as vector:
        model = _model(config, path, vector, rollout, rate)
        _drop_lines_after(log, model.num_timesteps)
        if model.num_timesteps >= config.max_steps:
            print(f"{config.out}: already at --max-steps {config.max_steps}; raise it to go on")
            return
        # the steps end it here, not in the callback: PPO never learns from a rollout that the callback ends
        clock = Clock()
        model.learn(config.max_steps - model.num_timesteps, callback=clock, reset_num_timesteps=False)
        if not clock.in_time:  # so the last rollout ended early, and nothing was learnt from it
            model.num_timesteps = clock.learnt
        if model.num_timesteps == 0:
            raise ValueError(
                f"--max-minutes {config.max_minutes:g}: the time ended before the first {rollout * config.workers} "
                "choices, so nothing was learnt and no policy is saved; raise it"
            )
        save(model)


def _drop_lines_after(log: Path, choices: int) -> None:
    """Remove from a log what a resumed run writes again: lines later than the saved policy, and one that was cut off.

    Lines that this command did not write stay.

    Args:
        log: The log; it may not exist.
        choices: Number of choices that the saved policy has made.
    """
    lines = log.read_bytes().splitlines(keepends=True) if log.exists() else []
    kept = [line for line in lines if line.endswith(b"\n") and _choices(line) <= choices]
    if len(kept) < len(lines):
        write_atomically(log, b"".join(kept))


def _choices(line: bytes) -> float:
    """Return the number of choices up to a line of the log; 0 for a line that this command did not write."""
    try:
        count = json.loads(line)["choices"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return 0
    return float(count) if is_number(count) else 0


def _model(config: PPOConfig, path: Path, vector: Any, rollout: int, rate: Callable[[float], float]) -> Any:
    """Return the PPO model of a policy's file, or a new one where there is none.

    Args:
        config: The settings.
        path: File of the policy.
        vector: The environments.
        rollout: Choices in each environment between two updates.
        rate: Returns the learning rate.

    Raises:
        ValueError: If no training can be continued from the file.
    """
    from stable_baselines3 import PPO
    from stable_baselines3.common.logger import Logger

    from envs.drivers.way_policy import WayPolicy

    batch = min(BATCH, rollout * config.workers)
    model = PPO(WayPolicy, vector, rate, n_steps=rollout, batch_size=batch, device="cpu", seed=config.seed, **SETTINGS)
    model.set_logger(Logger(None, []))  # its own makes a folder in that of temporary files, and leaves it there
    if path.is_file():
        model.num_timesteps = restore_training(path, model.policy)
    # of courses: others than those of the next seed, and than those that the training began with
    courses = np.random.SeedSequence((config.seed, model.num_timesteps)).generate_state(1)[0]
    vector.seed(int(courses) // 2)  # and of the workers after the first one, this number + 1, + 2, ...
    return model


@contextmanager
def _environments(config: PPOConfig) -> Iterator[Any]:
    """Make the environments, and close them at the end.

    After an error their processes are not waited for: a process that should have answered when a signal came never
    would.

    Raises:
        BrokenExecutor: A worker process ended. Its traceback is on stderr.
    """
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    makers: list[Callable[[], gymnasium.Env]] = [partial(training_env, config)] * config.workers
    vector = None
    try:
        with signals_left_to_parent():
            vector = DummyVecEnv(makers) if config.workers == 1 else SubprocVecEnv(makers, start_method="spawn")
        yield vector
    except BaseException as error:
        for process in getattr(vector, "processes", ()):
            process.terminate()
        if config.workers > 1 and isinstance(error, EOFError | ConnectionError):  # of the pipe to it
            raise BrokenExecutor(LOST) from None
        raise
    vector.close()


def _save(model: Any, path: Path) -> None:
    policy = io.BytesIO()
    model.save(policy)
    mark_corridors(policy)
    write_atomically(path, policy.getvalue())


def _folder(config: PPOConfig) -> ResultFolder:
    """Return the run's folder. Its settings may be replaced as long as it holds no policy."""

    def has_results(out: Path) -> bool:
        return (out / POLICY).is_file() or ((out / LOG).exists() and not (out / SETTINGS_FILE).is_file())

    return ResultFolder(
        config.out, "policy", SETTINGS_FILE, config.courses(), notes=(SECONDS, VERSIONS), shared=True,
        has_results=has_results,
    )  # fmt: skip


def _versions(previous: dict[str, Any] | None) -> dict[str, Any]:
    """Return the versions of packages and the machine, joined with those that earlier runs noted."""
    import torch  # noqa: F401  # versions() reports its threads, and only an old policy loads it before

    earlier = {} if previous is None else previous.get(VERSIONS)
    now = {**versions(), **{package: version(package) for package in LEARNING}}
    return joined_versions([earlier, now] if isinstance(earlier, dict) and earlier else [now])


def _seconds(file: Path, previous: dict[str, Any]) -> float:
    """Return the time of training of an earlier run [s].

    Raises:
        DatasetError: If the noted value is no time.
    """
    seconds = previous.get(SECONDS, 0)
    if not is_number(seconds) or seconds < 0:
        raise DatasetError(f"{file}: {SECONDS} must be {NUMBER}, got {seconds!r}; choose another --out")
    return float(seconds)


def _summary(ended: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how the last episodes ended; ended: Monitor's notes of each, its reward "r" and its outcome."""
    return {
        "episodes": len(ended),
        "arrived": sum(e["outcome"] == "goal" for e in ended) / len(ended),
        "reward": sum(e["r"] for e in ended) / len(ended),
    }


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(lambda config: print(train(config)), PPOConfig, "python -m envs.train_ppo", __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
