"""Every link and picture of the pages leads somewhere, and the site's navigation names every page."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [
        *ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.md"),
        ROOT / "m3depth" / "weights" / "MODEL_CARD.md",
    ]
)  # fmt: skip
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.DOTALL | re.MULTILINE)
# Pages that the site makes from the code, or from files outside docs/.
MADE = re.compile(r"reference/(commands|api)-\w+\.md|reference/marsnav-v0\.md")
OUTSIDE = {"contributing.md", "changelog.md", "results/model-card.md", "examples/README.md"}


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as they are made of their words."""
    heads = re.findall(
        r"^#+ (.+)$", re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S), re.M
    )
    return {re.sub(r"[^\w\- ]", "", head.replace("`", "").lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_relative_link_of_a_page_leads_to_a_file(page):
    for link in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        target, _, anchor = link.partition("#")
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), f"{name(page)}: {link}"
        assert not anchor or anchor in anchors(file), f"{name(page)}: {link}"


def test_the_only_addresses_on_the_network_are_those_of_others():
    known = (
        "https://gymnasium.farama.org",
        "https://download.pytorch.org/whl/cpu",
        "https://zenodo.org/records/14286916",
        "https://arxiv.org/abs/2505.14159",
    )
    for page in PAGES:
        for address in re.findall(r"https?://[^\s)\"'`>]+", page.read_text(encoding="utf-8")):
            assert address.startswith(known), f"{name(page)}: {address}"


def test_the_navigation_of_the_site_names_every_page_once():
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    listed = list(leaves(config["nav"]))
    written = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert len(listed) == len(set(listed))
    assert written <= set(listed)
    examples = {
        f"examples/{file.stem}.md" for file in (ROOT / "examples").iterdir() if file.suffix in (".py", ".ipynb")
    }
    assert examples <= set(listed)
    assert all(page in written | OUTSIDE | examples or MADE.fullmatch(page) for page in listed)


def leaves(nav):
    for item in nav:
        for value in item.values() if isinstance(item, dict) else [item]:
            if isinstance(value, list):
                yield from leaves(value)
            else:
                yield value


def test_the_site_takes_nothing_from_the_network():
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    assert config["theme"]["font"] is False
    assert "extra_javascript" not in config
    polyfills = config["extra"]["polyfills"]
    assert any("iframe-worker" in file for file in polyfills)  # else the plugin offline adds one from the network
    for file in [*config["extra_css"], *polyfills]:
        text = (ROOT / "docs" / file).read_text(encoding="utf-8")
        assert not re.search(r"https?:|//\w|@import|url\(", text), file


def test_the_site_names_the_licence_of_the_project():
    copyright_line = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["copyright"]
    licence, _, rest = (ROOT / "LICENSE").read_text(encoding="utf-8").partition("\n")
    assert copyright_line == f"{rest.strip().splitlines()[0]}. {licence}."


def test_no_picture_is_large_and_each_is_shown():
    shown = {
        (page.parent / link).resolve() for page in PAGES for link in LINK.findall(page.read_text(encoding="utf-8"))
    }
    for picture in (ROOT / "docs" / "images").iterdir():
        assert picture.resolve() in shown, f"{picture.name} is on no page"
        if picture.name.startswith("guide_"):
            assert picture.stat().st_size < 100_000, picture.name
