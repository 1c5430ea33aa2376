import importlib.util

import numpy as np
import pytest

from marssim.base.camera import NATECAM
from marssim.engines.egl import Egl
from marssim.inspection import cross_check as module
from marssim.inspection.agreement import Agreement
from marssim.inspection.cross_check import RendererCheck, cross_check, table
from marssim.scene.presets import preset

CAMERA = NATECAM.resized(112, 112).camera
VIEWS = 2


def test_all_renderers_agree_on_random_views():
    """Depth, ids, and the shift at silhouettes, on ground and on tilted planes, of every renderer that works here."""
    checks, notes = cross_check(preset("gale", size=12.0, horizon=16.0), 0, VIEWS, CAMERA)
    text = table(checks)
    names = ["pybullet", "scan", "embree"] if importlib.util.find_spec("pybullet") else ["scan", "embree"]
    assert [name for name in checks if "EGL" not in name] == names
    assert "pybullet, EGL" in checks or any("left out" in note for note in notes)
    for name in names[:-1]:
        views = checks[name].views
        assert views is not None and views.views == VIEWS and min(views.surface, views.depth) > 0.999, text
    assert all(check.good for check in checks.values()), text


def test_without_pybullet_the_others_are_checked(monkeypatch):
    def raise_import_error():
        raise ImportError("pybullet cannot be imported (no module): it needs Python 3.11")

    monkeypatch.setattr(module, "import_pybullet", raise_import_error)
    renderers, notes = module._working_renderers()
    assert list(renderers) == ["scan", "embree"]
    assert notes == ["pybullet is left out: pybullet cannot be imported (no module): it needs Python 3.11"]


@pytest.mark.parametrize(("works", "note"), [(True, "EGL draws with Acme"), (False, "EGL does not work here: Acme")])
def test_egl_is_checked_where_it_works(monkeypatch, works, note):
    pytest.importorskip("pybullet")
    monkeypatch.setattr(module, "probe", lambda: Egl(works, False, "Acme"))
    renderers, notes = module._working_renderers()
    assert ("pybullet, EGL" in renderers) == works and len(notes) == 1 and note in notes[0]


def test_a_shift_on_planes_or_one_that_is_not_known_is_no_agreement():
    views = Agreement(1, 1.0, 1.0, np.zeros(2), np.zeros(2))
    assert RendererCheck(views, np.zeros(2)).good
    assert not RendererCheck(views, np.array([0.0, 0.06])).good
    assert not RendererCheck(None, np.array([np.nan, 0.0])).good
    assert RendererCheck(None, np.array([np.nan, 0.0])).report()["planes_px"] == [None, 0.0]
