"""The pages' Markdown shows what their authors mean: lists are lists, and sentences are not."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [
        *ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.md"),
        ROOT / "m3depth" / "weights" / "MODEL_CARD.md",
    ]
)  # fmt: skip
NARROW = [
    ROOT / "README.md",
    *sorted((ROOT / "docs" / "start").glob("*")),
    *sorted((ROOT / "docs" / "guides").glob("*")),
]
COMMAND = re.compile(r"^ {4}(?:PATH=\S+ )?(?:python|torchrun|make|pip|git) .*(?:(?<=\\)\n.*)*", re.MULTILINE)
WIDTH = 80  # columns that a page of the site shows of code
MARKER = re.compile(r"( *)(?:(\d+)[.)]|[-*+])(?: |$)")


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def text(page: Path) -> str:
    """Return a page without its blocks of code between fences."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def stray_markers(markdown: str) -> Iterator[str]:
    """Yield the lines that start an item of no list: those directly after text that holds no item before."""
    items: dict[int, str | None] = {}  # number, or None of a bullet, of the last item by indentation
    after_text = False
    for line in markdown.splitlines():
        if not line.strip():
            items, after_text = {}, False
            continue
        if marker := MARKER.match(line):
            indent, number = len(marker[1]), marker[2]
            if after_text and not (indent in items and follows(items[indent], number)):
                yield line
            items = {column: last for column, last in items.items() if column < indent} | {indent: number}
        after_text = True


def follows(last: str | None, number: str | None) -> bool:
    """Return whether two items are of one list: both bullets, or with numbers in order."""
    if last is None or number is None:
        return last is number
    return int(number) == int(last) + 1


def test_a_sentence_that_ends_with_a_number_at_the_start_of_a_line_is_a_stray_marker():
    assert list(stray_markers("- It exits with\n  2. Only a reader ends it.\n")) == ["  2. Only a reader ends it."]
    assert list(stray_markers("a difference of 3\n- 2 px\n")) == ["- 2 px"]
    assert list(stray_markers("1. One,\n   two.\n2. Three.\n\n- Four\n- five\n\n  6. Seven.\n")) == []


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_no_line_inside_a_sentence_starts_a_list(page):
    assert list(stray_markers(text(page))) == []


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_picture_has_a_caption_and_words_that_describe_it(page):
    """The caption is a paragraph in italics, directly below the picture."""
    blocks = text(page).split("\n\n")
    for block, below in zip(blocks, [*blocks[1:], ""], strict=True):
        if picture := re.match(r"\s*!\[([^\]]*)\]\([^)]+\)", block):
            assert re.fullmatch(r"\s*\*[^*\s].*[^*\s]\*\s*", below, re.DOTALL), f"{name(page)}: {picture[0]}"
            assert len(picture[1].split()) > 1, f"{name(page)}: {picture[0]}"


def test_no_two_pages_have_the_same_title():
    titles = [re.search(r"^# (.+)$", text(page), re.MULTILINE)[1] for page in PAGES if page.name != "README.md"]
    assert len(set(titles)) == len(titles)


@pytest.mark.parametrize("page", NARROW, ids=name)
def test_the_commands_of_the_guides_are_as_narrow_as_the_pages_show_them(page):
    lines = [line for command in COMMAND.findall(text(page)) for line in command.splitlines()]
    assert [line for line in lines if len(line) > 4 + WIDTH] == []
