# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrival of lava at places in runs on disk: the table of `lava places` and `lava map`."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import tzinfo
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError, RefusalError
from lava_ros.forecast.store import maps_at
from lava_ros.layers.place_arrivals import arrivals, ArrivalTable, flow_table
from lava_ros.layers.places import Places, places_on
from lava_ros.products.run_page import dated, Members, read_run, Run
from lava_ros.scene.features import Feature
from lava_ros.scene.onset import Onset


def table_of(
    path: str | Path, features: Sequence[Feature], *, node: str | None = None,
    time: float | None = None, onset: Onset | None = None, zone: tzinfo | None = None,
) -> ArrivalTable:
    """Return the arrival of lava at points, lines and areas.

    Args:
        path: A bag or the folder of an ensemble.
        features: Features of ``features.load_features``, in any coordinate system.
        node: Full name or namespace of a node of the bag; None for the only one.
        time: Simulated time of a bag's maps [s]; None for the last ones.
        onset: Date of simulated time 0; None for the date that the run states, if any.
        zone: Zone of local times; None for the zone of this machine.

    Raises:
        LavaError: If the run cannot be read or has no arrival times, or a feature cannot be placed
            on its terrain.
    """
    run = read_run(path, node=node, time=time, wanted=('arrival',))
    places = places_on([item.on(run.terrain) for item in features], run.terrain)
    if run.ensemble is not None:
        table = _table_of_members(Path(path), run, run.ensemble, places)
    else:
        table = _table_of_bag(path, run, places)
    return replace(table, onset=dated(onset, zone, [run]))


def _table_of_bag(path: str | Path, run: Run, places: Places) -> ArrivalTable:
    panel = run.panels.get('arrival')
    if panel is None:
        raise LavaError('bag', str(path), 'a bag with the layer arrived, or with the thickness')
    frame, arrived = panel.frame, panel.values
    facts: dict[str, Any] = {
        'inundation_threshold_m': frame.threshold, 'time_s': frame.time, **run.quality(),
    }
    if frame.arrived is not arrived and np.isfinite(places.at(arrived)).any():
        facts['note'] = 'each time is that of the first map in the bag with lava at the place'
    return flow_table(places, run.terrain, arrived, frame.inundated, facts)


def _table_of_members(
    folder: Path, run: Run, members: Members, places: Places
) -> ArrivalTable:
    maps = maps_at(folder, members.plan, places, members=members.count)
    if not math.isclose(maps.effective_members, members.effective, rel_tol=1e-6):
        problem = f'The maps in {folder} do not have the weights of its members'
        raise RefusalError('ensemble', problem, 'Repeat the lava run command')
    assert maps.places is not None
    rows = arrivals(
        places,
        *(
            {fraction: places.at(values) for fraction, values in quantiles.items()}
            for quantiles in (maps.arrival, maps.inundated)
        ),
        probability=maps.places.probability,
        first=maps.places.arrival,
        earliest=maps.places.earliest,
        members=maps.effective_members,
    )
    facts: dict[str, Any] = {
        'inundation_threshold_m': members.plan.threshold,
        'horizon_s': members.plan.horizon,
        'members': maps.members,
        'effective_members': maps.effective_members,
        **maps.limits(),
        'arrival_error_s': maps.arrival_error,
        **run.quality(),
    }
    if maps.spacing_error is not None and not maps.spacing_error.is_usable:
        facts['note'] = maps.spacing_error.text()
    return ArrivalTable(rows, facts, is_ensemble=True)
