import subprocess
import sys

import pytest

from jaxkin.cli.main import main

LIGHT = (
    "import sys\nfrom jaxkin.cli.main import main\n"
    "try:\n    main(sys.argv[1:])\nexcept SystemExit as e:\n    assert not e.code\n"
    "heavy = {'jax', 'numpy', 'matplotlib', 'xarray', 'zarr'} & set(sys.modules)\nassert not heavy, heavy\n"
)


@pytest.fixture
def run(capsys):
    """Runs the command line in this process; returns exit code, output and errors."""

    def call(*arguments):
        with pytest.raises(SystemExit) as caught:
            main([str(a) for a in arguments])
        out, err = capsys.readouterr()
        return caught.value.code, out, err

    return call


@pytest.fixture
def run_light():
    """Runs the command line in a process of its own, which must end well and import nothing heavy."""

    def call(*arguments):
        return subprocess.run([sys.executable, "-c", LIGHT, *arguments], check=True, capture_output=True, text=True)

    return call
