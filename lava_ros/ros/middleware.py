# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The middleware of the process, and its settings for Fast DDS."""

import os
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier

from lava_ros.files.resources import share_path

#: Environment variables that name a file of profiles for Fast DDS: for version 2 (ROS Jazzy), and
#: for version 3.
PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')

#: Files of profiles that Fast DDS 2 and 3 also read, from the working directory.
LOCAL_PROFILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')

#: Environment variable for the thread in which Fast DDS sends.
PUBLICATION_MODE = 'RMW_FASTRTPS_PUBLICATION_MODE'

#: Environment variable, 1 to take QoS and publication mode from the profiles.
QOS_FROM_PROFILES = 'RMW_FASTRTPS_USE_QOS_FROM_XML'


def _uses_fast_dds() -> bool:
    return str(get_rmw_implementation_identifier()).startswith('rmw_fastrtps')


def _local_profiles() -> list[Path]:
    """Return the existing files of profiles in the working directory that Fast DDS reads."""
    if os.environ.get('SKIP_DEFAULT_XML_FILE') == '1':
        return []
    return [path for path in map(Path.cwd().joinpath, LOCAL_PROFILES) if path.is_file()]


def set_profiles() -> None:
    """Make Fast DDS use params/fast_dds.xml, unless the user has chosen other profiles."""
    has_own = _local_profiles() or any(name in os.environ for name in PROFILES)
    if _uses_fast_dds() and not has_own:
        os.environ[PROFILES[0]] = str(share_path('params/fast_dds.xml'))


def described() -> tuple[str, bool]:
    """Describe the middleware of this process, once its profiles are set.

    Returns:
        A sentence for the log, and True unless the user's profiles are missing.
    """
    name = str(get_rmw_implementation_identifier())
    if not _uses_fast_dds():
        return f'middleware: {name}', True
    shipped = str(share_path('params/fast_dds.xml'))
    given = {name: os.environ[name] for name in PROFILES if name in os.environ}
    used = [(name, f'{name}={path}') for name, path in given.items() if path != shipped]
    used += [(path.name, str(path)) for path in _local_profiles()]
    # Fast DDS 2, which ROS Jazzy has, reads neither
    unread = (PROFILES[1], LOCAL_PROFILES[1])
    texts = [f'{text} (only for Fast DDS 3)' if key in unread else text for key, text in used]
    missing = [path for path in given.values() if path and not Path(path).is_file()]
    mode = os.environ.get(PUBLICATION_MODE, 'SYNCHRONOUS')
    if os.environ.get(QOS_FROM_PROFILES) == '1':
        mode = 'of the profiles'
    text = f'middleware: {name}, publication mode {mode}, profiles '
    if texts:
        text += f'of the user instead of {shipped}: {", ".join(texts)}'
    else:
        text += shipped
    if missing:
        text += f'; {", ".join(missing)}: no such file'
    return text, not missing
