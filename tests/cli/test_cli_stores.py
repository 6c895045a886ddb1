import json

import pytest
import xarray

AXES = ["--fix", "rho2=1", "--grid", "rho1=0:4:40", "--grid", "rho3=0:4:50"]
MAP = ["map", "rpr3-analytic", *AXES]


def test_data_goes_where_store_says_and_the_rest_where_out_says(run, tmp_path):
    store, out = tmp_path / "data.zarr", tmp_path / "map"
    code, printed, _ = run(*MAP, "--store", store, "--json")
    assert code == 0
    assert json.loads(printed)["files"] == {"data": str(store)}
    assert [p.name for p in tmp_path.iterdir()] == ["data.zarr"]
    # The same request, now with pictures: nothing is computed again.
    before = (store / "forward_count" / "run_log.jsonl").read_text()
    for _ in range(2):
        code, printed, _ = run(*MAP, "--store", store, "--out", out, "--json")
        assert code == 0
        assert json.loads(printed)["files"]["data"] == str(store)
        assert sorted(p.name for p in out.iterdir()) == ["map.json", "map.pdf", "map.png"]
    assert (store / "forward_count" / "run_log.jsonl").read_text() == before


def test_resume_insists_that_there_is_something(run, tmp_path):
    store = tmp_path / "data.zarr"
    code, _, err = run(*MAP, "--resume")
    assert code == 2
    assert "no --store and no --out" in err
    code, _, err = run(*MAP, "--store", store, "--resume")
    assert code == 2
    assert "data.zarr" in err
    assert not store.exists()
    code, _, err = run(*MAP, "--store", store, "--resume", "--force")
    assert code == 2
    assert "leave one" in err
    assert run(*MAP, "--store", store)[0] == 0
    assert run(*MAP, "--store", store, "--resume")[0] == 0


def test_a_dry_run_says_what_it_would_take_and_leaves_nothing(run, tmp_path):
    code, printed, _ = run(*MAP, "--store", tmp_path / "data.zarr", "--dry-run")
    assert code == 0
    for word in ("2,000 samples in 1 tile\n", "result      4 kB", "on the disk", "memory", "time"):
        assert word in printed
    numbers = json.loads(run(*MAP, "--out", tmp_path / "map", "--dry-run", "--json")[1])
    assert numbers["samples"] == 2000
    assert numbers["raw_bytes"] == 4000
    assert 0 < numbers["stored_bytes"] < 4000
    assert numbers["seconds"] > 0
    assert json.loads(run(*MAP, "--dry-run", "--json")[1])["stored_bytes"] is None
    assert list(tmp_path.iterdir()) == []


def test_info_and_verify(run, tmp_path):
    run(*MAP, "--out", tmp_path / "map")
    store = tmp_path / "map" / "map.zarr"
    for place in (store, tmp_path / "map"):
        code, printed, _ = run("info", place)
        assert code == 0
        for word in ("forward_count of rpr3-analytic", "c2=1.0", "rho2 = 1", "2,000, 1 of 1 tile whole", "4 kB"):
            assert word in printed
        assert run("verify", place)[0] == 0
    info = json.loads(run("info", store, "--json")[1])
    assert info["complete"] is True
    assert info["request"]["grid"]["rho1"] == [0.0, 4.0, 40]
    (store / "forward_count" / "tiles.journal").write_text("")
    code, printed, _ = run("verify", store, "--json")
    assert code == 1
    assert json.loads(printed) == {
        "path": str(store),
        "tiles": 1,
        "tiles_done": 0,
        "damaged": [],
        "damaged_coordinates": [],
        "writing": False,
        "ok": False,
    }
    for command in ("info", "verify"):
        for path, word in ((tmp_path / "nothing", "There is no store"), (tmp_path, "no jaxkin store")):
            code, _, err = run(command, path)
            assert code == 2
            assert word in err
            assert "give the path of one that a sweep has written" in err
            assert len(err.splitlines()) == 1


def test_a_dry_run_refuses_what_the_run_would_refuse(run, tmp_path):
    store, other = tmp_path / "data.zarr", [*MAP[:3], "rho2=2", *MAP[4:]]
    assert run(*MAP, "--store", store)[0] == 0
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "thesis.txt").write_text("years of work")
    before = {p: p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()}
    huge = ["map", "rpr3-analytic", "--fix", "rho2=1", "--grid", "rho1=0:4:900000", "--grid", "rho3=0:4:900000"]
    for arguments, words in (
        ([*other, "--store", store], ["another request", "--force"]),
        ([*other, "--store", store, "--resume"], ["another request"]),
        ([*MAP, "--store", tmp_path / "none.zarr", "--resume"], ["--resume has nothing"]),
        ([*MAP, "--store", tmp_path / "folder"], ["no jaxkin store"]),
        ([*MAP, "--out", tmp_path / "folder"], ["holds something else"]),
        ([*MAP, "--store", tmp_path / "folder" / "thesis.txt" / "map.zarr"], ["cannot be written"]),
        (huge, ["GB", "--store STORE"]),
    ):
        told = [run(*arguments, *more) for more in ([], ["--dry-run"])]
        for code, printed, err in told:
            assert (code, printed, len(err.splitlines())) == (2, "", 1)
            for word in words:
                assert word in err
    assert run(*MAP, "--store", store, "--dry-run", "--resume")[0] == 0
    assert run(*other, "--store", store, "--dry-run", "--force")[0] == 0
    assert {p: p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()} == before


def test_float32_is_asked_for_and_its_error_told(run, tmp_path):
    poses = ["--grid", "x=-2:2:20", "--grid", "y=-1:1:30", "--fix", "phi=0.3"]
    command = ["map", "rpr3-analytic", "--field", "smallest_singular_value", *poses, "--store", tmp_path / "s.zarr"]
    code, printed, _ = run(*command, "--float32")
    assert code == 0
    assert "float32, smallest_singular_value: off by at most" in printed
    assert xarray.open_zarr(tmp_path / "s.zarr", consolidated=False, chunks=None).smallest_singular_value.dtype == "f4"
    code, _, err = run(*command)
    assert code == 2
    assert "precision" in err
    code, _, err = run(*MAP, "--float32")
    assert code == 2
    assert "--float32" in err
    assert "leave it out" in err


def test_a_scheduler_that_is_not_there_is_one_sentence(run, monkeypatch):
    pytest.importorskip("distributed")
    from jaxkin.cli import dense as module

    monkeypatch.setattr(module, "_SECONDS_TO_CONNECT", 0.2)
    for address in ("tcp://127.0.0.1:1", "nonsense"):
        code, _, err = run(*MAP, "--scheduler", address)
        assert code == 2
        assert address in err
        assert len(err.splitlines()) == 1
