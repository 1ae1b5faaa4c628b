"""Oscillators whose frequencies change slowly, step by step."""

import numpy as np

from dlo_planner.kernels import kernel


@kernel
def vibrated(step, rates, damping, force):
    """Return y and y'/w (2, t + 1, m) of oscillators from rest, exact for steady force in a step.

    Args:
        step: s; rates, damping, force: (t, m) in each step
    """
    count, modes = rates.shape
    out = np.zeros((2, count + 1, modes))
    for m in range(modes):
        place = speed = 0.0
        for k in range(count):
            w = rates[k, m]
            zeta = min(damping[k, m], 0.99)
            free = np.sqrt(1.0 - zeta * zeta)
            still = force[k, m] / (w * w)
            decay = np.exp(-zeta * w * step)
            cosine, sine = np.cos(free * w * step), np.sin(free * w * step)
            away = place - still
            turned = (speed / w + zeta * away) / free
            place = still + decay * (away * cosine + turned * sine)
            speed = w * decay * (speed / w * cosine - (away + zeta * speed / w) / free * sine)
            out[0, k + 1, m] = place
            out[1, k + 1, m] = speed / w
    return out
