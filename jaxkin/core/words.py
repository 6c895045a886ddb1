"""What messages call the things that a user gives: arguments in Python, options on the command line."""

import contextlib
from collections.abc import Iterator, Mapping

#: Python's word -> the word of whoever is being told; empty in Python. Not a context variable, since threads tell too.
_instead: dict[str, str] = {}


def given(word: str) -> str:
    """Returns what the user calls an argument or a function: its word in Python, unless another was agreed on."""
    return _instead.get(word, word)


@contextlib.contextmanager
def spoken(words: Mapping[str, str]) -> Iterator[None]:
    """Makes messages use other words for a while."""
    before = dict(_instead)
    _instead.update(words)
    try:
        yield
    finally:
        _instead.clear()
        _instead.update(before)
