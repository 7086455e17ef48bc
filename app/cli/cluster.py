"""Work in several processes or on several machines, by dask.distributed: --workers N, --scheduler ADDRESS.

A task is a function of its arguments, so any process returns the same bits. Tasks of a lost process run elsewhere.
"""

from __future__ import annotations

import asyncio
import functools
import logging
import pickle
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from app import values
from app.cli.version import need
from app.settings import UsageError

ANSWER_TIME = 10  # s until a scheduler must have answered, and a worker joined it
TLS = "DASK_DISTRIBUTED__COMM__TLS__"  # variables of dask's settings


def options(add: Callable) -> None:
    """Add --workers and --scheduler."""
    add("--workers", type=values.workers, metavar="N", help="work in N processes of this machine (1)")
    add("--scheduler", metavar="ADDRESS", help="work on the machines of a dask scheduler, tcp://HOST:8786")


class Machines:
    """Processes of a scheduler."""

    def __init__(self, client, threads: int | None) -> None:
        """threads: per process; None: the cores of its machine."""
        self.client, self._threads = client, threads

    @property
    def processes(self) -> int:
        """Processes at present, at least 1."""
        return max(len(self.client.scheduler_info(n_workers=-1)["workers"]), 1)

    def ask(self, question: Callable[[], Any]) -> list[Any]:
        """Return the answer of each process."""
        return list(self.client.run(question).values())

    def crew(self, prepare: Callable, job: Any) -> Callable[[Callable, Iterable[tuple]], Iterator[Any]]:
        """Give a job to all processes. Each calls prepare(job, threads) once, before its first task.

        Return a function of run and tasks: it yields run(prepared, *task) of each, in order, and raises what that
        raises.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the scheduler keeps the job, however large: a lost process loses nothing
            return functools.partial(self._map, self.client.submit(bytes, pickle.dumps((prepare, job, self._threads))))

    def _map(self, data, run: Callable, tasks: Iterable[tuple]) -> Iterator[Any]:
        waiting: list = []
        for task in tasks:
            waiting.append(self.client.submit(_run, data, run, task, pure=False))
            if len(waiting) >= 4 * self.processes:  # 4 tasks per process that are not waited for
                yield waiting.pop(0).result()
        while waiting:
            yield waiting.pop(0).result()


@contextmanager
def opened(workers: int | None, scheduler: str | None) -> Iterator[Machines | None]:
    """Connect to a scheduler or start processes; None without either. Raises UsageError."""
    if workers is None and scheduler is None:
        yield None
        return
    if workers is not None and scheduler is not None:
        raise UsageError("--workers starts processes here, --scheduler has its own: give one of them")
    need("distributed", "runs several processes")
    if scheduler is not None:
        with _remote(scheduler) as machines:
            yield machines
        return
    need("cryptography", "keeps other users of this machine out of the processes")
    import dask
    from distributed import Client, LocalCluster, Security

    from gi_core.base.threads import available_cores

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    # A process of dask runs any function that reaches its port, imports modules from its temporary directory, and
    # tells its state by HTTP: certificates of this run alone, a directory of mode 700, no pages.
    with tempfile.TemporaryDirectory(prefix="gi-viewer-") as private:
        # a task is the cause after 20 losses of processes in which it may run
        private_only = {
            "temporary-directory": private,
            "distributed.scheduler.http.routes": [],
            "distributed.worker.http.routes": [],
            "distributed.scheduler.allowed-failures": 20,
        }
        started = {
            "n_workers": workers,
            "threads_per_worker": 1,
            "memory_limit": 0,
            "security": Security.temporary(),
            "host": "127.0.0.1",
            "dashboard_address": "127.0.0.1:0",
            "scheduler_kwargs": {"dashboard": False},
            "silence_logs": logging.CRITICAL,
        }
        with dask.config.set(private_only), LocalCluster(**started) as cluster, Client(cluster) as client:
            yield Machines(client, max(available_cores() // workers, 1))


@contextmanager
def _remote(scheduler: str) -> Iterator[Machines]:
    from distributed import Client, Security
    from distributed.core import rpc

    def fail(said: str) -> NoReturn:
        raise UsageError(f"--scheduler {scheduler}: {said}") from None

    logging.getLogger("distributed").setLevel(logging.CRITICAL)

    async def identify(arguments: dict) -> None:
        async with (
            asyncio.timeout(ANSWER_TIME),
            rpc(scheduler, timeout=ANSWER_TIME, connection_args=arguments) as asked,
        ):
            await asked.identity(n_workers=0)

    try:
        arguments = Security().get_connection_args("client")
        if scheduler.startswith("tls://") and arguments["ssl_context"] is None:
            fail(f"tls:// needs certificates: set {TLS}CA_FILE, {TLS}CLIENT__CERT and {TLS}CLIENT__KEY")
        asyncio.run(identify(arguments))  # Client has no deadline for a scheduler that accepts and is silent
        client = Client(scheduler, timeout=ANSWER_TIME)
    except UsageError:
        raise
    except TimeoutError:
        fail(f"no dask scheduler answers (not within {ANSWER_TIME} s)")
    except Exception as error:  # of the address, the network, the certificates: dask raises anything
        fail(f"no dask scheduler answers ({str(error) or type(error).__name__})")
    with client:
        try:
            client.wait_for_workers(1, timeout=ANSWER_TIME)
        except TimeoutError:
            fail(f"no worker has joined; start `dask worker {scheduler}` on a machine")
        yield Machines(client, None)


_one_at_a_time = threading.Lock()


@functools.lru_cache(maxsize=1)
def _ready(data: bytes) -> Any:
    from gi_core.instruments import compile_ahead

    if not compile_ahead.is_warm():
        for _ in compile_ahead.compile_kernels():
            pass
    prepare, job, threads = pickle.loads(data)
    return prepare(job, threads)


def _run(data: bytes, run: Callable, task: tuple) -> Any:
    """Carry out a task, in a process of the cluster."""
    with _one_at_a_time:
        return run(_ready(data), *task)
