"""Checkpoints: what an optimisation has done so far, in one file that the same request goes on with."""

import json
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxkin.core.errors import StoreError
from jaxkin.core.provenance import Request
from jaxkin.core.words import given

#: Raise it when what is kept changes.
_VERSION = 3


class Checkpoint:
    """One file with arrays and the request that they belong to; replaced as a whole, so that it is never half written.

    Args:
        path: The file; None keeps nothing.
        request: What determines the numbers.
        overwrite: True to begin anew over a file of another request.

    Raises:
        StoreError: The file is another request's, or no checkpoint.
    """

    def __init__(self, path: str | Path | None, request: Request, overwrite: bool):
        self._path, self._request = None if path is None else Path(path), request
        self._content: dict[str, np.ndarray] = {}
        if self._path is not None and self._path.exists() and not overwrite:
            self._content = self._read(self._path)

    def load(self, name: str, like: Any) -> Any | None:
        """Returns a pytree that was kept under a name, in the structure of another; None where there is none."""
        leaves, structure = jax.tree_util.tree_flatten(like)
        keys = [f"{name}.{k}" for k in range(len(leaves))]
        if any(key not in self._content for key in keys):
            return None
        return jax.tree_util.tree_unflatten(structure, [self._content[key] for key in keys])

    def array(self, name: str) -> np.ndarray | None:
        """Returns an array that was kept under a name."""
        return self._content.get(name)

    def keep(self, trees: dict[str, Any] | None = None, **arrays: np.ndarray) -> None:
        """Keeps pytrees and arrays under their names, and writes the file."""
        for name, tree in (trees or {}).items():
            for k, leaf in enumerate(jax.tree_util.tree_leaves(tree)):
                self._content[f"{name}.{k}"] = np.asarray(leaf)
        self._content.update({name: np.asarray(value) for name, value in arrays.items()})
        if self._path is None:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        part = self._path.with_name(f".{self._path.name}.part")
        with open(part, "wb") as file:
            np.savez(file, request=np.array(self._request.text), version=np.array(_VERSION), **self._content)  # type: ignore[arg-type]
        os.replace(part, self._path)

    def _read(self, path: Path) -> dict[str, np.ndarray]:
        try:
            # Opened here, since NumPy leaves a damaged file open.
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                content = {name: file[name] for name in file.files}
            request, version = dict(json.loads(str(content.pop("request")))), int(content.pop("version"))
        # A file of one array is no context manager (TypeError).
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise StoreError(f"The checkpoint {str(path)!r} cannot be read ({error}): {_remedy()}.") from None
        if version != _VERSION or request != json.loads(self._request.text):
            what = self._request.difference(request) if version == _VERSION else "it is of another version"
            raise StoreError(f"The checkpoint {str(path)!r} is of another request ({what}): {_remedy()}.")
        return content


def _remedy() -> str:
    return f"choose another {given('file')}, or give {given('overwrite=True')}"
