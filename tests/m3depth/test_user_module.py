import importlib
import platform
import re
import sys

import pytest

from envs.drivers.by_name import make_driver
from m3depth.estimator import load_estimator
from m3depth.user_module import ChangedModuleError, import_user_module

METHOD = "class Method:\n    number = {}\n    def infer(self, left, right, rig): ...\n"


@pytest.fixture
def module(tmp_path, monkeypatch):
    """The file of a module with a method, which can be imported as `edited`, and no longer after the test."""
    file = tmp_path / "edited.py"
    file.write_text(METHOD.format(1))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # bytecode of the same second and size would pass for new
    yield file
    sys.modules.pop("edited", None)


def test_a_module_that_was_edited_after_its_import_is_refused(module):
    """Its digest would be recorded with figures of the old code."""
    assert load_estimator("edited:Method").number == load_estimator("edited:Method").number == 1
    module.write_text(METHOD.format(2))
    message = f"on {platform.node()}, {module} has changed since Python imported it; start this process or worker again"
    with pytest.raises(ChangedModuleError, match=f"^{re.escape(message)}$"):
        import_user_module("edited")
    for make, field in ((load_estimator, "estimator 'edited:Method'"), (make_driver, "`driver` 'edited:Method'")):
        with pytest.raises(ValueError, match=f"^{field}.*: {re.escape(message)}$"):
            make("edited:Method")
    module.write_text(METHOD.format(1))
    assert load_estimator("edited:Method").number == 1


def test_a_module_that_was_reloaded_is_taken(module):
    assert load_estimator("edited:Method").number == 1
    module.write_text(METHOD.format(2))
    importlib.reload(sys.modules["edited"])
    assert load_estimator("edited:Method").number == 2


def test_a_module_whose_file_is_gone_or_that_has_none_is_taken(module):
    assert import_user_module("sys") is sys
    import_user_module("edited")
    module.unlink()
    assert load_estimator("edited:Method").number == 1
