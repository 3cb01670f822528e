# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Configuration of Sphinx: `make docs` writes build/docs/index.html."""

from pathlib import Path
import sys

import lava_ros
from lava_ros.verification.cases import TITLES
from lava_ros.verification.rows import read_csv

project = 'lava_ros'
author = 'lava_ros contributors'
copyright = '2026, lava_ros contributors'  # noqa: A001 (Sphinx reads this name)
version = release = lava_ros.__version__

# the extension of this folder
sys.path.insert(0, str(Path(__file__).parent))

extensions = [
    'mathml',
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx.ext.viewcode',
]
exclude_patterns = ['benchmarks/*']
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}

html_theme = 'furo'
html_title = f'lava_ros {release}'
# Formulas and styles come from the pages themselves: they need no internet.
html_math_renderer = 'mathml'
html_static_path = ['static']
html_css_files = ['wide.css']

myst_enable_extensions = ['colon_fence', 'dollarmath']
myst_heading_anchors = 3
# Links to files of the repository are not pages.
suppress_warnings = ['myst.xref_missing']

# The pages can be built without ROS.
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

# The pages of measurements are not in the repository: they are generated from the tables.
from accuracy_report import markdown  # noqa: E402

for table in Path(__file__).parent.glob('accuracy/[ch]*.csv'):
    page = markdown(read_csv(table), TITLES, stem=table.stem)
    table.with_suffix('.md').write_text(page, encoding='utf-8')
