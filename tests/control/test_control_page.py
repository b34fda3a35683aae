"""The page on control shows code; it must run."""

import re
from pathlib import Path

import numpy as np

PAGE = Path(__file__).parents[2] / "docs" / "control.md"


def test_the_example_on_the_page_runs_and_serves_its_task():
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict = {"__name__": "page"}
    exec(compile(code, str(PAGE), "exec"), names)
    J, demand, _ = names["task"].rows(names["B"])
    np.testing.assert_allclose(J @ names["nu"], demand, atol=1e-14)
