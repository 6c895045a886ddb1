"""What messages call the things that a user gives: arguments in Python, options on the command line."""

import contextlib
import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

#: Python's word -> the word of whoever is being told; empty in Python. Not a context variable, since threads tell too.
_instead: dict[str, str] = {}


def given(word: str) -> str:
    """Returns what the user calls an argument or a function: its word in Python, unless another was agreed on."""
    return _instead.get(word, word)


def meant(name: Any, known: Iterable[str]) -> str:
    """Returns the end of a message about an unknown name: the name that was probably meant, or a full stop."""
    close = difflib.get_close_matches(str(name), list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else "."


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
