import pytest

from marssim.base.command.wording import where_to_run, without_middle


@pytest.mark.parametrize(
    ("module", "missing", "hint"),
    [
        ("my_driver", "my_driver", "; run python -m in the folder of my_driver.py, or put this folder on PYTHONPATH"),
        ("mine.driver", "mine", "; run python -m in the folder of mine, or put this folder on PYTHONPATH"),
        ("mine.driver", "mine.driver", "; run python -m in the folder of mine, or put this folder on PYTHONPATH"),
        ("my_driver", "cupy", ""),  # my_driver.py imports it
        ("my_driver", "my", ""),
        ("my_driver.py", "my_driver", "; name it as my_driver"),
        ("my_driver.py", "my_driver.py", "; name it as my_driver"),
        ("sub/my.py", "sub/my", "; name it as sub.my"),
        ("sub/my", "sub/my", "; name it as sub.my"),
        ("/a/my.py", "/a/my", "; name it as my, and run python -m in /a"),
    ],
)
def test_a_module_that_is_not_found_gets_a_hint(module, missing, hint):
    assert where_to_run(ModuleNotFoundError(f"No module named {missing!r}", name=missing), module) == hint


def test_an_import_that_fails_otherwise_gets_none():
    assert where_to_run(ImportError("cannot import name 'x'", name="my_driver"), "my_driver") == ""


def test_a_long_text_loses_its_middle():
    assert without_middle("0123456789", 10) == "0123456789"
    assert without_middle("0123456789", 5) == "012...89" and without_middle("0123456789", 2) == "0...9"
