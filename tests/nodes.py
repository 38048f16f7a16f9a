"""A Ray cluster of this machine, whose nodes can be lost. Its addresses are loopback's, one a node."""

import os
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from unittest.mock import patch

from samples import ROOT

FIRST = 2  # for Ray, 127.0.0.1 is another name of the machine's outer address
MEMORY = 100 * 1024 * 1024


class Nodes:
    """A head without CPUs, and so many nodes of one CPU each, or of more.

    Attributes:
        address: Of the head.
        client: Of the server for `ray://`.
    """

    def __init__(self, count: int, folder: Path, cpus: int = 1) -> None:
        self._folder, self._cpus = folder, cpus
        self._made = 0
        self._cluster: Any = None
        self._nodes: list[Any] = []
        self._start_head(None)
        for _ in range(count):
            self.add()

    def _start_head(self, port: int | None) -> None:
        from ray.cluster_utils import Cluster

        self.client = f"ray://127.0.0.{FIRST}:{(free := _free_port())}"
        own = {"node_ip_address": f"127.0.0.{FIRST}", "gcs_server_port": port, "ray_client_server_port": free}
        with self._environment():
            self._cluster = Cluster(
                initialize_head=True,
                shutdown_at_exit=True,
                head_node_args={
                    "num_cpus": 0,
                    "include_dashboard": False,
                    "object_store_memory": MEMORY,
                    **own,
                },
            )
        self.address = self._cluster.address

    @contextmanager
    def _environment(self) -> Iterator[None]:
        """What the nodes' processes inherit."""
        own = {"RAY_TMPDIR": str(self._folder), "RAY_USAGE_STATS_ENABLED": "0", "OMP_NUM_THREADS": "1"}
        with patch.dict(os.environ, own | {"PYTHONPATH": str(ROOT / "src")}):
            yield

    def add(self) -> None:
        """One more node."""
        self._made += 1
        place = f"127.0.0.{FIRST + self._made}"
        with self._environment():
            node = self._cluster.add_node(
                num_cpus=self._cpus, node_ip_address=place, object_store_memory=MEMORY
            )
        self._nodes.append(node)

    def lose(self, number: int) -> bool:
        """Kills a node; whether a cell was learned on it."""
        node = self._nodes.pop(number)
        busy = bool(_learning(node))
        _kill(node)
        return busy

    def lose_worker(self) -> bool:
        """Kills the process of a cell, if there is one."""
        for node in self._nodes:
            for worker in _learning(node):
                with suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGKILL)
                    return True
        return False

    def learning(self) -> int:
        """How many cells go on."""
        return sum(len(_learning(node)) for node in self._nodes)

    def restart(self) -> None:
        """Kills all of it, and starts as many nodes at the same address."""
        count, port = len(self._nodes), int(self.address.rpartition(":")[2])
        self.stop()
        self._start_head(port)
        for _ in range(count):
            self.add()

    def stop(self) -> None:
        for node in (*self._nodes, self._cluster.head_node):
            _kill(node)
        self._nodes = []


@contextmanager
def nodes(count: int, cpus: int = 1) -> Iterator[Nodes]:
    """For as long as the block."""
    folder = Path(tempfile.mkdtemp(prefix="ray-", dir="/tmp"))  # sockets have short names
    made = Nodes(count, folder, cpus)
    try:
        yield made
    finally:
        made.stop()
        shutil.rmtree(folder, ignore_errors=True)


def until(met: Any, seconds: float = 120.0) -> None:
    """Waits until a function gives what is true."""
    end = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.05)


def _kill(node: Any) -> None:
    """At once, as when the power is cut."""
    workers = _children(node)
    node.kill_all_processes(check_alive=False, allow_graceful=False, wait=True)
    for worker in workers:
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)


def _learning(node: Any) -> list[int]:
    found = []
    for worker in _children(node):
        with suppress(OSError):
            if b"_learn" in Path(f"/proc/{worker}/cmdline").read_bytes():
                found.append(worker)
    return found


def _children(node: Any) -> list[int]:
    """The processes that a node's raylet started."""
    raylet = node.all_processes["raylet"][0].process.pid
    with suppress(OSError):
        told = [child.read_text() for child in Path(f"/proc/{raylet}/task").glob("*/children")]
        return [int(each) for each in " ".join(told).split()]
    return []


def _free_port() -> int:
    import socket

    with socket.socket() as found:
        found.bind((f"127.0.0.{FIRST}", 0))
        return int(found.getsockname()[1])
