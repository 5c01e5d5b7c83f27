"""Reasons for a missing contact sheet."""

from report_page_parser import ReportPage, page_text, rendered_page

from rpojax.report.page.html_report import write_report


def test_reason_for_missing_images_is_shown(campaign):
    campaign.info["scenario"]["camera"]["model"] = "rendered"
    assert "The images cannot be rendered again: " in page_text(rendered_page(campaign))
    write_report(campaign, film=False)
    assert "They were left out by --no-film." in page_text(ReportPage((campaign.directory / "report.html").read_text()))
