"""Source files that pages link to, as pages of the site with coloured text: equation and code lie side by side."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

_ROOT = Path(__file__).parents[2]
_LANGUAGES = {".py": "python", ".toml": "toml"}


def setup(app: Sphinx) -> dict[str, bool]:
    """Turns links to source files into links to such pages, and adds the pages."""
    app.connect("doctree-read", _link_to_pages)
    app.connect("html-collect-pages", _pages)
    return {"parallel_read_safe": False, "parallel_write_safe": True}


def _link_to_pages(app: Sphinx, doctree: nodes.document) -> None:
    linked = _linked(app)
    for node in list(doctree.findall(addnodes.download_reference)):
        source = _source(app, str(node["reftarget"]))
        if source is None:
            continue
        linked.add(source)
        address = app.builder.get_relative_uri(app.env.docname, f"source/{source}")
        link = nodes.reference("", "", *node.children, internal=True, refuri=address)
        node.replace_self(link if isinstance(node.parent, nodes.TextElement) else nodes.paragraph("", "", link))


def _linked(app: Sphinx) -> set[str]:
    """Source files that pages have linked to, over all builds that share an environment."""
    if not hasattr(app.env, "linked_sources"):
        app.env.linked_sources = set()  # pyright: ignore[reportAttributeAccessIssue]
    return app.env.linked_sources  # pyright: ignore[reportAttributeAccessIssue]


def _source(app: Sphinx, target: str) -> str | None:
    """Path of a source file in the repository, None for anything else."""
    relative, absolute = app.env.relfn2path(target, app.env.docname)
    file = Path(absolute)
    return str(relative) if file.suffix in _LANGUAGES and file.is_file() and file.is_relative_to(_ROOT) else None


def _pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    for source in sorted(_linked(app)):
        file = _ROOT / source
        text = file.read_text(encoding="utf-8")
        body = app.builder.highlighter.highlight_block(text, _LANGUAGES[file.suffix])  # pyright: ignore
        yield f"source/{source}", {"title": source, "body": f"<h1>{source}</h1>\n{body}"}, "page.html"
