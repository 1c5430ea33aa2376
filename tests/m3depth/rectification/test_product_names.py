"""The right image of a left one, by its name."""

import pytest

from m3depth.rectification.product_names import label_beside, right_of

NAVCAM = "NLMV0709_0729882743_168RAD_N0332841TRAV00262_0A02LLJ01.IMG"
MASTCAM = "ZL0_0711_0730054943_723RAD_N0332864ZCAM03014_048085A02.IMG"
MSL = "NLB_524534514EDR_F0562034NCAM00280M_.jpeg"


@pytest.mark.parametrize("name", [NAVCAM, MASTCAM, MSL, "FLF_0709_0729882743_168RAD_N0332841.IMG"])
def test_the_same_name_with_r(tmp_path, name):
    right = tmp_path / f"{name[0]}R{name[2:]}"
    right.touch()
    assert right_of(tmp_path / name) == right


def test_another_version_of_the_right_product(tmp_path):
    right = tmp_path / NAVCAM.replace("NLMV", "NRMV").replace("LLJ01", "LLJ02")
    right.touch()
    (tmp_path / right.name.replace(".IMG", ".xml")).touch()
    assert right_of(tmp_path / NAVCAM) == right
    (tmp_path / right.name.replace("LLJ02", "LLJ03")).touch()
    with pytest.raises(ValueError, match="several right images belong to it"):
        right_of(tmp_path / NAVCAM)


@pytest.mark.parametrize(
    ("name", "says"),
    [(NAVCAM, "the right image of NLMV.* is missing"), ("left.png", "give the right image too"),
     (NAVCAM.replace("NL", "NR"), "give the right image too")],
)  # fmt: skip
def test_none(tmp_path, name, says):
    with pytest.raises(FileNotFoundError, match=says):
        right_of(tmp_path / name)


def test_the_label_beside_a_product_has_its_name_whatever_its_signs(tmp_path) -> None:
    for name in ("x[1].img", "x[1].lbl", "x1.lbl"):
        (tmp_path / name).touch()
    assert label_beside(tmp_path / "x[1].img") == tmp_path / "x[1].lbl"
