"""The README keeps its word, and the house its shape."""

import contextlib
import io
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

import jaxkin as jk

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
_NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")


def block(mark: str, language: str) -> str:
    match = re.search(rf"<!-- {mark} -->\n```{language}\n(.*?)```", README, re.DOTALL)
    assert match, f"the README lacks the block {mark!r}"
    return match.group(1)


def test_the_example_prints_what_the_readme_says():
    code = block("example", "python")
    assert len(code.splitlines()) == 12
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})
    expected, got = (
        re.sub(r"residual \S+", "residual", text) for text in (block("output", "text"), printed.getvalue())
    )
    assert _NUMBER.sub("#", got).split() == _NUMBER.sub("#", expected).split()
    numbers = [[float(n) for n in _NUMBER.findall(text)] for text in (expected, got)]
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-9, abs=1e-9)


def test_the_mechanism_of_ones_own_does_what_the_readme_says():
    code = block("own mechanism", "python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {"__name__": "own"})
    count, slope = printed.getvalue().split()
    assert int(count) == 2
    assert float(slope) == pytest.approx(2 / 3**0.5, rel=1e-12)


def test_the_topology_example_gives_the_numbers_in_its_comments():
    code = "import math\nimport jaxkin as jk\njk.enable_x64()\n" + block("topology", "python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})
    count, change, area, cusps = printed.getvalue().splitlines()
    assert count == "2"
    assert change == "True True"
    assert float(area) == pytest.approx(79.76484403, abs=1e-7)
    assert cusps == "8"


def test_the_spatial_example_gives_the_numbers_in_its_comments():
    code = "import jaxkin as jk, jax\njk.enable_x64()\n" + block("spatial", "python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})
    count, share, radius, volume, slope = map(float, printed.getvalue().split())
    assert count == 4
    assert share == pytest.approx(0.25, abs=1e-9)
    assert radius == pytest.approx(math.pi / 2, abs=1e-9)
    assert volume == pytest.approx(72322565.930, abs=1e-3)
    robots = (jk.mechanisms.tlpm.create(590.0, 590.0 + step) for step in (0.01, -0.01))
    up, down = (float(jk.workspace_volume(robot).volume) for robot in robots)
    assert slope == pytest.approx((up - down) / 0.02, rel=1e-6)


@pytest.mark.slow
def test_the_design_example_gives_the_numbers_in_its_comments():
    code = "import jaxkin as jk, jax\njk.enable_x64()\n" + block("design", "python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})
    verdict, active, slope = printed.getvalue().splitlines()
    assert verdict.split()[0] == "True"
    assert float(verdict.split()[1]) == pytest.approx(0.94627197, abs=1e-8)
    assert active == "('base >= 0.5', 'distal <= 9')"
    assert math.isfinite(float(slope))


def test_both_commands_stand_alone_and_ci_reads_the_test_command():
    for name in ("run", "test"):
        assert len(block(f"command: {name}", "sh").strip().splitlines()) == 1
    assert "command_after test" in (ROOT / ".ci" / "run").read_text()
    assert "pytest" not in (ROOT / ".ci" / "run").read_text().split("test_command=")[0]


def test_the_map_of_folders_is_true():
    folders = re.findall(r"^\| `([a-z/]+)` \|", README, re.MULTILINE)
    assert folders
    for folder in folders:
        assert (ROOT / folder).is_dir(), folder
    rooms = {p.name for p in (ROOT / "jaxkin").iterdir() if p.is_dir() and not p.name.startswith("_")}
    assert rooms == {f.removeprefix("jaxkin/") for f in folders if f.startswith("jaxkin/")}


def test_importing_jaxkin_imports_neither_jax_nor_pyplot():
    code = "import sys, jaxkin; assert not {'jax', 'matplotlib', 'xarray'} & set(sys.modules), 'heavy import'"
    subprocess.run([sys.executable, "-c", code], check=True)
    code = (
        "import sys, jaxkin as jk; jk.enable_x64(); r = jk.mechanisms.rpr3.analytic(1., 0., 1.); "
        "jk.sweep(r, 'forward_count', jk.Grid(rho1=(0., 4., 3), rho2=1., rho3=1.)); "
        "assert 'matplotlib' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_public_name_exists_and_is_documented():
    import jaxkin as jk

    for name in jk.__all__:
        value = getattr(jk, name)
        assert value.__doc__ or isinstance(value, str), name
