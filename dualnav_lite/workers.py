"""Where chunks are computed: processes of this machine, or the workers of a Dask cluster."""

import contextlib
import os
import threading
import time
from urllib.parse import urlsplit

import joblib

from dualnav_lite.config import UnusableInput

LOOPBACK = ("127.0.0.1", "localhost", "::1")
LOOK_S = 0.5  # between two looks whether the parent is still there


def checked_address(cluster: str) -> str:
    """The address of a Dask scheduler, once it is sure that nobody else can hand it code.

    Raises:
        UnusableInput: no `tcp://host:port` or `tls://host:port`, or plain TCP to another machine.

    >>> checked_address("tcp://127.0.0.1:8786")
    'tcp://127.0.0.1:8786'
    """
    parts = urlsplit(cluster)
    try:
        port = parts.port
    except ValueError:
        port = None
    if parts.scheme not in ("tcp", "tls") or not parts.hostname or not port:
        raise UnusableInput(f"a cluster reads tcp://host:port or tls://host:port; got '{cluster}'")
    if parts.scheme == "tcp" and parts.hostname not in LOOPBACK:
        raise UnusableInput(
            f"cluster {cluster}: whoever can reach a scheduler over plain tcp can run code on its workers; "
            "use tls://, or an SSH tunnel to a port of this machine"
        )
    return cluster


def _end_with(parent: int) -> None:
    """In a worker: end soon after the parent did, however it ended; a chunk of long runs would go on for minutes."""

    def watch() -> None:
        while os.getppid() == parent:  # on Windows it stays what it was: there workers finish their chunk
            time.sleep(LOOK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def pool(jobs: int = 1, cluster: str = ""):
    """A `joblib.Parallel` that yields results as they come, in any order.

    Args:
        jobs: processes of this machine; not used with a cluster.
        cluster: address of a Dask scheduler whose workers have this kit installed; empty for none.

    Raises:
        UnusableInput: an address that will not do, or where nobody answers.
    """
    if not cluster:
        with joblib.parallel_config("loky", initializer=_end_with, initargs=(os.getpid(),)):
            yield joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        return
    from distributed import Client

    try:
        client = Client(checked_address(cluster), timeout="5s")
    except OSError as error:
        raise UnusableInput(f"cluster {cluster}: nobody answers ({type(error).__name__})") from None
    with client, joblib.parallel_config("dask", wait_for_workers_timeout=60):
        yield joblib.Parallel(n_jobs=-1, return_as="generator_unordered")
