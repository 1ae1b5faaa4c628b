# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A Sphinx extension: equations as MathML, which every browser of today draws without a network.

MathJax, Sphinx' own way, is loaded from the web by each page that is opened.
"""

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util.math import get_node_equation_number


def drawn(node, display: str) -> str:
    """Return the MathML of a formula; browsers know no variants of letters, but styles."""
    text = convert(node.astext(), display=display)
    return text.replace('mathvariant="bold"', 'style="font-weight: bold"')


def inline(writer, node) -> None:
    """Write a formula inside a line."""
    writer.body.append(drawn(node, 'inline'))
    raise nodes.SkipNode


def block(writer, node) -> None:
    """Write a formula that stands by itself, with its number if it has one."""
    writer.body.append(writer.starttag(node, 'div', CLASS='equation', STYLE='padding: 0.4em 0'))
    if node['number']:
        writer.body.append(f'<span class="eqno">({get_node_equation_number(writer, node)})</span>')
    writer.body.append(drawn(node, 'block') + '</div>\n')
    raise nodes.SkipNode


def setup(app) -> dict:
    """Name what writes equations in HTML."""
    app.add_html_math_renderer('mathml', (inline, None), (block, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
