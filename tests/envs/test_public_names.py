"""The face of envs: every public name is there, and is the one that its module holds."""

import importlib

import gymnasium
import pytest

import envs
import envs.course
import envs.drivers
import envs.wrappers
from envs.courses.course import EDGE
from envs.drivers.driver import Driver, Stop
from envs.drivers.image_observation import ImageObservation
from envs.mars_nav import MarsNavEnv


@pytest.mark.parametrize("package", [envs, envs.drivers, importlib.import_module("nav")])
def test_every_listed_name_exists(package):
    assert package.__all__ and [name for name in package.__all__ if not hasattr(package, name)] == []


def test_documented_names_lead_to_the_same_things():
    assert envs.MarsNavEnv is MarsNavEnv
    assert envs.Stop is envs.drivers.Stop is Stop and envs.Driver is envs.drivers.Driver is Driver
    assert envs.wrappers.ImageObservation is envs.ImageObservation is ImageObservation
    assert envs.course.EDGE == EDGE
    assert gymnasium.spec("MarsNav-v0").entry_point == "envs.mars_nav:MarsNavEnv"
