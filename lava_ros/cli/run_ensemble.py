# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""An ensemble of runs for `lava run --members`: its folders, maps, bags and report."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import json
import logging
from pathlib import Path
import sys
import time
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.cli import run_barriers
from lava_ros.cli.arrivals import add_arrivals, check_places, print_arrivals
from lava_ros.cli.console import made_folder, Progress, with_units, write_json
from lava_ros.cli.ensemble_report import (
    describe_agreement,
    print_report,
    score_against_case,
    summarize,
)
from lava_ros.cli.ensemble_request import (
    folder_of,
    observation_of,
    runner_of,
    susceptibility_of,
    wanted_ensemble,
    with_spacing,
)
from lava_ros.cli.run_options import DEMO, RunOptions
from lava_ros.files.optional import require
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.atlas_bag import write_atlas_bag
from lava_ros.forecast.ensemble import Ensemble, run_ensemble
from lava_ros.forecast.ensemble_error import measure_ensemble_error
from lava_ros.forecast.influence import Influences, influences_of
from lava_ros.forecast.member_scenes import check_members
from lava_ros.forecast.members import Plan
from lava_ros.forecast.sampling import (
    draw_members,
    MAX_MEMBERS,
    Member,
    parents_digest,
    Posterior,
)
from lava_ros.forecast.store import BAG, plan_in, Store
from lava_ros.hindcast.case import Case
from lava_ros.layers.forecast import HazardMaps
from lava_ros.products.ensemble_files import write_atlas
from lava_ros.products.gis import Provenance, require_formats, usual_formats
from lava_ros.products.run_warnings import sentences, warnings_of_plan
from lava_ros.runs.store import FINISHED, known_record, write_record
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.scene.onset import Onset
from lava_ros.scene.projection import coordinate_system
from lava_ros.scene.reshaping import Barrier
from lava_ros.scene.uncertainty import uncertainty_to_dict
from lava_ros.simulation.numerical_error import mean_difference, NOT_MEASURED, NumericalError

_LOG = logging.getLogger(__name__)

#: Folders of the maps that are weighted by an observation and, with its time, of new members near
#: those that agree with it.
WEIGHTED, POSTERIOR = 'weighted', 'posterior'


@dataclass
class _Runs:
    """The runs of a command, which have everything in common but their members and folders.

    Attributes:
        options: The options.
        case: The mapped eruption; None for another scene.
        output: Folder of the ensemble.
        kept: Arguments of ``Store`` in addition to folder and plan.
        runner: Function that runs the members.
        where: Description of the machine for the report.
        remarks: Warnings about the inputs.
        outline: Observed lava; None for none.
        error: Numerical error of a member, once it is measured.
        influences: The quantities that decide the inundated area, once they are known.
        files: The written files.
    """

    options: RunOptions
    case: Case | None
    output: Path
    kept: dict[str, Any]
    runner: Any
    where: dict[str, Any]
    remarks: Sequence[str]
    outline: Outline | None
    error: NumericalError | None = None
    influences: Influences | None = None
    files: list[str] = field(default_factory=list)

    def run(
        self, store: Store, members: Sequence[Member], which: str
    ) -> tuple[Ensemble, float]:
        """Run members, and return them with the wall time [s]; maps are written at intervals."""
        started = time.monotonic()
        try:
            with Progress() as progress:
                progress.show(f'{which} begin', 0.0)
                done = run_ensemble(
                    members,
                    store,
                    runner=self.runner,
                    outline=self.outline,
                    on_finished=lambda done, resumed: progress.show(
                        f'{done} of {len(members)} {which}',
                        (done - resumed) / (len(members) - resumed),
                    ),
                    on_maps=lambda maps: self.write_maps(store.plan, maps, store.path),
                )
        except KeyboardInterrupt:
            print('lava run: interrupted; the same command continues', file=sys.stderr)
            raise
        return done, time.monotonic() - started

    def summary(
        self, plan: Plan, maps: HazardMaps, done: Ensemble, wall: float
    ) -> dict[str, Any]:
        """Return the numbers of maps and of the members that took a wall time [s]."""
        return {
            **summarize(self.options, plan, maps, done, wall, self.where),
            'warnings': [*sentences(*self.remarks), *warnings_of_plan(plan)],
        }

    def origin(self, plan: Plan, seen: str = 'none') -> Provenance:
        """Return the origin of maps, for their tags."""
        source = self.options.source
        name = Path(str(source.path or source.terrain or DEMO)).name
        return Provenance(
            name, tuple(plan.effects), self.options.preset, observation=seen,
            onset=Onset.of(plan.scene),
        )

    def write_maps(
        self, plan: Plan, maps: HazardMaps, folder: Path, seen: str = 'none'
    ) -> list[str]:
        """Write maps to a folder, and return the files."""
        tags = {
            'seed': str(self.options.seed),
            'numerical_error': NOT_MEASURED if self.error is None else self.error.brief(),
        }
        if self.influences is not None:
            tags['influence'] = json.dumps(self.influences.as_dict())
        origin = self.origin(plan, seen)
        return [
            str(path)
            for path in write_atlas(folder, maps, plan, origin, tags, self.options.formats)
        ]

    def keep(
        self, plan: Plan, maps: HazardMaps, folder: Path, report: dict[str, Any],
        seen: str = 'none',
    ) -> None:
        """Write maps and a bag with a report to a folder."""
        self.files += self.write_maps(plan, maps, folder, seen)
        data = {'ensemble': json.dumps(report), 'effects': json.dumps(report['effects'])}
        bag = folder / BAG
        write_atlas_bag(bag, maps, plan, stamp_ns=time.time_ns(), custom_data=data)
        self.files.append(str(bag))

    def scores(
        self, store: Store, count: int, folder: Path, weights: list[float] | None = None
    ) -> dict[str, Any]:
        """Return the scores against a mapped eruption, which are none for another scene."""
        if self.case is None:
            return {}
        return score_against_case(
            self.case, store.plan, store.finished(count), folder,
            weights=weights, outline=self.outline,
        )


def run_members(options: RunOptions) -> int:
    """Run the ensemble of the options, and return the exit status of `lava run`."""
    require('rasterio', 'GeoTIFF')
    if options.posterior is not None:
        validation.whole('--posterior', options.posterior, at_least=1, at_most=MAX_MEMBERS)
    wanted = wanted_ensemble(options)
    plan, terrain = wanted.plan, wanted.plan.scene.terrain
    check_places(options.places, terrain)
    barriers = run_barriers.barriers_of(options, terrain, plan.horizon)
    susceptibility = susceptibility_of(options, terrain)
    output, described = folder_of(options, wanted, susceptibility)
    crs = coordinate_system(terrain.epsg, terrain.wkt)
    formats = usual_formats(crs) if options.formats is None else options.formats
    require_formats(formats, output, crs)
    outline, observation = observation_of(options, plan)
    kept: dict[str, Any] = {'seed': options.seed, 'susceptibility': susceptibility}
    members = draw_members(plan.scene, options.members, **kept)
    check_members(plan.scene, members)
    described = {**kept, **described}
    runner = runner_of(options, plan)
    plan, preset, found = with_spacing(options, plan, output)
    options = replace(options, preset=preset)
    runs = _Runs(options, wanted.case, output, described, *runner, wanted.remarks, outline)
    # all folders of the command must be usable before any member runs or a file is written
    known = plan_in(output, plan, **kept)
    if options.posterior:
        plan_in(**_of_posterior(runs, known, members), **kept)
    if barriers:
        plan_in(**_with_barriers(runs, known, barriers), **kept)
    store = Store(output, plan, **runs.kept)
    # a repeated command has the preset that was planned
    store.put({'preset': preset})
    if found:
        print(found)
    done, wall = runs.run(store, members, 'members')
    plan = store.plan
    if options.scheduler is None:
        runs.error = measure_ensemble_error(store, done.maps.members, device=options.device)
    runs.influences = influences_of(plan.scene, members, store.finished(len(members)))
    report = runs.summary(plan, done.maps, done, wall)
    report |= _described(plan, members, done, runs)
    report |= runs.scores(store, len(members), output)
    runs.keep(plan, done.maps, output, report)
    if done.weighted is not None:
        report |= _weighted(runs, store, done, wall, observation)
    if options.posterior:
        report['posterior'] = _posterior(runs, plan, members, done, observation)
    if barriers:
        report['barriers'] = _dammed(runs, plan, members, barriers)
    report['files'] = runs.files
    # the bag and the tags of the maps have the error of the spacing as it is read from them
    plain = with_units(report, m='spacing usable_spacing')
    store.finish(plain)
    record = {'folder': str(output), **store.record}
    maps = output / WEIGHTED if options.observed else output
    table = add_arrivals(record, options.places, maps)
    write_json(record, options.json)
    print_report({**report, 'quantities': store.record['quantities']}, plan, runs.error)
    print_arrivals(table)
    _warn_of_stale(output, report['members'])
    return 0


def _warn_of_stale(output: Path, members: int) -> None:
    """Warn of folders in that of an ensemble whose maps are of another number of members."""
    for name, option in (
        (WEIGHTED, '--observed'), (run_barriers.WITH_BARRIERS, '--barriers'),
    ):
        known = known_record(output / name).get('members', members)
        if known != members:
            also = f' and {output / run_barriers.COMPARISON}' if option == '--barriers' else ''
            _LOG.warning(
                f'the maps in {output / name}{also} are of {known} members, not of {members}: '
                f'repeat the command with {option}, or delete them'
            )


def _described(
    plan: Plan, members: Sequence[Member], done: Ensemble, runs: _Runs
) -> dict[str, Any]:
    """Return what was drawn, and how far the maps can be trusted."""
    assert runs.influences is not None
    scene, case = plan.scene, runs.case
    report: dict[str, Any] = {
        'influence': runs.influences.as_dict(),
        'numerical_error': None if runs.error is None else runs.error.as_dict(),
        'erupting_lava': EruptingLava.of(scene).as_dict(),
        'difference_of_members': mean_difference(
            0.01 * np.nan_to_num(done.maps.probability), done.maps.members
        ),
    }
    if scene.uncertainty.eruption:
        lengths = [member.eruption[0] for member in members if member.eruption]
        report['eruptions_cut_off'] = sum(length > plan.horizon for length in lengths)
    if case is not None:
        report |= {'case': case.name, 'uncertainty': uncertainty_to_dict(scene.uncertainty)}
    return report


def _weighted(
    runs: _Runs, store: Store, done: Ensemble, wall: float, observation: str
) -> dict[str, Any]:
    """Write the maps weighted by an observation to a folder of their own; return their report."""
    assert done.weighted is not None and done.weights is not None
    options, plan = runs.options, store.plan
    folder = made_folder(runs.output / WEIGHTED)
    store.keep_weights(done.weights, folder)
    report = runs.summary(plan, done.weighted, done, wall)
    report['observed'] = describe_agreement(done, observation)
    report |= runs.scores(store, options.members, folder, done.weights.values.tolist())
    plain = with_units(report, m='spacing usable_spacing')
    write_record(folder, {**store.record, **plain, 'status': FINISHED})
    runs.keep(plan, done.weighted, folder, report, observation)
    return report


def _posterior(
    runs: _Runs, plan: Plan, members: Sequence[Member], done: Ensemble, observation: str
) -> dict[str, Any]:
    """Run new members near those that agree with the observation; return their report."""
    assert runs.outline is not None and done.weights is not None
    options = runs.options
    posterior = Posterior(tuple(members), done.weights.values)
    drawn = draw_members(
        plan.scene, options.posterior or 0, posterior=posterior, seed=options.seed,
        susceptibility=runs.kept['susceptibility'],
    )
    check_members(plan.scene, drawn)
    store = Store(**_of_posterior(runs, plan, members), **runs.kept)
    again, wall = runs.run(store, drawn, 'new members')
    assert again.weights is not None
    result = runs.summary(store.plan, again.maps, again, wall)
    result['effective_parents'] = posterior.effective_members
    result['jaccard_mean'] = float(again.weights.jaccard.mean())
    result |= runs.scores(store, len(drawn), store.path)
    runs.keep(store.plan, again.maps, store.path, result, observation)
    store.finish(with_units(result, m='spacing usable_spacing'))
    return result


def _of_posterior(runs: _Runs, plan: Plan, members: Sequence[Member]) -> dict[str, Any]:
    """Return the arguments of the store of new members near some, in addition to the common."""
    seen = runs.outline
    assert seen is not None
    # keep the effects that sentinels have switched on for the first members
    return {
        'folder': runs.output / f'{POSTERIOR}_{seen.time:.10g}s',
        'plan': replace(plan, switched_on=()),
        'parents': parents_digest(members, np.array(seen.time), seen.lava, seen.known),
    }


def _with_barriers(runs: _Runs, plan: Plan, barriers: Sequence[Barrier]) -> dict[str, Any]:
    """Return the arguments of the store of members with barriers, in addition to the common."""
    scene = run_barriers.dammed(plan.scene, barriers, runs.options.built)
    # keep the effects that sentinels have switched on for the members without barriers
    return {
        'folder': runs.output / run_barriers.WITH_BARRIERS,
        'plan': replace(plan, scene=scene, switched_on=()),
    }


def _dammed(
    runs: _Runs, plan: Plan, members: Sequence[Member], barriers: Sequence[Barrier]
) -> dict[str, Any]:
    """Run the members with barriers, and return the comparison."""
    other = Store(**_with_barriers(runs, plan, barriers), **runs.kept)
    again, wall = runs.run(other, members, 'members with barriers')
    result = runs.summary(other.plan, again.maps, again, wall)
    runs.keep(other.plan, again.maps, other.path, result)
    other.finish(with_units(result, m='spacing usable_spacing'))
    return run_barriers.compare(
        runs.options, runs.output, other.path, barriers, runs.origin(other.plan)
    )
