"""Executors of the runs of a batch: this process, worker processes, or a dask cluster."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from platoontraffic.errors import InputError, MissingError
from platoontraffic.study.processes import SILENT, Workers, run_in_a_process
from platoontraffic.study.silence import Job, Outcome, Pulse, Say, Silence
from platoontraffic.study.worker_process import WATCH

DASK_QUEUE = 256  # number of runs that are submitted to a dask scheduler at a time

Submit = Callable[[Job], "Future[Outcome]"]


@contextlib.contextmanager
def executor_of(name: str, slots: int, say: Say) -> Iterator[tuple[Submit, int]]:
    """A function that submits a run, and the number of runs to submit at a time.

    name : as in `batch.run`
    say  : called when a run makes no progress
    """
    if name == "serial":
        yield partial(_at_once, say=say), 1
    elif name == "processes":
        workers, threads = Workers(), ThreadPoolExecutor(slots)
        try:
            yield partial(threads.submit, workers.run, say=say), 2 * slots
        finally:
            with undisturbed():
                workers.close()
                threads.shutdown(cancel_futures=True)
    else:
        with _dask(name.partition(":")[2], slots, say) as cluster:
            yield partial(cluster.submit, run_in_a_process), DASK_QUEUE


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore SIGINT, SIGTERM and SIGHUP, so that clean-up ends."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _at_once(job: Job, say: Say) -> Future[Outcome]:
    from platoontraffic.study.worker import attempt  # imports libsumo, which other batches do not need

    pulse, ended = Pulse(job["id"], say), threading.Event()

    def watch() -> None:
        while not ended.wait(WATCH):
            pulse.check()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    future: Future[Outcome] = Future()
    try:
        future.set_result(attempt(job, pulse.beat))
    finally:
        ended.set()
        watcher.join()
        pulse.end()
    return future


@contextlib.contextmanager
def _dask(address: str, slots: int, say: Say) -> Iterator[Any]:
    """An executor on the cluster at an address; without an address, on a new cluster of `slots` processes."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise MissingError('dask is not installed: pip install "platoontraffic[cluster]"') from None
    with contextlib.ExitStack() as stack:
        if address:
            try:
                client = stack.enter_context(Client(address, timeout=10))
            except (OSError, ValueError) as error:
                what = " ".join(str(error).split())
                raise InputError(f"--executor: {address}: no dask scheduler can be reached: {what}") from None
        else:
            cluster = LocalCluster(n_workers=slots, threads_per_worker=1, dashboard_address=None)
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        client.subscribe_topic(SILENT, lambda event: say(Silence(*event[1])))
        executor = client.get_executor(pure=False)
        try:
            yield executor
        finally:
            with undisturbed():
                executor.shutdown(wait=False)
