"""Requests determine results: their hash is stable and their differences are named."""

import json
import math
import subprocess
import sys
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.core.provenance import Request, run_log

CONTENT = {
    "mechanism": "rpr3",
    "geometry": {"c2": 0.1, "c3": 1e-300},
    "grid": [[0.0, 4.0, 2000]],
    "tolerance": 1e-11,
}
HASH = "0f5fdb593b367d90fa15ad54f6a2586e98c8064a60f49a9236fcf035fc9ae084"


def test_the_hash_is_the_same_today_and_tomorrow():
    assert Request(CONTENT).hash == HASH


def test_the_hash_ignores_the_order_of_entries():
    assert Request(dict(reversed(CONTENT.items()))).hash == HASH


def test_the_hash_is_the_same_in_another_process():
    code = f"from jaxkin.core.provenance import Request; print(Request({CONTENT!r}).hash)"
    root = Path(jk.__file__).parents[1]
    result = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == HASH


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_survives_and_its_neighbour_differs(value):
    request = Request({"c2": value})
    assert json.loads(request.text)["c2"] == value
    assert request.hash != Request({"c2": math.nextafter(value, math.inf)}).hash


def test_difference_names_the_entry():
    request = Request(CONTENT)
    assert request.difference(json.loads(request.text)) == "nothing differs"
    other = json.loads(request.text)
    other["geometry"]["c2"] = 0.2
    assert request.difference(other) == "geometry.c2 is 0.2 there and 0.1 here"
    del other["geometry"]["c2"]
    assert request.difference(other) == "geometry.c2 is None there and 0.1 here"
    assert request.difference({**CONTENT, "field": "count"}) == "field is 'count' there and None here"


def test_run_log_is_no_part_of_the_request():
    log = run_log(seconds=1.5)
    assert log["seconds"] == 1.5
    assert {"finished", "jax", "numpy", "python", "device"} <= set(log)
    json.dumps(log)
