"""Drives follow from their episode alone: not from workers, shards, or a kill."""

import json

import pytest

from envs.evaluate import evaluate
from envs.evaluation import driving
from envs.join import JoinConfig, join

pytestmark = pytest.mark.usefixtures("undrawn_figures")

TIMES = ("step_seconds", "perception_seconds")  # fields of a record that differ from run to run


class Interruption:
    """In place of the lines on the steps of a drive: it interrupts the evaluation after some steps of all drives."""

    taken = 0

    def __init__(self, most):
        self.most = most

    def watch(self, env, driver, step):
        Interruption.taken += step > 0
        if Interruption.taken > self.most:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def suite_of_small_images(small_suite, tmp_path_factory):
    content = json.loads(small_suite.read_text())
    for values in content["conditions"].values():
        values["image_pixels"] = 128
    file = tmp_path_factory.mktemp("small_images") / "small-v1.json"
    file.write_text(json.dumps(content))
    return file


def test_drives_by_depth_do_not_depend_on_workers_shards_or_a_kill(
    suite_of_small_images, make_suite_config, tmp_path, monkeypatch
):
    """The navigator with SGBM, whose every step depends on the depth of all looks before it."""

    def config(name, **changes):
        settings = {"driver": ("navigator",), "perception": ("sgbm",), "episodes": 1, **changes}
        return make_suite_config(suite_of_small_images, tmp_path / name, **settings)

    def records(name):
        files = sorted((tmp_path / name / "episodes").iterdir())
        content = {file.name: json.loads(file.read_text()) for file in files}
        return {name: {k: v for k, v in record.items() if k not in TIMES} for name, record in content.items()}

    evaluate(config("one"))
    expected = records("one")
    assert len(expected) == 2 and all(record["looks"] > 1 and record["abs_rel"] for record in expected.values())
    evaluate(config("two", workers=2))
    shards = [config(f"shard{part}", shard=f"{part}/2") for part in (1, 2)]
    for shard in shards:
        evaluate(shard)
    join(JoinConfig(tuple(shard.out for shard in shards), tmp_path / "joined"))
    steps = sum(record["steps"] for record in expected.values())
    with monkeypatch.context() as patch:
        patch.setattr(driving, "StepLines", lambda *_: Interruption(steps - 2))
        with pytest.raises(KeyboardInterrupt):
            evaluate(config("resumed"))
    assert len(records("resumed")) == 1
    evaluate(config("resumed"))
    for name in ("two", "joined", "resumed"):
        assert records(name) == expected, name
