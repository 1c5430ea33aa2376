from dataclasses import replace

import numpy as np
import pytest

from marssim.render.faults import FAULT_SETS, fault_set, fault_view
from marssim.render.sensor import ALWAYS, FAULTS, Sensor, SensorConfig
from marssim.scene.viewpoint import ViewConfig


def test_a_set_without_faults_is_the_default_and_others_change_the_faults_alone():
    assert fault_set("none") == SensorConfig()
    for name in FAULT_SETS:
        assert all(getattr(fault_set(name), value) == getattr(SensorConfig(), value) for value in ALWAYS)
    drawn = {*FAULTS} - {"sun_glare"}  # which depends on the scene: the published data are without it
    assert all(getattr(fault_set("random"), value) != getattr(SensorConfig(), value) for value in drawn)


def test_in_public_images_each_is_stretched_alone():
    drawn = [Sensor.draw(fault_set("public"), np.random.default_rng(seed)) for seed in range(5)]
    assert all(sensor.stretch > 0 and sensor.stretch_alone == 1 for sensor in drawn)


def test_training_draws_the_rover_too():
    assert [fault_view(name).rover[1] > 0 for name in FAULT_SETS] == [name == "random" for name in FAULT_SETS]
    assert replace(fault_view("random"), rover=(0.0, 0.0)) == fault_view("none") == ViewConfig()


def test_an_unknown_set_is_named():
    with pytest.raises(ValueError, match="faults must be one of none, random, public, got 'some'"):
        fault_set("some")  # type: ignore[arg-type]
