"""Sequences whose parts have names."""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Generic, TypeVar, overload

Part = TypeVar("Part", bound=Any)


class NamedParts(Sequence[Part], Generic[Part]):
    """A result that is a sequence of parts, each with a ``name``, and is indexed by number or name.

    Attributes:
        kind: What the parts are called, for messages.
    """

    kind: ClassVar[str] = "parts"

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts, in order."""
        raise NotImplementedError

    @overload
    def __getitem__(self, index: int | str) -> Part: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Part, ...]: ...
    def __getitem__(self, index: int | str | slice) -> Part | tuple[Part, ...]:
        """Returns one part, by number or name, or a tuple of them."""
        if isinstance(index, str):
            for part in self.parts:
                if part.name == index:
                    return part
            raise KeyError(f"{index!r}: the {self.kind} are {', '.join(repr(p.name) for p in self.parts) or 'none'}.")
        return self.parts[index]

    def __len__(self) -> int:
        """Number of parts."""
        return len(self.parts)

    def __iter__(self) -> Iterator[Part]:
        """Runs over the parts."""
        return iter(self.parts)
