import pytest

from m3depth.ablation.figure import study_figure


def study(source: str) -> dict:
    change = {"interval": (-0.1, 0.2), "seed_interval": None, "paper": 0.1 if source else None, "here": 0.05}
    rows = [{"label": label, "against_reference": {"abs_rel": change}} for label in ("all", "none")]
    return {"columns": ["abs_rel"], "rows": rows, "reference": 0, "source": source}


@pytest.mark.parametrize(("source", "dots"), [("", [0, 1]), ("ablation", [0.14, 1.14])])
def test_a_row_without_the_papers_dot_stands_beside_its_label(drawn_figures, tmp_path, source, dots):
    study_figure(study(source), tmp_path / "study.png")
    (ax,) = drawn_figures[0].axes
    drawn = [(line.get_marker(), *line.get_ydata()) for line in ax.lines if len(line.get_ydata())]  # no legend's
    assert list(ax.get_yticks()) == [0, 1]
    assert [place for marker, place, *_ in drawn if marker == "o"] == pytest.approx(dots)
    assert [place for marker, place, *_ in drawn if marker == "D"] == ([-0.14, 0.86] if source else [])
