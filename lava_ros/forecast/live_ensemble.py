# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles that continue a running simulation, and are conditioned on observed outlines.

Members start from the state of the simulation, with its resolution and effects, and then differ
in their drawn inputs. Member k has the same draws in successive ensembles until an outline
arrives, which weights these members. The next ensemble draws new members near the members of high
weight.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import time as wall_clock
from typing import Any

import numpy as np

from lava_ros.errors import LavaError, RefusalError
from lava_ros.forecast.assimilation import jaccard, Outline, weigh, Weights
from lava_ros.forecast.member_processes import count_processes, MemberProcesses, run_in_parts
from lava_ros.forecast.members import plan_from
from lava_ros.forecast.probability import (
    EnsembleAccumulator,
    Footprint,
    footprint_by,
)
from lava_ros.forecast.sampling import draw_members, Posterior
from lava_ros.layers.forecast import HazardMaps
from lava_ros.layers.places import Places
from lava_ros.processes.requests import Answer
from lava_ros.scene.ranges import describe_inputs
from lava_ros.simulation.output.checkpoint import Checkpoint

#: Number of members in the first maps of a scene; new maps follow at each doubling.
FIRST_MAPS = 4


@dataclass(eq=False)
class Population:
    """Drawn inputs that successive ensembles share, and their agreement with observed outlines.

    Attributes:
        posterior: Distribution of the members; None for the distribution of the scene.
        outlines: Number of outlines that the distribution and the agreement contain.
        agreement: Agreement of the members with the outlines since they were drawn, float64, one
            value from 0 to 1 per member; None without such an outline.
    """

    posterior: Posterior | None = None
    outlines: int = 0
    agreement: np.ndarray | None = None

    @property
    def generation(self) -> int:
        """Number of earlier populations that led to this one."""
        return 0 if self.posterior is None else self.posterior.generation

    def weights(self, count: int) -> Weights:
        """Return the weights of the first members.

        Raises:
            LavaError: If none of them agrees with the outlines.
        """
        return weigh(np.ones(count) if self.agreement is None else self.agreement[:count])


class LiveEnsemble:
    """An ensemble from one state that runs as many members at once as fit on the device."""

    def __init__(
        self,
        checkpoint: Checkpoint,
        *,
        members: int,
        horizon: float,
        threshold: float,
        device: str | None = None,
        max_particles: int | None = None,
        begun: float | None = None,
        places: Places | None = None,
        number: int = 0,
        stamp_ns: int = 0,
        population: Population | None = None,
        exact: Sequence[str] = (),
        processes: MemberProcesses | None = None,
    ) -> None:
        """Draw the members; each runs from the checkpoint to ``horizon`` [s] after it.

        ``population`` has the distribution of the members, by default that of the scene.
        ``begun`` is the start of the ensemble on the monotonic clock [s], by default now.
        The maps include arrival times at ``places``. ``exact`` names the quantities that are not
        drawn. ``number`` and ``stamp_ns``, a ROS time [ns], identify the ensemble in replies.
        The members run in ``processes``, if any. Other arguments are those of ``ForecastRun``.

        Raises:
            LavaError: If an argument is not valid, or no input of the scene is uncertain.
        """
        self.number, self.stamp_ns, self._places = number, stamp_ns, places
        if exact:
            scene = checkpoint.scene
            fixed = scene.uncertainty.fixing(exact)
            checkpoint = replace(checkpoint, scene=replace(scene, uncertainty=fixed))
        self.plan = plan_from(checkpoint, horizon=horizon, threshold=threshold)
        self.start, self.inputs = checkpoint.time, describe_inputs(self.plan.scene)
        self.population = population or Population()
        self._members = draw_members(
            self.plan.scene, members, posterior=self.population.posterior
        )
        self.asked = len(self._members)
        self._begun = wall_clock.monotonic() if begun is None else begun
        self._shares: dict[int, float] = {}
        run_members = run_in_parts if processes is None else processes.running
        self._running = run_members(
            self.plan,
            self._members,
            device=device,
            max_particles=max_particles,
            progress=self._shares,
        )
        # a member waits until all lower numbers are done, because fast members finish first
        self._ahead: dict[int, Footprint] = {}
        self._footprints: list[Footprint] = []
        self.duration = 0.0
        self.is_done = False

    @property
    def count(self) -> int:
        """Number of completed members, without gaps from member 0."""
        return len(self._footprints)

    @property
    def progress(self) -> float:
        """Fraction of the members that have run."""
        return sum(self._shares.values()) / self.asked

    def covers(self, time: float) -> bool:
        """Return True if a simulated time [s] is between the start and the horizon."""
        return self.start < time <= self.start + self.plan.horizon

    def advance(self, wall_limit: float) -> bool:
        """Run for about a wall time [s] or until a member is done.

        Returns:
            True if a member, or the whole ensemble, is done.

        Raises:
            LavaError: If a member has no valid scene, too many particles or no valid flow.
        """
        until, before = wall_clock.monotonic() + wall_limit, self.count
        for footprint in self._running:
            if footprint is not None:
                self._ahead[footprint.index] = footprint
                self.duration = wall_clock.monotonic() - self._begun
            while self.count in self._ahead:
                self._footprints.append(self._ahead.pop(self.count))
            if self.count > before or wall_clock.monotonic() > until:
                break
        else:
            self.is_done = True
        self.is_done |= self.count == self.asked
        return self.is_done or self.count > before

    def agreement(self, outline: Outline) -> np.ndarray:
        """Return the Jaccard index of each member with an outline, float64, shape [asked].

        Members that have not run get the mean index of the completed members.
        """
        time = outline.time - self.start
        found = [jaccard(footprint_by(one, self.plan, time), outline) for one in self._footprints]
        return np.array(found + [float(np.mean(found))] * (self.asked - self.count))

    def posterior(self, generation: int) -> Posterior:
        """Return the distribution of the members so far, with the weights by the outlines."""
        weights = self.population.weights(self.count).values
        return Posterior(self._members[: self.count], weights, generation)

    def maps(self) -> HazardMaps:
        """Return the maps of the members so far, with the weights by the outlines."""
        tally = EnsembleAccumulator(self.plan, self._places)
        weights = self.population.weights(self.count).values.tolist()
        for footprint, weight in zip(self._footprints, weights, strict=True):
            tally.add(footprint, weight)
        return tally.maps()


class LiveEnsembles:
    """The successive ensembles of a running simulation, and the observed outlines.

    Replies (``process``) are ``ensemble`` with number, stamp_ns, changes and the fields of
    ``EnsembleForecast``, ``weighed`` after an outline has been used, with the distribution from
    which the next ensemble draws, and ``outline_refused`` with number and error.

    Attributes:
        current: The ensemble in progress, None if there is none.
    """

    def __init__(self, answer: Answer) -> None:
        """Initialize without an ensemble."""
        self._answer = answer
        self._processes: MemberProcesses | None = None
        self._share = 1.0
        self._changes: int | None = None
        self._ordered: Callable[[], LiveEnsemble] | None = None
        self.current: LiveEnsemble | None = None
        self._shown: LiveEnsemble | None = None
        # the first complete ensemble of each population, whose members differ most
        self._first: list[LiveEnsemble] = []
        self._population = Population()
        self._next_maps = FIRST_MAPS
        self._waiting: list[tuple[int, Outline]] = []

    @property
    def is_busy(self) -> bool:
        """True if an ensemble is in progress or requested."""
        return self.current is not None or self._ordered is not None

    def share(self, share: float) -> None:
        """Set the maximum fraction of the time in which processes of members may compute."""
        self._share = share
        if self._processes is not None:
            self._processes.share(share)

    def order(
        self,
        checkpoint: Checkpoint,
        *,
        changes: int,
        posterior: Posterior | None,
        outlines: int,
        **how: Any,
    ) -> None:
        """Replace the ensemble in progress by a new one at the next ``advance``.

        ``changes`` is a number that changes with the scene. The first ensemble of a scene draws
        from ``posterior``, the distribution after a number of earlier ``outlines``; None without
        outlines. ``how`` are further arguments of ``LiveEnsemble``.
        """
        self.drop()
        if changes != self._changes:
            # outlines do not apply to another scene
            self._changes = changes
            self._shown, self._first = None, []
            self._population = Population(posterior, outlines)
        begun, population = wall_clock.monotonic(), self._population

        def begin() -> LiveEnsemble:
            if self._processes is None:
                count = count_processes(how.get('device'), checkpoint.accuracy.method)
                if count > 1:
                    self._processes = MemberProcesses(count)
                    self._processes.share(self._share)
            return LiveEnsemble(
                checkpoint, begun=begun, population=population, processes=self._processes, **how
            )

        self._ordered = begin

    def drop(self) -> None:
        """Cancel the ensemble in progress; finished ones remain."""
        self._ordered = self.current = None
        waiting, self._waiting = self._waiting, []
        problem = 'The ensemble was cancelled before it could use the outline'
        for number, _ in waiting:
            remedy = 'Publish the outline again'
            self._refuse(number, RefusalError('observed_outline', problem, remedy))

    def advance(self, wall_limit: float) -> None:
        """Run members for about a wall time [s].

        Raises:
            LavaError: If an ensemble cannot be made or run.
        """
        if self._ordered is not None:
            begin, self._ordered = self._ordered, None
            self.current, self._next_maps = begin(), FIRST_MAPS
        ensemble = self.current
        if ensemble is None or not ensemble.advance(wall_limit):
            return
        known = ensemble.population.agreement
        if ensemble.is_done:
            self.current, self._shown = None, ensemble
            first = [item for item in self._first if item.covers(ensemble.start)]
            if all(item.population is not ensemble.population for item in first):
                first.append(ensemble)
            # keep the oldest for late outlines, and few others to save memory
            self._first = [*first[:1], *first[1:][-2:]]
            self._send_maps(ensemble)
            waiting, self._waiting = self._waiting, []
            for number, outline in waiting:
                self.observe(number, outline)
        elif (
            self._shown in (None, ensemble)
            and ensemble.count >= self._next_maps
            and (known is None or known[: ensemble.count].any())
        ):
            self._shown, self._next_maps = ensemble, 2 * ensemble.count
            self._send_maps(ensemble)

    def observe(self, number: int, outline: Outline) -> None:
        """Weight the members by an outline, and draw the members of the next ensemble near them.

        They are compared with it in the first complete ensemble that covers its time, of the
        population that contains most outlines, and of the newest such population. An outline waits
        if this is the ensemble in progress, and is refused if no ensemble covers its time.
        """
        known = [item for item in (*self._first, self._shown, self.current) if item is not None]
        covering = [item for item in known if item.covers(outline.time)]

        def rank(item: LiveEnsemble) -> tuple[int, int]:
            return item.population.outlines, item.population.generation

        # the first one of several equals
        best = max(covering, key=rank, default=None)
        if best is not None and best is self.current:
            self._waiting.append((number, outline))
        elif best is not None:
            self._weigh(number, outline, best)
        else:
            since = 'there is none'
            if known:
                first = min(item.start for item in known)
                since = f'after {first:.0f} s, the start of the first'
            expected = f'a time within the horizon of an ensemble ({since})'
            value = f'{outline.time:.0f} s of simulated time'
            self._refuse(number, LavaError('observed_outline.header.stamp', value, expected))

    def _weigh(self, number: int, outline: Outline, ensemble: LiveEnsemble) -> None:
        found, old = ensemble.agreement(outline), ensemble.population
        before = old.weights(ensemble.count).effective_members
        together = found if old.agreement is None else old.agreement * found
        try:
            weigh(together[: ensemble.count])
        except LavaError as error:
            self._refuse(number, error)
            return
        old.agreement = together / together.max()
        old.outlines += 1
        posterior = ensemble.posterior(self._population.generation + 1)
        self._population = Population(posterior, old.outlines)
        self._answer(
            'weighed',
            number=number,
            posterior=posterior,
            outlines=old.outlines,
            jaccard_mean=float(found.mean()),
            effective_before=before,
        )
        if self._shown is not None:
            self._send_maps(self._shown)

    def _refuse(self, number: int, error: LavaError) -> None:
        self._answer('outline_refused', number=number, error=error)

    def _send_maps(self, ensemble: LiveEnsemble) -> None:
        self._answer(
            'ensemble',
            number=ensemble.number,
            stamp_ns=ensemble.stamp_ns,
            changes=self._changes,
            time=ensemble.start,
            horizon=ensemble.plan.horizon,
            threshold=ensemble.plan.threshold,
            maps=ensemble.maps(),
            asked=ensemble.asked,
            is_done=ensemble.is_done,
            outlines=ensemble.population.outlines,
            duration=ensemble.duration,
            drawn='; '.join(
                f'{name.replace("_", " ")} {item["distribution"]}'
                for name, item in ensemble.inputs['drawn'].items()
            ),
            exact=', '.join(name.replace('_', ' ') for name in ensemble.inputs['exact']),
        )
