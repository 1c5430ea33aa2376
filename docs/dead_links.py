"""Finds the links of a built site that lead nowhere."""

from __future__ import annotations

import os
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Page(HTMLParser):
    """The links of a page, to other pages, pictures, scripts and styles, and the names that links can point at."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.links |= {value for key in ("href", "src") if (value := values.get(key))}
        self.anchors |= {value for key in ("id", "name" if tag == "a" else "id") if (value := values.get(key))}


def dead_links(site: Path) -> list[str]:
    """Return the relative links of a site that lead to no file or to no anchor of a page, as "PAGE: LINK".

    Args:
        site: Folder of the built site. Its page 404.html is left out: a server shows it at any address.
    """
    pages = {page: _Page(page.read_text(encoding="utf-8")) for page in sorted(site.rglob("*.html"))}
    dead = []
    for page, content in pages.items():
        for link in sorted(content.links) if page != site / "404.html" else ():
            address = urlsplit(link)
            if address.scheme or address.netloc:
                continue
            target = Path(os.path.normpath(page.parent / unquote(address.path))) if address.path else page
            anchor = unquote(address.fragment)
            if not target.is_file() or (anchor and target in pages and anchor not in pages[target].anchors):
                dead.append(f"{page.relative_to(site).as_posix()}: {link}")
    return dead
