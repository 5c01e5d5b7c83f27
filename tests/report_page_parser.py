"""Report pages as a test sees them: tags, text and data of the charts."""

import html
import re
from html.parser import HTMLParser
from pathlib import Path

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.page.html_report import write_report

_VOID = {"meta", "img", "br", "wbr", "link", "source", "input"}


class ReportPage(HTMLParser):
    """Parser that collects tags, text and data, and checks that elements are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.data = ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "script" not in self.open:
            self.text.append(data)
        elif self.tags[-1][1].get("id") == "page-data":
            self.data += data


def rendered_page(campaign: CampaignResults, run_id: int | None = None) -> ReportPage:
    """Writes the report of a campaign and parses its page."""
    return ReportPage(write_report(campaign, run_id).read_text())


def page_text(page: ReportPage) -> str:
    """Text of a page with single spaces, and none before the stop that follows an explained term."""
    return re.sub(r" ([.,;:])(?= |$)", r"\1", re.sub(r"\s+", " ", " ".join(page.text)))


def shown_commands(page: Path) -> list[str]:
    """Shell commands in the text of a page."""
    found = re.findall(r"<code>\s*(rpojax .*?)</code>", page.read_text(), re.DOTALL)
    return [html.unescape(command) for command in found]
