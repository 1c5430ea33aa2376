import subprocess
import sys

import pytest


def run(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


def test_import_prints_nothing_and_leaves_stdout_usable():
    pytest.importorskip("pybullet")
    done = run("from marssim.engines.bullet import import_pybullet; p = import_pybullet(); print(p.__name__)")
    assert done.stdout == "pybullet\n" and done.stderr == ""


def test_missing_pybullet_is_one_line():
    code = (
        "import sys; sys.meta_path.insert(0, type('Block', (), {'find_spec': staticmethod("
        "lambda name, *a: (_ for _ in ()).throw(ModuleNotFoundError('no module')) if name == 'pybullet' else None)}))\n"
        "from marssim.engines.bullet import import_pybullet\n"
        "try: import_pybullet()\n"
        "except ImportError as error: print(error)"
    )
    out = run(code).stdout
    assert out.count("\n") == 1 and "`pip install pybullet" in out
