# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of rolling windows and masks in docs/NAV2.md."""

from collections.abc import Iterator

from table_text import Line, lines_of


def allowed_delay(window: float, speed: float, heartbeat: float) -> float:
    """Return the delay of a mask for which a rolling window still has it under the robot [s].

    From the side of the window [m], the speed of the robot [m/s] and the heartbeat of the mask [s]
    (docs/NAV2.md), for a robot of 0.3 m in cells of 0.05 m that are updated at 5 Hz.
    """
    radius, cell, updates = 0.3, 0.05, 5.0
    return (0.5 * window - radius - cell) / speed - heartbeat - 1.0 / updates


def rolling_windows() -> Iterator[Line]:
    """Yield the costmaps that have the mask under a moving robot, by window and speed."""
    rows = lines_of('rolling_window.csv')
    kinds = list(dict.fromkeys((row['heartbeat_s'], row['static_layer']) for row in rows))
    yield ('window [m]', 'speed [m/s]', *(
        f'static layer, {float(heartbeat):g} s' if static == 'True' else f'{float(heartbeat):g} s'
        for heartbeat, static in kinds
    ))
    found = {
        (row['window_m'], row['speed_m_s'], row['heartbeat_s'], row['static_layer']): row
        for row in rows
    }
    for window, speed in dict.fromkeys((row['window_m'], row['speed_m_s']) for row in rows):
        line = []
        for heartbeat, static in kinds:
            row = found[window, speed, heartbeat, static]
            delay = allowed_delay(float(window), float(speed), float(heartbeat))
            text = f'{row["whole"]} of {row["costmaps"]}'
            if static != 'True':
                text += f', {"safe" if delay > 0.0 else "**not safe**"} ({delay:.2f} s)'
            line.append(text)
        yield window, speed, *line


def masks() -> Iterator[Line]:
    """Yield the cost of a mask with the shipped heartbeat, and the received masks, by its size."""
    yield ('cells', 'node [% of a core]', 'subscriber [% of a core]', 'received: reliable',
           'received: best_effort')
    rows = lines_of('masks.csv')
    for row in rows:
        if not int(row['due']):
            continue
        idle = next(
            item for item in rows if item['side'] == row['side'] and not int(item['due'])
        )
        side = int(row['side'])
        yield (
            f'{side:,} x {side:,}',
            f'{row["node_percent"]} (without masks {idle["node_percent"]})',
            f'{row["reliable_percent"]} (without masks {idle["reliable_percent"]})',
            f'{row["reliable_received"]} of {row["due"]}',
            f'{row["best_effort_received"]} of {row["due"]}',
        )
