"""Who is on the command line is told of its options, not of Python's arguments."""

import ast
from pathlib import Path

import pytest

import jaxkin as jk
from jaxkin.cli.words import OPTIONS
from jaxkin.core.words import given, spoken

SOURCE = Path(jk.__file__).parent
MAP = ["map", "rpr3-analytic", "--fix", "rho2=1", "--grid", "rho1=0:4:40", "--grid", "rho3=0:4:50"]
POSES = ["map", "rpr3-analytic", "--fix", "phi=1", "--grid", "x=0:4:40", "--grid", "y=0:4:50"]


def asked():
    """Yields what the source asks words for: texts, and None where one is put together."""
    for file in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "given":
                yield node.args[0].value if isinstance(node.args[0], ast.Constant) else None


def test_every_word_has_one_on_the_command_line_and_none_is_left_over():
    words = set(asked()) - {None}
    assert len(words) > 10
    assert words <= set(OPTIONS)
    # Put together from the names of arguments.
    names = {f"jk.Adaptive: {name}" for name in ("probes", "seed", "proof")} | {"store", "executor"}
    assert set(OPTIONS) - words <= names


def test_words_are_agreed_on_for_a_while():
    assert given("overwrite=True") == "overwrite=True"
    with spoken(OPTIONS):
        assert given("overwrite=True") == "--force"
        assert given("something else") == "something else"
    assert given("overwrite=True") == "overwrite=True"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([*MAP, "--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], ["--workers is 2", "--scheduler"]),
        ([*MAP, "--adaptive", "--stride", "12"], ["--stride is 12", "power of two"]),
        ([*MAP, "--adaptive", "--probes", "-1"], ["--probes is -1"]),
        ([*MAP, "--adaptive", "--label", "sign"], ["leave --label out"]),
        ([*POSES, "--adaptive", "--field", "direct_determinant"], ["--label sign"]),
        ([*POSES, "--adaptive", "--field", "smallest_singular_value", "--label", "sign"], ["without --adaptive"]),
        (["map", "rpr3-analytic"], ["The grid has no axis", "--grid AXIS=LOW:HIGH:N", "--fix AXIS=VALUE"]),
        (MAP[:-2], ["rho3", "--grid AXIS=LOW:HIGH:N"]),
        ([*MAP[:-1], "rho3=0:4:1"], ["n = 1", "--fix AXIS=VALUE"]),
        ([*MAP, "--float32"], ["--float32 is given", "leave it out"]),
    ],
)
def test_messages_speak_of_options(arguments, words, run, monkeypatch):
    monkeypatch.setattr("jaxkin.cli.dense._cluster", lambda address: __import__("contextlib").nullcontext(address))
    code, _, err = run(*arguments)
    assert code == 2
    for word in words:
        assert word in err
    for word in ("=True", "jk.", "(low", "executor", "precision"):
        assert word not in err
    assert len(err.splitlines()) == 1
