import pytest

from marssim.scene.presets import PRESETS, preset


def test_presets_are_those_promised():
    assert {name: preset(name).rocks.k for name in PRESETS} == {
        "utopia": 0.033,
        "gusev": 0.05,
        "gale": 0.07,
        "jezero": 0.15,
        "hard": 0.20,
        "gravel": 0.05,
    }
    for name in PRESETS:
        assert preset(name).preset == name
    assert preset("gale", size=8.0).size == 8.0 and preset("gale", size=8.0).rocks == preset("gale").rocks
    with pytest.raises(ValueError, match=r"'olympus'.*utopia, gusev"):
        preset("olympus")
