import pytest

from marssim.base.compute import free_memory as module
from marssim.base.compute.free_memory import free_memory


@pytest.fixture
def group(tmp_path, monkeypatch):
    """The control group of this process, in its parent; return a function that sets the limit of either [bytes]."""
    (tmp_path / "own").write_text("1:name=systemd:/\n0::/job/step\n")
    monkeypatch.setattr(module, "GROUP", tmp_path / "own")
    monkeypatch.setattr(module, "LIMITS", tmp_path / "groups")
    monkeypatch.setattr("os.sysconf", {"SC_AVPHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}.__getitem__)

    def limit(name, most, used=0, files=0):
        folder = tmp_path / "groups" / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "memory.max").write_text(f"{most}\n")
        (folder / "memory.current").write_text(f"{used}\n")
        (folder / "memory.stat").write_text(f"anon 5\ninactive_file {files}\n")

    return limit


def test_it_is_what_is_free_on_the_machine_where_nothing_limits_it(group):
    assert free_memory() == 4_096_000
    group("job/step", "max")
    assert free_memory() == 4_096_000
    group("job", 8_000_000)
    assert free_memory() == 4_096_000


def test_it_is_what_is_left_of_the_smallest_limit(group):
    group("job/step", 3_000_000, used=2_000_000, files=500_000)
    assert free_memory() == 1_500_000
    group("job", 1_000_000)
    assert free_memory() == 1_000_000
    group("job", 1_000_000, used=1_200_000)
    assert free_memory() == 0


def test_it_is_2_gb_where_the_system_does_not_report_it(group, monkeypatch):
    def unknown(name):
        raise ValueError("unrecognized configuration name")

    monkeypatch.setattr("os.sysconf", unknown)
    assert free_memory() == 2 << 30
