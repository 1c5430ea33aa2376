import pytest

from marssim.base.view import show as show_module
from marssim.base.view.show import check_viewer, directions, has_desktop, show


def test_who_comes_by_ssh_is_given_the_tunnel_and_no_browser_opens():
    lines = directions("http://127.0.0.1:8081", {"SSH_CONNECTION": "10.0.0.2 5000 10.0.0.1 22", "DISPLAY": ":0"})
    assert len(lines) == 2 and "ssh -N -L 8081:127.0.0.1:8081 HOST" in lines[1]
    assert not has_desktop({"SSH_CONNECTION": "10.0.0.2 5000 10.0.0.1 22", "DISPLAY": ":0"})


def test_who_sits_here_is_given_the_address(monkeypatch):
    (line,) = directions("http://127.0.0.1:8080", {})
    assert line.startswith("view: http://127.0.0.1:8080 ")
    monkeypatch.setattr("sys.platform", "linux")
    assert has_desktop({"WAYLAND_DISPLAY": "wayland-0"}) and not has_desktop({})


def test_a_missing_viser_is_one_line_that_names_the_extra(monkeypatch):
    monkeypatch.setattr(show_module, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r'the viewer in the browser needs viser: pip install "mars-m3depth\[view\]"'):
        check_viewer()


def test_ctrl_c_closes_the_page_and_is_no_error(monkeypatch, capsys):
    events = []

    class Recorded:
        address = "http://127.0.0.1:1"

        def __init__(self, shots, title):
            events.append((shots, title))

        def __enter__(self):
            return self

        def __exit__(self, kind, *rest):
            events.append(kind)

    def interrupt(seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr(show_module, "Page", Recorded)
    monkeypatch.setattr(show_module, "has_desktop", lambda environment: False)
    monkeypatch.setattr(show_module.time, "sleep", interrupt)
    show(["shot"], "Mars")
    assert events == [(["shot"], "Mars"), KeyboardInterrupt]
    assert capsys.readouterr().out.startswith("view: http://127.0.0.1:1 ")
