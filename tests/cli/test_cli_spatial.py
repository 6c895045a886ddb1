"""The spatial robots on the command line."""

import csv
import json

import pytest


def test_the_four_modes_of_the_3_ppps_have_their_labels(run):
    code, out, _ = run("forward", "ppps3", "0.2", "0.3", "0.5867", "0.1", "-0.4", "0.5", "--json")
    assert code == 0
    solutions = json.loads(out)["solutions"]
    assert [s["label"] for s in solutions] == [
        "R22 > 0, R33 > 0",
        "R22 > 0, R33 < 0",
        "R22 < 0, R33 > 0",
        "R22 < 0, R33 < 0",
    ]
    assert solutions[0]["determinant"] == pytest.approx(-solutions[1]["determinant"])


def test_table_1_of_the_tlpm(run):
    code, out, _ = run("forward", "tlpm", "17.787689", "60.605061", "168.305874")
    assert code == 0
    assert "[upper, z > -h]" in out
    assert "-1279.9999" in out


def test_vectors_and_limits_as_options(run, tmp_path):
    table = tmp_path / "poses.csv"
    table.write_text("x,y,z\n100,100,100\n0,0,0\n")
    code, out, _ = run(
        "inverse", "tlpm", "--csv", str(table), "--set", "initial_lengths=800:810:820", "--limit", "l3=-100:15"
    )
    assert code == 0
    rows = list(csv.DictReader(out.splitlines()))
    assert rows[0]["status"] == "outside_limits"
    assert float(rows[1]["l2"]) == pytest.approx(590 * 2**0.5 - 810)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--set", "stroke=200:-200"), "low limit"),
        (("--set", "stroke=-900:200"), "mm long"),
        (("--set", "stroke=100:100"), "empty"),
        (("--set", "r1=0"), "r1 is"),
        (("--set", "elbows=1:1:2"), "elbows"),
        (("--set", "base_radius=1:2"), "one number"),
        (("--set", "limb_angles=0:0:1"), "triangle"),
        (("--limit", "l9=0:1"), "no limits of l9"),
        (("--limit", "l1=1"), "LOW:HIGH"),
        (("--limit", "l1=1:0"), "exchange"),
    ],
)
def test_bad_geometry_is_named(run, arguments, says):
    code, _, err = run("forward", "tlpm", "0", "0", "0", *arguments)
    assert code == 2
    assert says in err
    assert len(err.strip().splitlines()) == 1


def test_a_map_of_what_binds(run, tmp_path):
    code, out, _ = run(
        "map", "tlpm", "--field", "binding_limit", "--fix", "z=0", "--grid", "x=-400:400:40", "--grid", "y=-400:400:40",
        "--out", str(tmp_path / "map"), "--json",
    )  # fmt: skip
    assert code == 0
    numbers = json.loads(out)
    assert sum(numbers["shares"].values()) + numbers["none"] == pytest.approx(1)
    assert "L13-L23" in numbers["shares"]
    assert (tmp_path / "map" / "map.png").exists()


def test_limits_that_no_status_knows_are_named_beside_the_solution(run):
    code, out, _ = run("inverse", "ppps3", *"000000", "--limit", "rho1x=1:2", "--json")
    assert code == 0
    (solution,) = json.loads(out)["solutions"]
    assert (solution["status"], solution["violated"]) == ("ok", "rho1x_low")
    code, out, _ = run("inverse", "tlpm", "0", "0", "-1100")
    assert code == 0
    assert "violated: theta11_low theta21_low theta31_low" in out


def test_several_numbers_are_written_with_colons(run):
    code, _, err = run("forward", "tlpm", "0", "0", "0", "--set", "elbows=1,-1,1")
    assert code == 2
    assert "1:-1:1" in err
