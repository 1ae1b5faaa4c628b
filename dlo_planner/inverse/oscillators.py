"""Oscillators whose frequencies and axes change slowly, step by step."""

import numpy as np

from dlo_planner.kernels import kernel


@kernel
def vibrated(step, rates, damping, turns, force, begin):
    """Return y and y'/w (2, c, t + 1, m) of m oscillators under c forces.

    Exact for a steady force in a step. Between two steps their axes turn.

    Args:
        step: s; rates, damping: (t, m) in each step
        turns: (t, m, m) of coordinates by the axes in a step, into those by the axes of the next
        force: (c, t, m)
        begin: (2, c, m) y and y'/w before the first step
    """
    count, modes = rates.shape
    cases = force.shape[0]
    out = np.zeros((2, cases, count + 1, modes))
    out[:, :, 0] = begin
    place, speed = begin[0].copy(), begin[1] * rates[0]
    there, fast = np.empty(modes), np.empty(modes)
    for k in range(count):
        for m in range(modes):
            w = rates[k, m]
            zeta = min(damping[k, m], 0.99)
            free = np.sqrt(1.0 - zeta * zeta)
            decay = np.exp(-zeta * w * step)
            cosine, sine = decay * np.cos(free * w * step), decay * np.sin(free * w * step) / free
            for c in range(cases):
                still = force[c, k, m] / (w * w)
                away, rate = place[c, m] - still, speed[c, m] / w
                place[c, m] = still + away * cosine + (rate + zeta * away) * sine
                speed[c, m] = w * (rate * cosine - (away + zeta * rate) * sine)
        for c in range(cases):
            for i in range(modes):
                there[i] = fast[i] = 0.0
                for j in range(modes):
                    there[i] += turns[k, i, j] * place[c, j]
                    fast[i] += turns[k, i, j] * speed[c, j]
            for i in range(modes):
                place[c, i] = there[i]
                speed[c, i] = fast[i]
                out[0, c, k + 1, i] = there[i]
                out[1, c, k + 1, i] = fast[i] / rates[k, i]
    return out
