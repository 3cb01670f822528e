# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Members of live ensembles that several processes share, on a CPU as on a GPU."""

from collections.abc import Iterator
import os
import queue
import signal
from typing import Any

import pytest

from disc_flow import same
from lava_ros.errors import LavaError
from lava_ros.forecast import live_ensemble, member_processes
from lava_ros.forecast.live_ensemble import LiveEnsemble, LiveEnsembles
from lava_ros.forecast.member_processes import count_processes, MemberProcesses, MemberRuns
from lava_ros.forecast.members import plan_from
from lava_ros.forecast.process import Forecasting
from lava_ros.processes import requests
from lava_ros.simulation.output.checkpoint import Checkpoint
from live_scene import checkpoints_at, MEMBERS, RULES
from waiting import wait_until

COUNT = 2


@pytest.fixture(scope='module')
def moment() -> Checkpoint:
    return checkpoints_at([30.0])[0]


@pytest.fixture(scope='module')
def processes() -> MemberProcesses:
    return MemberProcesses(COUNT)


def finish(ensemble: LiveEnsemble) -> LiveEnsemble:
    wait_until(lambda: ensemble.advance(0.05) and ensemble.is_done)
    return ensemble


def test_members_in_processes_equal_those_of_one(
    processes: MemberProcesses, moment: Checkpoint
) -> None:
    ensemble = LiveEnsemble(moment, members=MEMBERS, processes=processes, **RULES)
    # it is cancelled with members under way, whose footprints must not reach the next one
    ensemble.advance(0.0)
    ensembles = [
        finish(LiveEnsemble(moment, members=MEMBERS, processes=shared, **RULES))
        for shared in (processes, None)
    ]
    assert same(*(one.maps() for one in ensembles))
    assert [one.progress for one in ensembles] == [1.0, 1.0]


def test_error_of_a_member_is_raised_and_the_processes_remain(
    processes: MemberProcesses, moment: Checkpoint
) -> None:
    with pytest.raises(ValueError, match=r'member \d is .*max_particles'):
        finish(LiveEnsemble(moment, members=2, processes=processes, max_particles=3, **RULES))
    ensemble = LiveEnsemble(moment, members=2, processes=processes, **RULES)
    assert finish(ensemble).maps().members == 2


def test_killed_process_ends_the_parent_which_the_node_starts_again(
    moment: Checkpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_ensemble, 'count_processes', lambda *_: COUNT)
    monkeypatch.setattr(member_processes, 'ChildProcess', Killed)
    orders: queue.SimpleQueue[Any] = queue.SimpleQueue()
    forecasting = Forecasting(orders, lambda *_, **__: None)
    order = {'members': 2, 'changes': 1, 'posterior': None, 'outlines': 0}
    values = {'number': 1, 'checkpoint': moment, 'is_first': True, 'ensemble': order}
    orders.put(('fork', values | RULES))
    with pytest.raises(ChildProcessError, match='killed by signal 9'):
        wait_until(forecasting.turn)


class Killed(member_processes.ChildProcess):
    """A process that ends before its first request."""

    def __init__(self, loop: str) -> None:
        super().__init__(loop)
        os.kill(self.pid, signal.SIGKILL)


class Slices:
    """A clock that only the runs of members move, by 0.02 s in each part, and its pauses."""

    def __init__(self) -> None:
        self.now, self.paused = 0.0, 0.0
        self.requests: list[Any] = []

    def monotonic(self) -> float:
        return self.now

    def running(self, *_: Any, **__: Any) -> Iterator[None]:
        while True:
            self.now += 0.02
            yield None

    def get(self, *, timeout: float | None) -> Any:
        if self.requests:
            return self.requests.pop(0)
        assert timeout is not None
        self.now += timeout
        self.paused += timeout
        raise queue.Empty


@pytest.mark.parametrize('share', [1.0, 0.5, 0.1])
def test_process_runs_members_for_its_share_of_time(
    monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    clock = Slices()
    for module in (requests, member_processes):
        monkeypatch.setattr(module, 'time', clock)
    monkeypatch.setattr(member_processes, 'running', clock.running)
    clock.requests = [
        ('share', {'share': share}), ('run', {'number': 1, 'plan': None, 'members': []})
    ]
    runs = MemberRuns(clock, lambda *_, **__: None)  # type: ignore[arg-type]
    while clock.now < 10.0:
        runs.turn()
    assert 1.0 - clock.paused / clock.now == pytest.approx(share, rel=0.1)
    clock.requests = [('cancel', {})]
    runs.turn()
    assert not runs.is_busy


def test_share_reaches_processes_that_start_later(
    moment: Checkpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares = []

    class Shares:
        def __init__(self, count: int) -> None:
            assert count == COUNT

        def share(self, share: float) -> None:
            shares.append(share)

        def running(self, *_: Any, **__: Any) -> Iterator[None]:
            while True:
                yield None

    monkeypatch.setattr(live_ensemble, 'count_processes', lambda *_: COUNT)
    monkeypatch.setattr(live_ensemble, 'MemberProcesses', Shares)
    ensembles = LiveEnsembles(lambda *_, **__: None)
    ensembles.share(0.25)
    ensembles.order(
        moment, number=1, changes=1, posterior=None, outlines=0, members=2, **RULES
    )
    ensembles.advance(0.0)
    ensembles.share(0.5)
    assert shares == [0.25, 0.5]


def test_a_cpu_shares_no_members() -> None:
    assert count_processes('cpu', 'particles') == count_processes(None, 'cells') == 1
    with pytest.raises(LavaError, match='device'):
        count_processes('gpu7', 'particles')


@pytest.mark.parametrize(('cores', 'memory', 'count'), [
    (16, 139, 4), (64, 139, 4), (8, 16, 2), (6, 16, 1), (16, 8, 2), (16, 3, 1)
])
def test_cores_and_memory_limit_the_processes_on_a_gpu(
    monkeypatch: pytest.MonkeyPatch, cores: int, memory: int, count: int
) -> None:
    class Gpu:
        is_cuda, free_memory = True, memory << 30

    monkeypatch.setattr('lava_ros.simulation.setup.defaults.device_of', lambda *_: Gpu)
    monkeypatch.setattr('lava_ros.simulation.backend.threads.usable_cores', lambda: cores)
    assert count_processes('cuda:0', 'particles') == count


def test_processes_divide_the_memory_of_the_batch(
    moment: Checkpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lava_ros.forecast.members import batch_of
    from lava_ros.simulation.simulation import SOLVERS

    plan = plan_from(moment, horizon=120.0)

    class Gpu:
        is_cuda, free_memory = True, 80

    class Solver:
        @staticmethod
        def bytes_for(*_: Any) -> int:
            return 1

    monkeypatch.setattr('lava_ros.simulation.setup.defaults.device_of', lambda *_: Gpu)
    monkeypatch.setitem(SOLVERS, 'particles', Solver)
    assert [batch_of(plan, None, sharing) for sharing in (1, 2, 4)] == [40, 20, 10]
