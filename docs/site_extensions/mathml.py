"""Equations as MathML, which browsers show by themselves: no script, and nothing from the network."""

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.errors import SphinxError
from sphinx.writers.html5 import HTML5Translator


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the renderer `mathml` for equations in lines and on lines of their own."""
    app.add_html_math_renderer("mathml", (_write_inline, None), (_write_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _converted(node: nodes.Element, as_block: bool) -> str:
    text = node.astext().strip()
    if as_block and r"\\" in text and r"\begin{" not in text:
        text = rf"\begin{{aligned}}{text}\end{{aligned}}"
    try:
        return tex2mathml(text, as_block=as_block)
    except MathError as error:
        raise SphinxError(f"equation {text!r}: {error}") from error


def _write_inline(translator: HTML5Translator, node: nodes.Element) -> None:
    translator.body.append(_converted(node, as_block=False))
    raise nodes.SkipNode


def _write_display(translator: HTML5Translator, node: nodes.Element) -> None:
    translator.body.append(f'<div class="equation">{_converted(node, as_block=True)}</div>\n')
    raise nodes.SkipNode
