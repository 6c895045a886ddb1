"""The examples of docs/design.md run as they stand, and print what is beside them."""

import contextlib
import io
import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "design.md").read_text()
EXAMPLES = dict(re.findall(r"<!-- (design|own objective) -->\n```python\n(.*?)```", PAGE, flags=re.DOTALL))


@pytest.mark.parametrize("name", ["design", "own objective"])
def test_examples_print_what_is_beside_them(name):
    code, space, out = EXAMPLES[name], {}, io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, f"docs/design.md, {name}", "exec"), space)
    beside = re.findall(r"^print\(.*\)  # (.*)$", code, flags=re.MULTILINE)
    assert beside
    for line in beside:
        assert line in out.getvalue().splitlines()
