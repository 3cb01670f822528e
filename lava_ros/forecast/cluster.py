# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Members on Dask distributed: on the cores or GPUs of this machine, or on a cluster.

Workers keep nothing: a member goes to one as a few numbers and comes back as its footprint. What a
worker that dies was about, another one does again.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import logging
import pickle
import signal
from typing import Any
import warnings

import lava_ros
from lava_ros.cores import usable_cores
from lava_ros.errors import LavaError
from lava_ros.forecast.members import batch_of, Plan, run_members
from lava_ros.forecast.probability import Footprint, footprint_of
from lava_ros.forecast.sampling import Member

#: Time for a scheduler to answer [s].
PATIENCE = 30.0

#: Workers that a member may take with it before it is to blame.
DEATHS = 3


class DaskRunner:
    """Runs members on a cluster."""

    def __init__(
        self,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        device: str | None = None,
        batch: int | None = None,
    ) -> None:
        """Describe the cluster.

        Args:
            workers: Processes on this machine; None: one for each GPU, or else for each core.
            scheduler: Address of a scheduler to use instead, such as ``tcp://host:8786``.
            device: Warp device of every worker; None: its own GPU, or else the CPU.
            batch: Members that a worker runs side by side; by the device when left out.

        Raises:
            LavaError: Dask is not installed.
        """
        require_dask()
        self._workers = workers
        self._scheduler = scheduler
        self._device = device
        self._batch = batch_of(device) if batch is None else batch

    def __call__(self, plan: Plan, members: Sequence[Member]) -> Iterable[Footprint]:
        """Run members, and give what each did as they finish, in any order.

        Raises:
            LavaError: The scheduler is out of reach, or a member fails.
        """
        from distributed import as_completed

        with self._client(len(members)) as client:
            # a task and no data: where the worker that holds it dies, it is made again
            shared = client.submit(pickle.loads, pickle.dumps(plan), pure=False)
            running = {
                client.submit(
                    _run, shared, members[start : start + self._batch], self._device, pure=False
                ): members[start].index
                for start in range(0, len(members), self._batch)
            }
            for future in as_completed(list(running)):
                yield from self._result(future, running.pop(future))
                future.release()

    def _result(self, future: Any, index: int) -> list[Footprint]:
        from distributed import KilledWorker

        try:
            return future.result()
        except LavaError:
            raise
        except KilledWorker as error:
            right = f'a worker that survives it; {DEATHS + 1} died of it, for want of memory?'
            raise LavaError(f'member {index}', str(error), right) from error
        except (ImportError, OSError) as error:
            raise LavaError(
                '--scheduler', self._scheduler, f'workers that can run lava_ros ({error})'
            ) from error

    @contextmanager
    def _client(self, members: int) -> Iterator[Any]:
        from dask import config
        from distributed import Client, LocalCluster

        settings = {
            'distributed.scheduler.allowed-failures': DEATHS,
            # what a worker prints as it dies says less than the error does
            'distributed.admin.log-format': '%(name)s: %(message)s',
        }
        quiet = logging.getLogger('distributed')
        level = quiet.level
        with config.set(settings), warnings.catch_warnings():
            # a terrain is large for a task
            warnings.filterwarnings('ignore', message='Sending large graph')
            if self._scheduler is not None:
                try:
                    client = Client(self._scheduler, timeout=PATIENCE)
                except (OSError, ValueError, TypeError) as error:
                    right = f'the address of a Dask scheduler, such as tcp://host:8786 ({error})'
                    raise LavaError('--scheduler', self._scheduler, right) from error
                with client:
                    _check_workers(client, self._scheduler)
                    yield client
                return
            quiet.setLevel(logging.ERROR)
            count = min(self._workers or default_workers(), members)
            try:
                with (
                    LocalCluster(
                        n_workers=count,
                        threads_per_worker=1,
                        processes=True,
                        dashboard_address=None,
                        silence_logs=logging.ERROR,
                    ) as cluster,
                    Client(cluster) as client,
                ):
                    client.register_plugin(_deaf_to_interrupts())
                    yield client
            finally:
                quiet.setLevel(level)


def default_workers() -> int:
    """One for each GPU, or else for each core of this machine that we may use."""
    wp = _quiet_warp()
    return len(wp.get_cuda_devices()) or usable_cores()


def require_dask() -> None:
    """Do nothing where Dask distributed can be imported.

    Raises:
        LavaError: It cannot; the message says how to get it.
    """
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise LavaError(
            '--workers', 'several', "1, or Dask distributed: pip install 'lava_ros[ensemble]'"
        ) from error


def _check_workers(client: Any, scheduler: str) -> None:
    """Refuse a cluster whose workers would run other code than this."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
        versions = client.run(_version)
    except (TimeoutError, OSError) as error:
        raise LavaError('--scheduler', scheduler, 'a scheduler with workers') from error
    except ImportError as error:
        raise LavaError('--scheduler', scheduler, 'workers with lava_ros installed') from error
    for worker, version in versions.items():
        if version != lava_ros.__version__:
            right = f'lava_ros {lava_ros.__version__}, as here'
            raise LavaError(f'lava_ros of worker {worker}', version, right)


def _deaf_to_interrupts() -> Any:
    """A plugin that leaves Ctrl+C to this process, which then ends its workers in order."""
    from distributed import WorkerPlugin

    class DeafToInterrupts(WorkerPlugin):
        name = 'deaf-to-interrupts'

        def setup(self, worker: Any) -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    return DeafToInterrupts()


def _version() -> str:
    return lava_ros.__version__


def _run(plan: Plan, members: Sequence[Member], device: str | None) -> list[Footprint]:
    """Run a batch on a worker, which is as much as a core does."""
    from lava_ros.simulation.threads import use_threads

    use_threads(1)
    fields = run_members(plan, members, device=device or own_device())
    return [footprint_of(item, plan) for item in fields]


def own_device() -> str | None:
    """The GPU of this worker where there are several, shared out by the workers' numbers."""
    from distributed import get_worker

    devices = _quiet_warp().get_cuda_devices()
    name = get_worker().name
    if len(devices) < 2 or not isinstance(name, int):
        return None
    return str(devices[name % len(devices)])


def _quiet_warp() -> Any:
    # importing the solver keeps Warp from printing what it finds
    import warp as wp

    import lava_ros.simulation  # noqa: F401

    return wp
