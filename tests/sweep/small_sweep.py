"""A small sweep of eleven tiles, some of them all fill value; run as a script, it runs it in processes that can die.

The script answers lines of JSON: each starts a process of its own, forked when everything is imported and nothing is
computed, which meets a fault at its n-th file event.
"""

import errno
import json
import os
import select
import signal
import sys
import threading
import time
import traceback
from pathlib import Path

import jax.numpy as jnp

import jaxkin as jk
from jaxkin.sweep.fields import Variable


def _variables(robot):
    return (
        Variable("height", "float64", "1", "height"),
        Variable("height_sign", "int8", "1", "sign of the height", missing=-1),
    )


def _kernel(robot, coordinates):
    x, y, phi = coordinates
    height = x * y + phi
    # Below 0.7 every sample is the fill value, for which Zarr writes no file.
    return (jnp.where(x < 0.7, jnp.nan, height), jnp.where(x < 0.7, -1, height > 1.0).astype(jnp.int8))


def field(block=130, **options):
    return jk.Field("height", "pose", _variables, _kernel, block=lambda robot: block, **options)


HEIGHT = field()
#: The grid cuts off the last tiles, which Zarr reads before it writes them.
GRID = jk.Grid(x=(0.0, 2.0, 41), y=(0.0, 3.0, 31), phi=0.25)
OTHER = jk.Grid(x=(0.0, 2.0, 41), y=(0.0, 3.0, 31), phi=0.5)
TILES = 11


def robot(base=1.0):
    return jk.mechanisms.rpr3.analytic(base, 0.0, 1.0)


def run(store, grid=GRID, field=HEIGHT, **options):
    return jk.sweep(robot(), field, grid, store=store, progress=False, **options)


_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_TRUNC


class _Fault:
    """Counts what happens to files in a folder, and does something at the n-th of these events."""

    def __init__(self, folder, number, action, told):
        self.folder, self.number, self.action, self.told = str(folder), number, action, told
        self.count = 0
        self.counting = threading.Lock()

    def __call__(self, event, args):
        if event == "open":
            path, writes = args[0], bool(args[2] & _WRITING)
        elif event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link"):
            path, writes = args[0], event in ("os.mkdir", "os.link")
        else:
            return
        # shutil.rmtree names what it removes relative to an open folder.
        inside = isinstance(path, str | os.PathLike) and (
            os.fspath(path).startswith(self.folder) or (not os.path.isabs(path) and event in ("os.remove", "os.rmdir"))
        )
        if not inside or (self.action == "full" and not writes):
            return
        with self.counting:
            self.count += 1
            count = self.count
        if count == 1:
            os.write(self.told, b".")
        if self.action == "kill" and count == self.number:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.action == "stop" and count == self.number:
            os.kill(os.getpid(), signal.SIGSTOP)
        if self.action == "full" and count >= self.number:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), os.fspath(path))


def _child(order, told):
    store = Path(order["store"])
    fault = _Fault(store.parent, order.get("at", 0), order.get("action", ""), told)
    sys.addaudithook(fault)
    try:
        data = run(store, OTHER if order.get("other") else GRID, overwrite=order.get("overwrite", False), workers=2)
        answer = {"end": "done", "complete": data.attrs["complete"]}
    except jk.StoreError as error:
        answer = {"end": "StoreError", "message": str(error)}
    except BaseException:
        answer = {"end": "bug", "message": traceback.format_exc()}
    os.write(told, json.dumps({**answer, "events": fault.count}).encode())


def _answer(order):
    heard, told = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            # What a child prints must not mix with the answers.
            os.dup2(2, 1)
            jk.enable_x64()
            _child(order, told)
        finally:
            os._exit(0)
    os.close(told)
    if order.get("wait") is False:
        os.close(heard)
        return {"pid": pid}
    if "after" in order and select.select([heard], [], [], 60)[0]:
        time.sleep(order["after"])
        os.kill(pid, signal.SIGKILL)
    if order.get("action") == "stop":
        _, status = os.waitpid(pid, os.WUNTRACED)
        os.close(heard)
        return {"pid": pid, "end": "stopped" if os.WIFSTOPPED(status) else "done"}
    text = b""
    while piece := os.read(heard, 1 << 16):
        text += piece
    os.close(heard)
    _, status = os.waitpid(pid, 0)
    if os.WIFSIGNALED(status):
        return {"end": "killed", "pid": pid}
    return {"pid": pid, **json.loads(text.lstrip(b"."))}


def _serve():
    # Everything that a sweep imports; but no array is made here: what JAX starts would not survive a fork.
    import contextlib

    import xarray  # noqa: F401

    import jaxkin.core.precision
    import jaxkin.sweep.engine
    import jaxkin.sweep.store
    import jaxkin.sweep.stored  # noqa: F401

    with contextlib.suppress(ImportError):
        import dask  # noqa: F401
    _ = jk.sweep, jk.mechanisms.rpr3, jk.Grid
    for line in sys.stdin:
        order = json.loads(line)
        if "reap" in order:
            _, status = os.waitpid(order["reap"], 0)
            answer = {"end": "killed" if os.WIFSIGNALED(status) else "done"}
        else:
            answer = _answer(order)
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    _serve()
