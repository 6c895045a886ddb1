"""What the tests of stores look at: the files of a store, and what lies beside it."""

from small_sweep import run


def files(store):
    """Returns every file of a store but the run log."""
    paths = (p for p in sorted(store.rglob("*")) if p.is_file() and p.name != "run_log.jsonl")
    return {str(p.relative_to(store)): p.read_bytes() for p in paths}


def beside(store):
    return sorted(p.name for p in store.parent.iterdir() if p != store)


def settled(store, whole):
    """Resumes in this process, and asserts that the store is the uninterrupted one, with nothing left behind."""
    assert run(store).attrs["complete"] == 1
    assert files(store) == whole
    assert beside(store) == []


def journal_of(store):
    return store / "height" / "tiles.journal"


def lines_of(store):
    return journal_of(store).read_text().splitlines(keepends=True)
