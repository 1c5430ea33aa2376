"""The pages of README.md and docs/, and the module that makes the reference."""

import importlib.util
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCORING = "docs/scoring"


def _script(name: str, folder: str = "docs"):
    """Import FOLDER/NAME.py."""
    spec = importlib.util.spec_from_file_location(name, ROOT / folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def reference_pages():
    """docs/reference_pages.py, which mkdocs finds beside its hooks."""
    return _script("reference_pages")


@pytest.fixture(scope="session")
def dead_links():
    """docs/dead_links.py, which mkdocs finds beside its hooks."""
    return _script("dead_links")


@pytest.fixture(scope="session")
def hooks(reference_pages, dead_links):
    """docs/hooks.py, which finds its modules beside it. Skips where mkdocs is not installed."""
    pytest.importorskip("mkdocs")
    return _script("hooks")


@pytest.fixture(scope="session")
def score_manifest():
    """docs/scoring/score_manifest.py, which finds manifest_summary beside it."""
    return [_script(name, SCORING) for name in ("manifest_summary", "score_manifest")][-1]


@pytest.fixture(scope="session")
def manifest_summary(score_manifest):
    """docs/scoring/manifest_summary.py."""
    return sys.modules["manifest_summary"]


@pytest.fixture(scope="session")
def compare_methods(manifest_summary):
    """docs/scoring/compare_methods.py, which finds its modules beside it."""
    return [
        _script(name, SCORING) for name in ("method_records", "methods_page", "training_curves", "compare_methods")
    ][-1]


@pytest.fixture(scope="session")
def longer_trainings(compare_methods):
    """docs/scoring/longer_trainings.py, which finds method_records beside it."""
    return _script("longer_trainings", SCORING)


@pytest.fixture(scope="session")
def plane_corrected():
    """docs/scoring/plane_corrected.py."""
    return _script("plane_corrected", SCORING)


@pytest.fixture(scope="session")
def receptive_field():
    """docs/receptive_field.py."""
    return _script("receptive_field")


@pytest.fixture(scope="session")
def refinement_steps():
    """docs/refinement_steps.py."""
    return _script("refinement_steps")


@pytest.fixture(scope="session")
def photometric_residual():
    """docs/photometric_residual.py."""
    return _script("photometric_residual")


@pytest.fixture(scope="session")
def method_drives():
    """docs/scoring/method_drives.py."""
    return _script("method_drives", SCORING)


@pytest.fixture(scope="session")
def rover_in_view():
    """docs/scoring/rover_in_view.py."""
    return _script("rover_in_view", SCORING)
