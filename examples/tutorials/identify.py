# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Identify your cable
#
# A data sheet rarely knows how stiff a cable is, and never how it is bent by its coil. Hang the
# cable from the gripper, take points of it with a camera, and let `fit_rod` find both.
#
# Here a simulated cable stands in place of the real one, with 1 mm of noise.
import numpy as np

from dlo_planner import DirectSimulator, Pose, Rod, fit_rod
from dlo_planner.identify import Observation

true = Rod(1.0, mass_per_length=0.07, bending_stiffness=0.02, torsional_stiffness=0.015,
           natural_curvature=(0.6, 0.0))
rng = np.random.default_rng(1)
grippers = [Pose.looking_along((0, 0, 1), direction)
            for direction in ((1, 0, 0), (1, 0, 1), (0, 0.2, -1))]
looks = []
for gripper in grippers:
    seen = DirectSimulator(true).solve(gripper).positions[4::3]
    looks.append(Observation(gripper, seen + 1e-3 * rng.normal(size=seen.shape)))

# %%
# The first guess has to be right in what is not sought: weigh the cable and measure its length.
# Shapes show only the ratio of stiffness to weight, so one of the two has to be known.
guess = Rod(1.0, mass_per_length=0.07, bending_stiffness=0.05, torsional_stiffness=0.015)
fit = fit_rod(guess, looks, ('bending_stiffness', 'natural_curvature'))

# %%
# Each value comes with its standard deviation. A deviation that is infinite means that the looks
# say nothing about this value: hold the gripper in another direction and look again.
stiffness = fit.values['bending_stiffness'][0]
deviation = fit.deviations['bending_stiffness'][0]
print(f'EI = {stiffness:.5f} +- {deviation:.5f} N m^2, true 0.02')
print('natural curvature', fit.values['natural_curvature'], 'true (0.6, 0)')
assert fit.converged
assert abs(stiffness - 0.02) < 4 * deviation

# %%
# `fit.rod` is the cable that was found. At the terminal the same is
# `dlo-planner identify my_cable.yaml looks.yaml -o identified.yaml`.
found = DirectSimulator(fit.rod).solve(grippers[0])
truth = DirectSimulator(true).solve(grippers[0])
print(f'free end predicted within '
      f'{1e3 * np.linalg.norm(found.positions[-1] - truth.positions[-1]):.2f} mm')
