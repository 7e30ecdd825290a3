"""Size and speed of the report of many demonstrations, in headless Chromium: python tools/measure_report.py [SIZE ...]

Ready is when all is loaded and drawn; sorting and filtering are the worst of all columns and of all filters. Each is
the median of some runs.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from audits import make_audit
from browser import Browser, browsing
from rpil.faults.report import FaultReport
from rpil.faults.rule import Fault
from rpil.results.html.page import About, write_page
from rpil.results.record import Audit

RUNS = 5

READY = "performance.getEntriesByType('navigation')[0].loadEventEnd"
CLICKS = """(async () => {
  let worst = 0;
  for (const one of [...document.querySelectorAll('%s')]) {
    const start = performance.now();
    one.click();
    document.body.offsetHeight;
    worst = Math.max(worst, performance.now() - start);
    await new Promise(requestAnimationFrame);
  }
  return worst;
})()"""


def audit_of(size: int) -> tuple[Audit, About]:
    """An audit of so many demonstrations, with sessions, operators and faults."""
    rng = np.random.default_rng(0)
    verdicts = rng.choice(["similar", "open", "outlier"], p=[0.8, 0.1, 0.1], size=size).tolist()
    audit = make_audit(
        verdicts,
        lengths=rng.integers(100, 900, size),
        order=np.arange(float(size)),
        sessions=tuple(f"session {m * 8 // size}" for m in range(size)),
        columns=rng.normal(size=(size, 5)),
    )
    findings = tuple(
        Fault(rule, int(m), 3, 9, "x", 1.0, 0.5, 2.0, f"x leaps by {m / 7:.3f} from one step to the next")
        for rule in ("jump", "lag", "saturation")
        for m in rng.choice(size, size // 10, replace=False)
    )
    operators = {str(m): f"operator {m % 5}" for m in range(size)}
    faults = FaultReport(findings, {}, {}, {}, {}, size, 1)
    return replace(audit, fps=30.0), About("Audit", "x.csv", faults=faults, demonstrators=operators)


def measure(browser: Browser, path: Path) -> list[float]:
    """Seconds until it is ready, to sort and to filter."""
    found = []
    for _ in range(RUNS):
        browser.open(path)
        found.append([browser.evaluate(code) for code in (READY, CLICKS % "thead button", CLICKS % ".chip")])
    return [statistics.median(values) / 1000 for values in zip(*found, strict=True)]


def main() -> None:
    print("demonstrations   MB   ready s   sort s   filter s")
    for size in map(int, sys.argv[1:] or ("1000", "5000", "10000")):
        with tempfile.TemporaryDirectory() as folder, browsing(Path(folder) / "profile") as browser:
            path = Path(folder) / "report.html"
            write_page(path, *audit_of(size))
            ready, sort, choose = measure(browser, path)
            print(f"{size:>14,}  {path.stat().st_size / 1e6:.1f}  {ready:>8.2f}  {sort:>7.3f}  {choose:>9.3f}")


if __name__ == "__main__":
    main()
