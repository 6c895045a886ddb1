"""Exceptions are built-ins as well; every status has a sentence."""

import pytest

import jaxkin as jk


@pytest.mark.parametrize(
    ("error", "builtin"),
    [
        (jk.GeometryError, ValueError),
        (jk.InputError, ValueError),
        (jk.PrecisionError, RuntimeError),
        (jk.StoreError, FileExistsError),
        (jk.SweepInterrupted, KeyboardInterrupt),
    ],
)
def test_exceptions_are_built_ins(error, builtin):
    assert issubclass(error, builtin)
    assert issubclass(error, jk.JaxkinError)


def test_an_interrupted_sweep_carries_what_was_done():
    error = jk.SweepInterrupted("stopped", {"count": 1}, 42)
    assert (error.dataset, error.samples_done, str(error)) == ({"count": 1}, 42, "stopped")


def test_every_status_has_its_own_sentence():
    sentences = [status.sentence for status in jk.Status]
    assert len(set(sentences)) == len(jk.Status) == 10
    assert all(len(sentence) > 15 for sentence in sentences)


def test_codes_are_fixed():
    # They are stored in files.
    names = ("OK", "SINGULAR", "NO_REAL_SOLUTION", "NOT_CONVERGED", "OUTSIDE_LIMITS", "INVALID_INPUT")
    names += ("INVALID_GEOMETRY", "SELF_MOTION", "COMPLETENESS_UNKNOWN", "UNDECIDED")
    assert [status.name for status in sorted(jk.Status)] == list(names)
    assert [int(status) for status in sorted(jk.Status)] == list(range(10))
