# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write tables of pages in docs/ from the CSV files in this folder.

python docs/benchmarks/tables.py
"""

import error_tables as errors
import model_tables as model
import nav2_tables as nav2
import performance_tables as performance
import preset_tables as presets
from table_text import HERE, named, written
import validation_tables as validation

PAGES = {
    '../README.md': named(validation.flows),
    'VALIDATION.md': named(
        validation.flows, validation.scores, validation.hindcast_steps, validation.codes,
        validation.chances, validation.dates, validation.front, validation.commands,
        validation.outlines, validation.left_out, validation.etna_cells,
    ),
    'MODEL.md': named(
        model.carriers, model.grounds, model.kernel_radii, model.described, model.kernel_ratios,
        model.mobility_limits, validation.fluid,
    ),
    'PERFORMANCE.md': named(
        performance.steps, performance.covered_cells, performance.members, performance.cell_stages,
    ),
    'presets.md': named(
        presets.preset_costs, presets.preset_gains, presets.preset_scores, presets.command_times,
        presets.methods, presets.method_scores,
    ),
    'NAV2.md': named(nav2.rolling_windows, nav2.masks),
    'how_to/ensemble.md': named(errors.twins, errors.twins_outline),
    'benchmarks/README.md': named(
        errors.plans, errors.numerical_error, errors.numerical_error_counts
    ),
}


if __name__ == '__main__':
    for name, tables in PAGES.items():
        path = HERE.parent / name
        path.write_text(written(path.read_text(encoding='utf-8'), tables), encoding='utf-8')
