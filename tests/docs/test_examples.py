"""Every example runs and reports what it should: enough right actions, the better policy, or who is good."""

from __future__ import annotations

import contextlib
import io
import json
import re
import runpy
from pathlib import Path

import matplotlib
import pytest
from matplotlib import pyplot

EXAMPLES = Path(__file__).parents[2] / "examples"
LEAST = {"plot_torch_loop.py": 0.88, "plot_weighted_sampler.py": 0.9, "plot_skorch.py": 0.95}
"""Share of right actions on the last printed line."""

PRINTED = {
    "plot_ranking.py": r"Nobody differs clearly.*score: 0\.6\d\n",
    "plot_steps.py": r"mean trust: 0\.[01]\d in slips, 0\.9\d in all other steps\n",
    "plot_methods.py": r"together: two groups; .*within each day: .*'outlier': 10.*RPIL +AUROC 1\.00\n",
    "plot_step_weights.py": r"0\.0\d in a gust.*alike: 1\d of 30 reach.*\nstep weights: 2\d of 30 reach the goal\n",
}
"""Of the examples that the site shows with their results: patterns of what they print."""


@pytest.fixture(autouse=True, scope="module")
def no_window():
    backend = matplotlib.get_backend()
    matplotlib.use("agg")
    yield
    pyplot.close("all")
    matplotlib.use(backend)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*LEAST, *PRINTED])
def test_examples(name, capsys):
    if name in LEAST:
        pytest.importorskip("skorch", reason="torch or skorch is not installed: pip install 'rpil[torch]'")
    runpy.run_path(str(EXAMPLES / name))
    text = capsys.readouterr().out
    if name in LEAST:
        assert float(re.findall(r"0\.\d+", text)[-1]) > LEAST[name]
    else:
        assert re.search(PRINTED[name], text, re.DOTALL), text


def test_every_example_is_run_and_the_site_runs_these():
    text = (EXAMPLES.parent / "docs" / "conf.py").read_text(encoding="utf-8")
    (names,) = re.findall(r"^RUN = \((.*)\)$", text, re.MULTILINE)
    assert {f"{name}.py" for name in re.findall(r"\w+", names)} == set(PRINTED)
    assert {path.name for path in EXAMPLES.glob("*.py")} == {*LEAST, *PRINTED}


@pytest.mark.slow
def test_the_notebook_runs_cell_by_cell(tmp_path):
    """Without Jupyter; in the place of what pip installs and the network brings there is this checkout."""
    runpy.run_path(str(EXAMPLES.parent / "tools" / "drives.py"), run_name="__main__")  # drives.csv
    notebook = json.loads((EXAMPLES / "your_own_data.ipynb").read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["metadata"]["kernelspec"]["name"]) == (4, "python3")
    names: dict[str, object] = {}
    with contextlib.redirect_stdout(io.StringIO()) as out:
        for cell in notebook["cells"]:
            code = "".join(line for line in cell["source"] if not line.startswith(("%", "!")))
            if cell["cell_type"] == "code":
                assert cell["outputs"] == []
                exec(compile(code, "your_own_data.ipynb", "exec"), names)
    assert "6 of 40 act differently from the rest: P08, P37, P28, P38, P23, P24." in out.getvalue()
    assert names["answered"].verdict_counts()["bad"] >= 2
    assert len((tmp_path / "kept.csv").read_text().splitlines()) == 1 + 400 * len(names["answered"].choice.kept)
