# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Build of the ROS 2 package; the Python packages are `dlo_planner` and `msg_helpers`."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'dlo_planner'
ROOT = Path(__file__).parent
VERSION = re.search(r"^__version__ = '(.+?)'", (ROOT / NAME / '__init__.py').read_text(),
                    re.MULTILINE).group(1)

setup(
    name=NAME,
    version=VERSION,
    description='Direct and inverse simulation of deformable linear objects in a gripper',
    long_description=(ROOT / 'README.md').read_text(),
    long_description_content_type='text/markdown',
    author='dlo_planner maintainers',
    license='Apache-2.0',
    classifiers=['License :: OSI Approved :: Apache Software License',
                 'Programming Language :: Python :: 3.11',
                 'Programming Language :: Python :: 3.12',
                 'Topic :: Scientific/Engineering :: Physics'],
    packages=find_packages(include=['dlo_planner*', 'msg_helpers*']),
    python_requires='>=3.11',
    install_requires=['numpy>=1.26', 'scipy>=1.11', 'numba>=0.59', 'toppra>=0.6',
                      'click>=8.1', 'pyyaml'],
    extras_require={
        'figures': ['matplotlib'],
        'arm': ['pin>=3'],
        'view': ['viser>=1.1'],
        'cluster': ['distributed>=2024.1'],
        'peers': ['mujoco', 'pyelastica', 'cosseratbench', 'matplotlib'],
        'cell': ['mujoco>=3.13', 'matplotlib'],
        'docs': ['sphinx>=7', 'furo', 'myst-parser', 'sphinx-copybutton'],
        'test': ['pytest', 'hypothesis', 'import-linter', 'ros-domain-coordinator',
                 'playwright', 'pyyaml', 'build', 'setuptools', 'wheel'],
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
        'cosseratbench.solvers': [f'{NAME} = dlo_planner.cosserat.solver:DloPlanner'],
        'console_scripts': [
            'dlo-planner = dlo_planner.cli.main:main',
        ],
    },
    zip_safe=False,
)
