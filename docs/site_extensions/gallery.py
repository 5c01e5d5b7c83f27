"""Files of the gallery in the site, such as a report that opens; docs/make_gallery.py makes them before the build."""

import shutil
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

_ROOT = Path(__file__).parents[2]
_FOLDER = "gallery"
"""Folder of the files in the built site."""
_LOGGER = logging.getLogger(__name__)


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the directive `gallery-file` and the copy of the files."""
    app.add_config_value("gallery_files", "", "env")
    app.add_directive("gallery-file", GalleryFile)
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


class GalleryFile(SphinxDirective):
    """A link to a file of the gallery with its size, or the film itself; the content is the text of the link."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """A paragraph, or a player for a film; a warning if the file was not made."""
        name, text = self.arguments[0], " ".join(self.content)
        if not self.config.gallery_files:
            return [nodes.paragraph("", f"{text}: not in this build, which was made without the files of the gallery.")]
        file = _ROOT / self.config.gallery_files / name
        if not file.exists():
            _LOGGER.warning(
                "gallery: found no %s, expected it from docs/make_gallery.py", file, location=self.get_location()
            )
            return []
        link = f"{'../' * self.env.docname.count('/')}{_FOLDER}/{name}"
        if file.suffix == ".mp4":
            player = f'<video controls loop muted playsinline preload="metadata" src="{link}"></video>'
            return [
                nodes.raw("", f'<figure class="film">{player}<figcaption>{text}</figcaption></figure>', format="html")
            ]
        size = f"{file.stat().st_size / 1e6:.1f} MB"
        shown = f'<p><a class="gallery-file" href="{link}">{text}</a> <span class="size">({size})</span></p>'
        return [nodes.raw("", shown, format="html")]


def _copy(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.config.gallery_files:
        shutil.copytree(_ROOT / app.config.gallery_files, Path(app.outdir) / _FOLDER, dirs_exist_ok=True)
