# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Build of the ROS 2 package; the Python packages are `dlo_planner` and `msg_helpers`."""

import os
import re
import subprocess
import sys
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

import setuptools
from setuptools import find_packages, setup
from setuptools.command.build_py import build_py
from setuptools.command.develop import develop

NAME = 'dlo_planner'
ROOT = Path(__file__).parent
VERSION = re.search(r"^__version__ = '(.+?)'", (ROOT / NAME / '__init__.py').read_text(),
                    re.MULTILINE).group(1)
PACKAGE = ElementTree.parse(ROOT / 'package.xml')  # the one place of names and addresses


def say(text):
    """Tell who installs: pip hides what a build prints, unless it is asked for it by -v."""
    try:
        with open('/dev/tty', 'w', encoding='utf-8') as terminal:
            terminal.write(f'\r{text}\n')
    except OSError:  # nobody sits there
        print(text, file=sys.stderr)


def compile_ahead(folder):
    """Compile the kernels of the package in a folder into it, so that the first start is quick.

    It takes minutes; DLO_PLANNER_PREBUILD=0 leaves it to the first start. Without numba, or where
    it fails, the package is as good, and compiles when it is used.
    """
    if os.environ.get('DLO_PLANNER_PREBUILD') == '0':
        return
    say(f'{NAME}: compiling the solver ahead, for one to three minutes')
    done = subprocess.run([sys.executable, '-m', f'{NAME}.prebuild'], cwd=folder, check=False)
    if done.returncode:
        print(f'{NAME}: kernels were not compiled ahead, see above', file=sys.stderr)


class BuildPy(build_py):
    """Copies the package, and compiles it in the copy; in place where that is what is installed."""

    def run(self):  # noqa: D102
        super().run()
        compile_ahead('.' if self._in_place() else self.build_lib)

    def get_outputs(self, *args, **kwargs):  # noqa: D102
        made = [] if self._in_place() else glob(f'{self.build_lib}/{NAME}/compiled/*/*')
        return super().get_outputs(*args, **kwargs) + made

    def _in_place(self):
        return getattr(self, 'editable_mode', False)  # since setuptools 64


class Distribution(setuptools.Distribution):
    """What is compiled ahead is for one Python: a wheel with it is tagged so, and no other."""

    def has_ext_modules(self):  # noqa: D102
        return os.environ.get('DLO_PLANNER_PREBUILD') != '0'


class Develop(develop):
    """What `colcon build --symlink-install` runs."""

    def run(self):  # noqa: D102
        super().run()
        compile_ahead('.')


setup(
    name=NAME,
    version=VERSION,
    description='Direct and inverse simulation of deformable linear objects in a gripper',
    long_description=(ROOT / 'README.md').read_text(),
    long_description_content_type='text/markdown',
    author=PACKAGE.findtext('author'),
    project_urls={url.get('type'): url.text for url in PACKAGE.findall('url')},
    license='Apache-2.0',
    classifiers=['License :: OSI Approved :: Apache Software License',
                 'Programming Language :: Python :: 3.11',
                 'Programming Language :: Python :: 3.12',
                 'Programming Language :: Python :: 3.13',
                 'Topic :: Scientific/Engineering :: Physics'],
    packages=find_packages(include=['dlo_planner*', 'msg_helpers*']),
    package_data={NAME: ['py.typed'], 'msg_helpers': ['py.typed']},  # PEP 561: typed
    python_requires='>=3.11',
    # numba is not in package.xml, as rosdep has no key for it: a ROS package that is built without
    # it runs as plain Python, slowly, until `pip install numba`.
    install_requires=['numpy>=1.26', 'scipy>=1.11', 'numba>=0.62', 'toppra>=0.6',
                      'click>=8.1', 'pyyaml>=6.0.1'],
    extras_require={
        'figures': ['matplotlib>=3.6'],
        'arm': ['pin>=3'],
        'view': ['viser>=1.1'],
        'scene': ['mujoco>=3.13', 'trimesh>=5.0', 'lxml', 'networkx'],
        'mesh': ['trimesh>=5.0', 'lxml', 'networkx'],
        'cluster': ['distributed>=2024.1'],
        'peers': ['mujoco', 'pyelastica', 'cosseratbench', 'matplotlib'],
        'cell': ['mujoco>=3.13', 'matplotlib>=3.6'],
        'docs': ['sphinx>=7', 'furo', 'myst-parser', 'sphinx-copybutton', 'latex2mathml'],
        'test': ['pytest', 'pytest-xdist>=3.7', 'pytest-rerunfailures', 'hypothesis',
                 'import-linter', 'ros-domain-coordinator', 'playwright', 'mypy', 'ruff', 'build',
                 'setuptools', 'wheel'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', glob('config/*')),
        (f'share/{NAME}/launch', glob('launch/*.py')),
        # what `ros2 run` finds; their common names are on nobody's PATH
        (f'lib/{NAME}', sorted(glob('scripts/*'))),
    ],
    entry_points={
        'console_scripts': [
            'dlo-planner = dlo_planner.cli.main:main',
        ],
    },
    distclass=Distribution,
    cmdclass={'build_py': BuildPy, 'develop': Develop},
    zip_safe=False,
)
