"""Hooks of mkdocs: pages made from the code, pages that lie outside docs/, and links between all of them."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

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
    """Point links at pages of the site. Links to other files of the repository become plain text."""
    path = page.file.src_uri
    source = sources().get(path, ROOT / "docs" / path)
    by_source = {os.path.normpath(file): name for name, file in sources().items()}
    by_source |= {os.path.normpath(ROOT / file): name for file, name in REFERENCE.items()}

    def redirected(match: re.Match[str]) -> str:
        picture, label, link = match.groups()
        if re.match(r"[a-z]+:|#", link):
            return match[0]
        target, mark, anchor = link.partition("#")
        file = os.path.normpath(source.parent / target)
        docs = str(ROOT / "docs") + os.sep
        if file in by_source:
            inside = by_source[file]
        elif file.startswith(docs):
            inside = Path(file[len(docs) :]).as_posix()
        elif not os.path.exists(file):
            return match[0]  # mkdocs warns of it
        else:
            return label
        link = os.path.relpath(inside, os.path.dirname(path) or ".").replace(os.sep, "/")
        return f"{picture}[{label}]({link}{mark}{anchor})"

    blocks = re.split(r"(^```.*?^```)", text, flags=re.DOTALL | re.MULTILINE)
    return "".join(block if n % 2 else _LINK.sub(redirected, block) for n, block in enumerate(blocks))


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
