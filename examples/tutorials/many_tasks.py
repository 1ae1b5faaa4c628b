# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Many tasks on many cores, or on a cluster
#
# `dlo_planner.parallel` takes any executor of `concurrent.futures`: threads, processes, or those of
# a Dask cluster. Results do not depend on which one it is.
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dlo_planner import DirectSimulator, InverseSimulator, Pose, Rod, parallel

wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
simulator = DirectSimulator(wire)

# %%
# 500 independent shapes. Kernels release Python's lock, so threads work side by side. Processes
# (`ProcessPoolExecutor`) gain more where Python does much, as in plans; a script has to begin below
# `if __name__ == '__main__':` then. A function that makes the pool in place of the pool lets a
# worker that died be replaced.
rng = np.random.default_rng(0)
grippers = [Pose.looking_along((0, 0, 1), (1, *direction))
            for direction in rng.uniform(-1, 1, size=(500, 2))]
with ThreadPoolExecutor(2) as workers:
    shapes = parallel.map(simulator, grippers, workers)
print(shapes.positions.shape, 'least stability', shapes.stability.min())
assert np.array_equal(shapes.positions[7], simulator.solve(grippers[7]).positions)

# %%
# A capability map: which cut-outs of a cell can be threaded? With `folder=` it is kept, and goes
# on where it was interrupted.
grid = parallel.CellGrid(positions=[(0, 0, 1), (0, 0, 1.5)], directions=[(1, 0, 0)], radii=[0.02])
with ThreadPoolExecutor(2) as workers:
    found = parallel.capability_map(InverseSimulator(simulator), grid, workers)
print(found.threaded)

# %%
# On a cluster (extra `cluster`) only the executor is another one:
#
# ```python
# from dask.distributed import Client
#
# workers = Client('tcp://scheduler:8786').get_executor()
# ```
