# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Formulas of the pages as MathML, which browsers draw without a script from the internet."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert


def setup(app: Any) -> dict[str, Any]:
    """Register the renderer for Sphinx."""
    app.add_html_math_renderer('mathml', (visit_math, None), (visit_display, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}


def visit_math(translator: Any, node: Any) -> None:
    """Write a formula within a text."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def visit_display(translator: Any, node: Any) -> None:
    """Write a formula on a line of its own, which can be scrolled if it is too wide."""
    formula = convert(node.astext(), display='block')
    translator.body.append(f'<div class="formula">{formula}</div>\n')
    raise nodes.SkipNode
