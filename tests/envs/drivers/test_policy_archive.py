import json
import pickle
import zipfile
from types import SimpleNamespace

import pytest
import torch
from torch import nn

from envs.drivers import policy_archive
from envs.drivers.policy_archive import read_policy, restore_training

WEIGHTS = {"action_net.weight": torch.full((2, 3), 0.5), "action_net.bias": torch.zeros(2)}


class Policy(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.action_net = nn.Linear(3, 2)
        self.optimizer = torch.optim.Adam(self.parameters(), lr=0.25)


def moments(**changed: object) -> dict[int, dict[str, object]]:
    """What Adam keeps of WEIGHTS, with other values for the first of them."""
    state = {
        n: {"step": torch.tensor(4.0), "exp_avg": w * 2, "exp_avg_sq": w * 3} for n, w in enumerate(WEIGHTS.values())
    }
    return {**state, 0: {**state[0], **changed}}


def save(path, weights=None, data=None, optimizer=None, mark="corridors"):
    usual = {"state": moments(), "param_groups": [{"lr": 1e30}]}
    entries = {"policy.pth": weights or WEIGHTS, "policy.optimizer.pth": optimizer or usual}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries.items():
            with archive.open(name, "w") as file:
                torch.save(content, file)
        archive.writestr("data", json.dumps({"num_timesteps": 128}) if data is None else data)
        archive.writestr(mark, "")
    return path


class Harm:
    """Makes a file as soon as it is unpickled."""

    def __init__(self, file) -> None:
        self.file = str(file)

    def __reduce__(self):
        return (open, (self.file, "w"))


@pytest.mark.parametrize("entry", ["policy.pth", "policy.optimizer.pth", "data"])
def test_nothing_that_is_pickled_in_a_policy_is_run(tmp_path, entry):
    harmed = tmp_path / "harmed"
    pickle.loads(pickle.dumps(Harm(harmed))).close()
    assert harmed.exists()
    harmed.unlink()
    with zipfile.ZipFile(save(tmp_path / "evil.zip")) as whole:
        entries = {name: whole.read(name) for name in whole.namelist()}
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as archive:
        for name, content in {**entries, entry: pickle.dumps(Harm(harmed))}.items():
            archive.writestr(name, content)
    with pytest.raises(ValueError, match=r"evil\.zip: (holds no policy|no training can be continued)"):
        restore_training(tmp_path / "evil.zip", Policy())
    assert not harmed.exists()


def test_a_training_that_was_killed_before_its_first_update_is_restored(tmp_path):
    policy = Policy()
    file = save(tmp_path / "policy.zip", optimizer={"state": {}, "param_groups": []})
    assert restore_training(file, policy) == 128
    assert torch.equal(policy.action_net.weight, WEIGHTS["action_net.weight"]) and not policy.optimizer.state


def test_a_training_is_restored_with_the_hyperparameters_of_the_program(tmp_path):
    policy = Policy()
    assert restore_training(save(tmp_path / "policy.zip"), policy) == 128
    assert torch.equal(policy.action_net.weight, WEIGHTS["action_net.weight"])
    state = policy.optimizer.state_dict()
    assert state["param_groups"][0]["lr"] == 0.25
    assert (
        torch.equal(state["state"][0]["exp_avg"], WEIGHTS["action_net.weight"] * 2) and state["state"][1]["step"] == 4
    )


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        ({"data": "{}"}, "num_timesteps"),
        ({"data": '{"num_timesteps": -1}'}, "num_timesteps must be 0 to"),
        ({"data": '{"num_timesteps": 1e300}'}, "num_timesteps must be 0 to"),
        ({"data": "[" * 100_000}, "recursion"),
        (
            {"optimizer": {"state": moments(exp_avg=torch.zeros(3, 2))}},
            r"exp_avg of weight 0 .* shape \(2, 3\)",
        ),
        ({"optimizer": {"state": moments(step="four")}}, "step of weight 0"),
        ({"optimizer": {"state": moments(exp_avg_sq=torch.full((2, 3), torch.nan))}}, "exp_avg_sq of weight 0"),
        ({"optimizer": {"state": {0: moments()[0]}}}, "1"),
        ({"optimizer": {"state": []}}, "index"),
        ({"weights": {"action_net.weight": torch.zeros(1, 1)}}, "state_dict"),
    ],
)
def test_a_training_that_cannot_be_continued_is_named_in_one_line(tmp_path, entries, reason):
    file = save(tmp_path / "policy.zip", **entries)
    with pytest.raises(ValueError, match=rf"policy\.zip: no training can be continued from it \(.*{reason}") as refusal:
        restore_training(file, Policy())
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "weights",
    [
        {**WEIGHTS, 7: torch.zeros(1)},
        {**WEIGHTS, "extra": "text"},
        {**WEIGHTS, "action_net.bias": torch.tensor([1.0, torch.inf])},
        {**WEIGHTS, "action_net.bias": torch.zeros(2, dtype=torch.int64)},
        {**WEIGHTS, "action_net.bias": torch.zeros(2).to_sparse()},
        {**WEIGHTS, "action_net.bias": torch.zeros(1).expand(1 << 40)},
        [1, 2],
    ],
)
def test_weights_that_are_no_finite_tensors_are_refused(tmp_path, weights):
    with pytest.raises(ValueError, match=r"policy\.zip: holds no policy of stable-baselines3's PPO \(policy\.pth"):
        read_policy(save(tmp_path / "policy.zip", weights))


def test_an_entry_that_unpacks_to_more_than_a_policy_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(policy_archive, "MOST_BYTES", 1 << 20)
    file = save(tmp_path / "policy.zip", data=" " * (2 << 20))
    with pytest.raises(ValueError, match="data has more than 1 MiB"):
        restore_training(file, SimpleNamespace())


def test_the_mark_of_corridors_is_read(tmp_path):
    assert read_policy(save(tmp_path / "policy.zip")).corridors
    weights = {**WEIGHTS, "log_std": torch.zeros(2)}
    assert not read_policy(save(tmp_path / "policy.zip", weights, mark="other")).corridors
