"""Against the CommonMark parser of markdown-it-py, with the tables, links and strikethrough of GitHub."""

import re
from html import unescape

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from marssim.base.files.markdown import as_text, in_table

WORDS = st.text(
    st.characters(exclude_categories=("Cs", "Cc")) | st.sampled_from("<>&|*_`[]()!#~\\:/.\n@-+1 "), max_size=40
)


@given(WORDS)
@example("<iframe srcdoc='<script>alert(1)</script>'></iframe>")
@example("![x](/abs/file.png) [a](javascript:b) https://example.org www.a.org a@b.org")
@example("1. one\n\n# two\n\n    three &lt; ``four`` ~~five~~")
def test_words_become_the_same_words_and_no_markup(words):
    shown = MarkdownIt("gfm-like", {"linkify": False}).render("x" + as_text(words))
    assert re.fullmatch("<p>[^<>]*</p>\n", shown)
    assert unescape(shown[3:-5]) == ("x" + " ".join(words.split()))


@pytest.mark.parametrize("name", ["a|b", "<b>", "\\|", "C:\\nets\\", "<img src=x onerror=alert(1)>", "![a](b) `c` [d]"])
def test_a_name_stays_in_its_cell(name):
    shown = MarkdownIt("gfm-like", {"linkify": False}).render(f"| a | b |\n|---|---|\n| {in_table(name)} | 1 |\n")
    cells = re.findall("<td>(.*?)</td>", shown)
    assert [unescape(cell) for cell in cells] == [name, "1"] and not re.search("<(b|img|a|code)\\b", shown)
