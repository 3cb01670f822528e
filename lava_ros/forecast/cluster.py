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

"""Members on the workers of a Dask scheduler that somebody else has started.

Workers keep nothing: a member goes to one as a few numbers and comes back as its footprint.
Another worker runs the members of one that dies again.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import pickle
from typing import Any
import warnings

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.forecast.ensemble import batches, run_here
from lava_ros.forecast.members import Plan
from lava_ros.forecast.pool import DEATHS
from lava_ros.forecast.probability import Footprint
from lava_ros.forecast.sampling import Member

#: Time for a scheduler to answer [s].
PATIENCE = 30.0


def run_on_cluster(
    plan: Plan, members: Sequence[Member], *, scheduler: str, device: str | None = None
) -> Iterable[Footprint]:
    """Run members on a cluster, and give their footprints as they finish, in any order.

    ``scheduler`` is an address such as ``tcp://host:8786``, and ``device`` the Warp device of
    every worker; with None a worker uses its first GPU, or the CPU without one.

    Raises:
        LavaError: Dask is not installed, the scheduler is out of reach, or a member fails.
    """
    require('distributed', '--scheduler', scheduler)
    from distributed import as_completed

    with _client(scheduler) as client:
        # a task and no data: where the worker that holds it dies, it is made again
        shared = client.submit(pickle.loads, pickle.dumps(plan), pure=False)
        running = {
            client.submit(_run, shared, device, part, pure=False): part[0].index
            for part in batches(plan, members, device)
        }
        for future in as_completed(list(running)):
            yield from _result(future, running.pop(future), scheduler)
            future.release()


def _result(future: Any, index: int, scheduler: str) -> list[Footprint]:
    from distributed import KilledWorker

    try:
        return future.result()
    except LavaError:
        raise
    except KilledWorker as error:
        right = f'one that does not end its worker; {DEATHS + 1} died (too little memory?)'
        raise LavaError(f'member {index}', str(error), right) from error
    except (ImportError, OSError) as error:
        right = f'workers that can run lava_ros ({error})'
        raise LavaError('--scheduler', scheduler, right) from error


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    from dask import config
    from distributed import Client

    settings = {'distributed.scheduler.allowed-failures': DEATHS}
    with config.set(settings), warnings.catch_warnings():
        # a terrain is large for a task
        warnings.filterwarnings('ignore', message='Sending large graph')
        try:
            client = Client(scheduler, timeout=PATIENCE)
        except (OSError, ValueError, TypeError) as error:
            right = f'the address of a Dask scheduler, such as tcp://host:8786 ({error})'
            raise LavaError('--scheduler', scheduler, right) from error
        with client:
            _check_workers(client, scheduler)
            yield client


def _check_workers(client: Any, scheduler: str) -> None:
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


def _version() -> str:
    return lava_ros.__version__


def _run(plan: Plan, device: str | None, members: Sequence[Member]) -> list[Footprint]:
    from lava_ros.simulation.backend.threads import use_threads

    use_threads(1)
    return list(run_here(plan, members, device=device))
