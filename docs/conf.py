# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""How the pages are built: `make docs` writes build/docs/index.html."""

import lava_ros

project = 'lava_ros'
author = 'lava_ros contributors'
copyright = '2026, lava_ros contributors'  # noqa: A001 (the name that Sphinx reads)
version = release = lava_ros.__version__

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx.ext.viewcode',
]
exclude_patterns = ['accuracy/*', 'benchmarks/*']
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}

html_theme = 'furo'
html_title = f'lava_ros {release}'

myst_enable_extensions = ['colon_fence', 'dollarmath']
myst_heading_anchors = 3
# Links to files of the repository are no pages.
suppress_warnings = ['myst.xref_missing']

# The pages are built without ROS as well.
autodoc_mock_imports = [
    'builtin_interfaces',
    'diagnostic_msgs',
    'geometry_msgs',
    'nav_msgs',
    'rcl_interfaces',
    'rclpy',
    'rosgraph_msgs',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
    'visualization_msgs',
]
autodoc_member_order = 'bysource'
autodoc_typehints = 'description'
napoleon_use_ivar = True
