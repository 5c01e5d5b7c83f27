"""The documentation site builds without warnings and network, its links lead somewhere, and it fits a phone."""

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest
from build_site import ROOT, build
from headless_browser import BROWSER, browse, view_options

pytestmark = pytest.mark.slow

NEEDS_BROWSER = pytest.mark.skipif(BROWSER is None, reason="needs Chromium")


class Page(HTMLParser):
    """Links of a page, and the names that can be linked to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {key: value or "" for key, value in attrs}
        self.names |= {found[key] for key in ("id", "name") if key in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        source = found.get("src") or (found.get("href") if tag == "link" else None)
        if source:
            self.loaded.append(source)


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    """All pages of the site."""
    return {path: Page(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}


def test_the_site_has_a_front_page_and_one_of_each_source(site: Path) -> None:
    assert (site / "index.html").exists()
    sources = [path.relative_to(ROOT) for path in (ROOT / "docs").rglob("*.md") if "made" not in path.parts]
    assert [path for path in sources if not (site / path).with_suffix(".html").exists()] == []


def test_every_internal_link_leads_to_a_page_and_a_place_in_it(site: Path, pages: dict[Path, Page]) -> None:
    broken = []
    for path, page in pages.items():
        for link in {*page.links, *page.loaded}:
            address, _, name = link.partition("#")
            if re.match(r"[a-z]+:", link) or link in ("", "#"):
                continue
            target = (path.parent / unquote(address.partition("?")[0])).resolve() if address else path
            known = pages.get(target)
            if not target.exists() or (name and known and unquote(name) not in known.names):
                broken.append(f"{path.relative_to(site)}: {link}")
    assert broken == []


def test_nothing_is_loaded_from_elsewhere(pages: dict[Path, Page]) -> None:
    assert {source for page in pages.values() for source in page.loaded if re.match(r"(https?:)?//", source)} == set()


def test_external_links_are_well_formed(pages: dict[Path, Page]) -> None:
    external = {link for page in pages.values() for link in page.links if re.match(r"[a-z]+:", link)}
    assert len(external) > 10
    well_formed = re.compile(r"https?://[a-z0-9-]+(\.[a-z0-9-]+)+(/[^\s<>\"']*)?")
    assert {link for link in external if not well_formed.fullmatch(link)} == set()


def test_no_page_shows_markup_that_was_not_understood(pages: dict[Path, Page], site: Path) -> None:
    for path in pages:
        text = re.sub(r"<(pre|code|script|style)\b.*?</\1>", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        visible = re.sub(r"<[^>]+>", "", text)
        assert not re.search(r"\]\([^)]*\)|\$\$|```|\{index\}", visible), path.relative_to(site)


@NEEDS_BROWSER
@pytest.mark.parametrize("name", ["index", "theory/orbit_filter", "reference/scenario_keys", "tutorial/first_campaign"])
def test_a_page_fits_the_width_of_a_phone(site: Path, name: str) -> None:
    assert excess_width(site / "docs" / f"{name}.html", 390) <= 0


@NEEDS_BROWSER
def test_the_ground_is_dark_where_the_reader_wants_it(site: Path) -> None:
    page = site / "docs" / "theory" / "orbit_filter.html"
    assert brightness(page, dark=True) < 60 < 200 < brightness(page, dark=False)


def excess_width(page: Path, width: int) -> int:
    """Pixels by which the content is wider than the window."""
    # A window is at least 500 px wide; a frame is as narrow as it is told to be.
    frame = page.with_name(f"framed_{page.name}")
    script = (
        "setTimeout(() => { const inner = document.querySelector('iframe').contentDocument.documentElement;"
        "document.title = inner.scrollWidth - inner.clientWidth; }, 3000)"
    )
    frame.write_text(f'<iframe src="{page.name}" width="{width}" height="800"></iframe><script>{script}</script>')
    shown = browse(frame, "--allow-file-access-from-files", "--dump-dom")
    frame.unlink()
    found = re.search(r"<title>(-?\d+)</title>", shown.stdout)
    assert found, shown.stdout[:500]
    return int(found[1])


def brightness(page: Path, dark: bool) -> int:
    """Mean of the three channels of the page's ground."""
    probed = page.with_name(f"probed_{page.name}")
    script = "<script>document.title = getComputedStyle(document.body).backgroundColor</script></body>"
    probed.write_text(page.read_text(encoding="utf-8").replace("</body>", script), encoding="utf-8")
    shown = browse(probed, *view_options(1200, 900, dark), "--dump-dom")
    probed.unlink()
    found = re.search(r"<title>rgba?\((\d+), (\d+), (\d+)", shown.stdout)
    assert found, shown.stdout[:500]
    return sum(map(int, found.groups())) // 3


@NEEDS_BROWSER
def test_the_gallery_has_a_report_that_opens_a_pdf_a_film_and_a_recording(tmp_path: Path) -> None:
    built = build(tmp_path / "html")
    assert built.returncode == 0, built.stdout + built.stderr
    folder = tmp_path / "html" / "gallery"
    shown = browse(folder / "report.html", "--dump-dom").stdout
    assert "Monte Carlo campaign report" in shown
    assert 'data-drawn="yes"' in shown
    assert (folder / "brief.pdf").read_bytes().startswith(b"%PDF")
    assert (folder / "film.mp4").read_bytes()[4:8] == b"ftyp"
    assert (folder / "run.rrd").read_bytes().startswith(b"RRF")
    gallery = Page((tmp_path / "html" / "docs" / "gallery" / "index.html").read_text(encoding="utf-8"))
    assert {"../../gallery/report.html", "../../gallery/brief.pdf", "../../gallery/run.rrd"} <= {*gallery.links}
    assert "../../gallery/film.mp4" in gallery.loaded
