"""Commands shown in the report can be run as they stand."""

import ast
import inspect

from report_page_parser import page_text, rendered_page

from rpojax.campaign.rerun import rerun


def test_rerun_command_names_the_campaign_folder(build):
    campaign = build(runs=12, failed=(4,))
    command = f"rpojax rerun {campaign.directory} --run-id"
    words = page_text(rendered_page(campaign))
    assert f"Repeat a run {command} I --out DIR" in words
    assert f"{command} 4 --out run_4" in words


def test_replaced_stages_are_shown_and_needed_for_a_rerun(build):
    campaign = build(runs=12, failed=(4,))
    campaign.info["stages"] = {"formation_law": {"function": "mine.pd_law", "source_sha256": "ab" * 32}}
    words = page_text(rendered_page(campaign))
    assert f"Replaced stages formation_law = mine.pd_law, source {'ab' * 32}" in words
    assert "rpojax rerun " not in words
    found = f"rpojax.Campaign({str(campaign.directory)!r})"
    command = f"rpojax.campaign.rerun.rerun({found}, 4, pathlib.Path('run_4'), stages=...)"
    assert command in words
    call = ast.parse(command, mode="eval").body
    assert isinstance(call, ast.Call)
    inspect.signature(rerun).bind(*call.args, **{str(word.arg): word.value for word in call.keywords})
