"""Notebooks: execution from top to bottom at a small size, and the outputs of the committed files."""

import ast
import importlib
import inspect
import json
import math
import os
import re
from operator import attrgetter
from pathlib import Path
from typing import Any

import fast_compile_flags
import jax
import nbformat
import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell

import rpojax

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LARGEST_BYTES = 1_500_000

QUESTIONS = """
import json
print(json.dumps({
    "ticks": len(time_s),
    "channels": sorted(run),
    "failed": [int(lqr.failed.sum()), int(pd.failed.sum())],
    "same_draws": all(bool(np.all(lqr.drawn[key] == pd.drawn[key])) for key in lqr.drawn),
    "delta_v": [float(np.median(result.metrics["delta_v_m_s"])) for result in (lqr, pd)],
    "relative_error": lqr.metrics["nav_relative_position_error_rms_m"].tolist(),
    "report": page.name,
    "report_runs": json.loads((lqr.directory / "report.json").read_text())["runs"],
}))
"""
"""A last cell that prints results of the notebook for the test."""

DERIVATIVE = "value_and_gradient"
"""Cells that name it differentiate the closed loop, which takes nearly half of the notebook's time to compile."""

DERIVATIVE_QUESTIONS = """
import json
print(json.dumps({
    "first_gradient": [float(x) for x in first_gradient],
    "central": [float(x) for x in central],
    "errors": errors,
}))
"""

TUNING_QUESTIONS = """
import json
print(json.dumps({
    "steps": [step.objective for step in tuned.result.steps],
    "values": list(tuned.values.values()),
    "derivatives": {
        metric: {key: list(values.shape) for key, values in found.derivatives[metric].items()} for metric in METRICS
    },
    "smooth": int(smooth.sum()),
    "errors": [
        float(np.abs((up.metrics[metric] - down.metrics[metric]) / (2e-4 * key_value(start, KEYS[2]))
                     - found.derivatives[metric][KEYS[2]])[smooth].max(initial=0.0)
              / np.abs(found.derivatives[metric][KEYS[2]]).max())
        for metric in METRICS
    ],
    "runs": {
        name: [int(each.failed.sum()), float(each.metrics["nees_mean"].mean())] for name, each in unseen.items()
    },
}))
"""


LINCOV_QUESTIONS = """
import json
last = int(np.searchsorted(time_s, linear.share_time_s[-1]))
print(json.dumps({
    "ticks": len(time_s),
    "completed": sampled.runs,
    "first_sigma": linear.sigma("rho_H")[0].tolist(),
    "sigma_at_last_share": float(np.linalg.norm(linear.sigma("relative_error_H")[last])),
    "budget": analysis.budget.total_at_end["relative estimation error"],
    "channels": sorted({row.channel for row in analysis.agreement}),
    "inside": inside.mean(axis=(0, 1)).tolist(),
    "believed": believed.tolist(),
}))
"""


TEAM_QUESTIONS = """
import json
print(json.dumps({
    "ticks": len(time_s),
    "names": list(names),
    "failed": [int(shared.failed.sum()), int(alone.failed.sum())],
    "errors": [float(np.median(result.metrics["nav_relative_position_error_rms_m"])) for result in (shared, alone)],
    "separation": float(shared.metrics["min_separation_m"].min()),
    "same_start": bool(np.all(shared.history(0, 1)["rho_H"][0] == alone.history(0, 1)["rho_H"][0])),
}))
"""


def executed(name: str, questions: str, folder: Path, without: str | None = None) -> dict[str, Any]:
    """Results of a notebook at the small size, executed by the running interpreter.

    Cells that hold the text `without` are left out.
    """
    notebook = committed(ROOT / "notebooks" / name)
    if without is not None:
        kept = [cell for cell in notebook.cells if without not in cell.source]
        assert len(kept) < len(notebook.cells)
        notebook.cells = kept
    notebook.cells.append(new_code_cell(questions))
    environment = {
        **os.environ,
        "RPOJAX_NOTEBOOK_SMALL": "1",
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
        "IPYTHONDIR": str(folder / "ipython"),
        "TMPDIR": str(folder),
        "XLA_FLAGS": " ".join(fast_compile_flags.FLAGS),
        # The cache of the test session: a second run has nothing to compile.
        "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir or folder / "cache"),
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    client = NotebookClient(notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": str(folder)}})
    client.execute(env=environment)
    text = "".join(output.text for output in notebook.cells[-1].outputs)
    return json.loads(text)


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Results of the notebook of the inspection mission."""
    return executed("inspection.ipynb", QUESTIONS, tmp_path_factory.mktemp("notebook"), without=DERIVATIVE)


def committed(path: Path) -> NotebookNode:
    """A notebook as it is in the repository."""
    return nbformat.read(path, as_version=4)


def code_of(path: Path) -> list[NotebookNode]:
    return [cell for cell in committed(path).cells if cell.cell_type == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_takes_from_the_package_exists_with_its_arguments(path: Path) -> None:
    used = 0
    for cell in code_of(path):
        for node in ast.walk(ast.parse(cell.source)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rpojax"):
                module = importlib.import_module(str(node.module))
                for name in node.names:
                    if not hasattr(module, name.name):
                        importlib.import_module(f"{node.module}.{name.name}")
                    used += 1
            elif isinstance(node, ast.Call) and ast.unparse(node.func).startswith("rpojax."):
                function = attrgetter(ast.unparse(node.func).removeprefix("rpojax."))(rpojax)
                named = {keyword.arg: None for keyword in node.keywords if keyword.arg}
                inspect.signature(function).bind_partial(*node.args, **named)
                used += 1
    assert used > 1


@pytest.mark.slow
def test_no_run_fails_with_either_controller(answers: dict[str, Any]) -> None:
    assert answers["ticks"] == 600
    assert answers["failed"] == [0, 0]
    # After 600 s no run must be on station yet.
    assert answers["report_runs"].pop("outcomes")["not_judged"] == 4
    assert answers["report_runs"] == {"requested": 4, "completed": 0, "failed": 0, "not_judged": 4, "missing": 0}
    assert answers["report"] == "report.html"


@pytest.mark.slow
def test_the_relative_error_in_the_small_campaign_is_below_that_of_the_hand_over(answers: dict[str, Any]) -> None:
    # 3 sigma of the hand-over's error of 1.5 m per axis, in three axes.
    assert max(answers["relative_error"]) < 3.0 * 1.5 * 3**0.5


@pytest.mark.slow
def test_the_controllers_have_the_same_dispersions_and_different_delta_v(answers: dict[str, Any]) -> None:
    assert answers["same_draws"]
    lqr, pd = answers["delta_v"]
    assert 0.0 < lqr != pd > 0.0


@pytest.mark.slow
def test_the_gradient_agrees_with_central_differences_and_the_descent_reduces_the_error(tmp_path: Path) -> None:
    found = executed("inspection.ipynb", DERIVATIVE_QUESTIONS, tmp_path)
    # The differences have a truncation error of step squared, 1e-8 relative, and rounding of 1e-11 / step.
    assert found["first_gradient"] == pytest.approx(found["central"], rel=1e-4)
    assert all(abs(slope) > 1e-3 for slope in found["central"])
    errors = found["errors"]
    assert len(errors) == 3
    assert sorted(errors, reverse=True) == errors


@pytest.mark.slow
def test_a_filter_is_tuned_and_validated(tmp_path: Path) -> None:
    found = executed("tuning.ipynb", TUNING_QUESTIONS, tmp_path)
    assert [[*shapes.values()] for shapes in found["derivatives"].values()] == [[[4]] * 3] * 2
    assert found["smooth"] >= 1
    assert max(found["errors"]) < 1e-2
    assert all(math.isfinite(value) for value in found["steps"])
    assert len(found["steps"]) == 3
    # Three steps of 0.2 reduce the noise of boxes by at most half.
    assert 5.0 < found["values"][0] < 10.0
    assert [failed for failed, _ in found["runs"].values()] == [0, 0, 0]
    assert found["runs"]["wrong"][1] != found["runs"]["tuned"][1]


@pytest.mark.slow
def test_a_linear_covariance_is_compared_with_sampled_runs(tmp_path: Path) -> None:
    found = executed("linear_covariance.ipynb", LINCOV_QUESTIONS, tmp_path)
    assert found["ticks"] == 120
    assert found["completed"] == 10
    # What the scenario disperses the start by.
    assert found["first_sigma"] == pytest.approx([2.0, 2.0, 2.0], rel=0.01)
    assert found["budget"] == pytest.approx(found["sigma_at_last_share"], rel=1e-6)
    assert {"rho_H", "relative_error_H"} <= {*found["channels"]}
    assert min(found["inside"]) > 0.5
    assert all(0.3 < ratio < 3.0 for ratio in found["believed"])


@pytest.mark.slow
def test_a_team_that_shares_its_boxes_knows_more_than_its_servicers_alone(tmp_path: Path) -> None:
    found = executed("cooperative_inspection.ipynb", TEAM_QUESTIONS, tmp_path)
    assert found["ticks"] == 300
    assert found["names"] == ["first", "second", "third"]
    assert found["failed"] == [0, 0]
    assert found["errors"][0] < 0.5 * found["errors"][1]
    assert found["separation"] > 20.0
    assert found["same_start"]


PROBABILITY_QUESTIONS = """
import json
print(json.dumps([found.interval_95, noisy.interval_95]))
"""


def test_probabilities_of_failure_are_those_that_the_notebook_states(tmp_path: Path) -> None:
    regions, noise = executed("probability.ipynb", PROBABILITY_QUESTIONS, tmp_path)
    assert regions[0] <= 2.2228e-3 <= regions[1]
    assert noise[0] <= 1.733e-4 <= noise[1]


@pytest.mark.parametrize(
    ("name", "text", "figures"),
    [
        ("cooperative_inspection.ipynb", "longest time without a box of anybody", 3),
        ("inspection.ipynb", "64 of 64 runs completed", 5),
        ("tuning.ipynb", "by hand", 3),
        ("linear_covariance.ipynb", "of 64 runs within two sigma", 4),
        ("probability.ipynb", "importance True", 1),
    ],
)
def test_a_committed_notebook_has_its_results_and_figures(name: str, text: str, figures: int) -> None:
    outputs = [output for cell in code_of(ROOT / "notebooks" / name) for output in cell.outputs]
    assert text in "".join(output.get("text", "") for output in outputs)
    assert len([output for output in outputs if "image/png" in output.get("data", {})]) >= figures


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_committed_notebook_is_valid_and_executed_from_top_to_bottom(path: Path) -> None:
    nbformat.validate(committed(path))
    cells = code_of(path)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert path.stat().st_size < LARGEST_BYTES


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_committed_notebook_has_no_errors_warnings_or_paths_of_a_machine_in_its_outputs(path: Path) -> None:
    for cell in committed(path).cells:
        for output in cell.get("outputs", []):
            assert output.output_type in {"stream", "display_data"}
            assert output.get("name", "stdout") == "stdout"
            text = output.get("text", "") + output.get("data", {}).get("text/plain", "")
            assert not re.search(r"warning|(?<![\w.])/(tmp|home|root|Users|var)/", text, re.IGNORECASE)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_links_of_a_committed_notebook_lead_to_existing_files(path: Path) -> None:
    text = "\n".join(cell.source for cell in committed(path).cells if cell.cell_type == "markdown")
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if not re.match(r"[a-z]+:", link)]
    assert links
    assert [link for link in links if not (path.parent / link).exists()] == []
