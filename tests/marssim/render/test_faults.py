import pytest

from marssim.render.faults import FAULT_SETS, fault_set
from marssim.render.sensor import ALWAYS, FAULTS, SensorConfig


def test_a_set_without_faults_is_the_default_and_others_change_the_faults_alone():
    assert fault_set("none") == SensorConfig()
    for name in FAULT_SETS:
        assert all(getattr(fault_set(name), value) == getattr(SensorConfig(), value) for value in ALWAYS)
    assert all(getattr(fault_set("random"), value) != getattr(SensorConfig(), value) for value in FAULTS)


def test_an_unknown_set_is_named():
    with pytest.raises(ValueError, match="faults must be one of none, random, public, got 'some'"):
        fault_set("some")  # type: ignore[arg-type]
