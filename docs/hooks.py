"""Hooks of mkdocs: pages made from the code, pages that lie outside docs/, and links between all of them."""

from __future__ import annotations

import json
import logging
import os
import re
from pathlib import Path
from typing import Any

from dead_links import dead_links
from mkdocs.structure.files import File, Files
from reference_pages import ROOT, pages

# Markdown files outside docs/ that are pages of the site, by the path of the page.
OUTSIDE = {
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
    "results/model-card.md": "m3depth/weights/MODEL_CARD.md",
    "examples/README.md": "examples/README.md",
}
# Source files that have a page of their own in the reference.
REFERENCE = {"envs/mars_nav.py": "reference/marsnav-v0.md"}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_PAGE_NAME = re.compile(r"(?<!\[)`(reference/[\w-]+)`")
_LINKED = re.compile(r"(<a\b.*?</a>)", re.DOTALL)
_PICTURE = re.compile(r"<img\b[^>]*\bsrc=\"(?!data:)([^\"]+)\"[^>]*>")
GLOSSARY = "start/glossary.md"
_LOG = logging.getLogger("mkdocs.hooks")


def sources() -> dict[str, Path]:
    """Return the file that each page outside docs/ is made from, by the path of the page."""
    found = {page: ROOT / source for page, source in OUTSIDE.items()}
    for file in sorted((ROOT / "examples").glob("*.py")) + sorted((ROOT / "examples").glob("*.ipynb")):
        found[f"examples/{file.stem}.md"] = file
    return found


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are not in docs/, and the pictures of notebooks."""
    for page, content in pages().items():
        files.append(File.generated(config, page, content=content))
    for page, source in sources().items():
        files.append(File.generated(config, page, content=markdown(source)))
    return files


def on_page_markdown(text: str, page: Any, config: Any, files: Files) -> str:
    """Point links at pages of the site, and make links of the names of pages that are made from the code.

    A link to another file of the repository becomes its label, or the file's path where the label is only its name.
    """
    path = page.file.src_uri
    if path == GLOSSARY:
        page.meta["search"] = {"boost": 3}  # a search for a term finds it there first
    source = sources().get(path, ROOT / "docs" / path)
    by_source = {os.path.normpath(file): name for name, file in sources().items()}
    by_source |= {os.path.normpath(ROOT / file): name for file, name in REFERENCE.items()}

    def relative(target: str) -> str:
        return os.path.relpath(target, os.path.dirname(path) or ".").replace(os.sep, "/")

    def redirected(match: re.Match[str]) -> str:
        picture, label, link = match.groups()
        if re.match(r"[a-z]+:|#", link):
            return match[0]
        target, mark, anchor = link.partition("#")
        file = os.path.normpath(source.parent / target)
        docs = str(ROOT / "docs") + os.sep
        if file in by_source:
            inside = by_source[file]
        elif not os.path.exists(file):
            return match[0]  # mkdocs warns of it
        elif file.startswith(docs) and in_site(Path(file[len(docs) :]).as_posix(), files):
            inside = Path(file[len(docs) :]).as_posix()
        else:
            return _named(label, Path(os.path.relpath(file, ROOT)).as_posix())
        return f"{picture}[{label}]({relative(inside)}{mark}{anchor})"

    def linked(match: re.Match[str]) -> str:
        return f"[{match[0]}]({relative(match[1] + '.md')})" if in_site(match[1] + ".md", files) else match[0]

    blocks = re.split(r"(^```.*?^```)", text, flags=re.DOTALL | re.MULTILINE)
    return "".join(
        block if n % 2 else _PAGE_NAME.sub(linked, _LINK.sub(redirected, block)) for n, block in enumerate(blocks)
    )


def in_site(path: str, files: Files) -> bool:
    """Return whether a file of docs/ is part of the site."""
    file = files.get_file_from_path(path)
    return file is not None and file.inclusion.is_included()


def _named(label: str, path: str) -> str:
    """The words for a file of the repository: its path in place of a label that is only the end of its path."""
    return f"`{path}`" if f"/{path}".endswith("/" + label.strip("`")) else label


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Make each picture a link to its file, so that a click enlarges it."""
    parts = _LINKED.split(html)
    return "".join(
        part if n % 2 else _PICTURE.sub(r'<a class="picture" href="\1">\g<0></a>', part) for n, part in enumerate(parts)
    )


def on_post_build(config: Any) -> None:
    """Warn of each dead link of the site, which ends a strict build with an error."""
    for link in dead_links(Path(config.site_dir)):
        _LOG.warning("Dead link: %s", link)


def markdown(source: Path) -> str:
    """Return a file as Markdown: programs as a code block, notebooks with their outputs."""
    text = source.read_text(encoding="utf-8")
    if source.suffix == ".py":
        return f"# {source.name}\n\n```python\n{text}```\n"
    return _notebook(json.loads(text)) if source.suffix == ".ipynb" else text


def _notebook(content: dict[str, Any]) -> str:
    parts = []
    for cell in content["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
            continue
        parts.append(f"```python\n{text}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            picture = next((kind for kind in ("image/jpeg", "image/png") if kind in data), None)
            if picture:
                parts.append(f"![output](data:{picture};base64,{''.join(data[picture]).strip()})")
            elif written := "".join(output.get("text", data.get("text/plain", ""))).rstrip():
                parts.append(f"```text\n{written}\n```")
    return "\n\n".join(parts) + "\n"
