# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The site: `make docs`, or rosdoc2, which runs this file from a folder of its own."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

from numpy.typing import ArrayLike
from sphinx.util.typing import stringify_annotation


def repository() -> Path:
    """Return the folder of the sources: rosdoc2 runs a wrapper elsewhere, which names this file."""
    wrapped = re.search(r'exec\(open\("(.+?)"\)', Path(__file__).read_text())
    return Path(wrapped[1] if wrapped else __file__).resolve().parent.parent


ROOT = repository()
sys.path[:0] = [str(ROOT), str(ROOT / 'docs')]

import dlo_planner  # noqa: E402  (of these sources, whatever else is installed)

project = 'dlo_planner'
author = 'the dlo_planner contributors'
copyright = f'2026, {author}'
version = release = dlo_planner.__version__

extensions = [
    'made_pages',
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
]
# Comforts, of the extra `docs`: rosdep knows none, the site of a build farm goes without.
offline = find_spec('latex2mathml') is not None
extensions += ['mathml' if offline else 'sphinx.ext.mathjax']
html_math_renderer = 'mathml' if offline else 'mathjax'
extensions += ['sphinx_copybutton'] if find_spec('sphinx_copybutton') else []
html_theme = 'furo' if find_spec('furo') else 'sphinx_rtd_theme'
exclude_patterns = ['_build',
                    # pages of rosdoc2 on what the site shows already
                    'index.rst', 'modules.rst', 'dlo_planner*.rst', 'standards.rst',
                    'standard_docs', '__readme_include.rst']
html_title = f'dlo_planner {release}'

myst_enable_extensions = ['dollarmath', 'colon_fence', 'deflist']
myst_heading_anchors = 3
suppress_warnings = ['myst.header']  # tables of benchmarks begin at a deeper level

napoleon_google_docstring = True  # of rooms that are not in NumPy's style as yet
napoleon_numpy_docstring = True
napoleon_use_ivar = True   # attributes of a value: one list, not an entry each
napoleon_use_rtype = False
autodoc_member_order = 'bysource'
autodoc_typehints_format = 'short'
# under these names in signatures; in modules with `from __future__ import annotations`
autodoc_type_aliases = {name: name for name in (
    'Floats', 'Ints', 'Bools', 'ArrayLike', 'Along', 'Obstacle', 'Passes', 'OnProgress')}
autodoc_default_options = {
    'members': True,
    # what comes from a base of the package belongs to a class; of these it would be noise
    'inherited-members': 'Value,object,Exception,BaseException,OSError,Enum,str,int,tuple',
}
maximum_signature_line_length = 80
# what only a ROS machine, or an extra, has; the site is built without them
autodoc_mock_imports = ['rclpy', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs',
                        'nav_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs', 'trajectory_msgs',
                        'visualization_msgs', 'tf2_ros', 'lifecycle_msgs', 'pinocchio', 'viser',
                        'distributed', 'mujoco']

rosdoc2_settings = {
    'enable_breathe': False,
    'enable_exhale': False,
    'override_theme': False,
    'support_markdown': False,  # myst_parser is among the extensions already
    'enable_autodoc': False,    # so is autodoc, with the mocks above
}


def short_types(app, what, name, obj, options, signature, returned):
    """Name ArrayLike in signatures; where annotations are no strings, autodoc spells it out."""
    spelled = stringify_annotation(ArrayLike, 'smart')
    return tuple(one and one.replace(spelled, 'ArrayLike') for one in (signature, returned))


def setup(app):
    """Connect what is above."""
    app.connect('autodoc-process-signature', short_types)
