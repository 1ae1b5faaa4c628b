"""Build of the ROS 2 package; the Python packages are `dlo_planner` and `msg_helpers`."""

from glob import glob

from setuptools import find_packages, setup

NAME = 'dlo_planner'

setup(
    name=NAME,
    version='0.1.0',
    description='Direct and inverse simulation of deformable linear objects in a gripper',
    license='Apache-2.0',
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
        'test': ['pytest', 'hypothesis', 'import-linter', 'ros-domain-coordinator',
                 'playwright', 'pyyaml'],
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
