# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes and motions of this package against those of another engine, MuJoCo, in the same scenes.

python -m benchmarks.cross_check [FOLDER] [words in the name of a scene]
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import report
from benchmarks.cross import refinement
from benchmarks.cross.engines import by_mujoco, by_package
from benchmarks.cross.scenes import CONTACT, MOTION, STATIC, Scene, scenes

# Chains in steps of sqrt(2), in contact twice as many, for it matters whether a joint touches or
# the middle of a piece. Contacts are stiffer with shorter steps of time, but their places are known
# with these; motions are of first order in time, so the steps shrink with the square.
CELLS = {STATIC: (28, 40, 56, 80), CONTACT: (20, 24, 28, 34, 40, 48, 56), MOTION: (28, 40, 56, 80)}
_STEP, _BY_SQUARE = 5e-4, 0.4  # s; s times cells^2
IN_CONTACT = 1e-3  # m: what scenes in contact have to show, MuJoCo's own error included
HEADS = ['scene', 'apart', "MuJoCo's own error", 'shown', 'own estimate', 'limit',
         'of the finest chain', 'met']


@dataclass(frozen=True)
class Compared:
    """A scene by both engines.

    Attributes:
        package: (k, n, 3) m
        chain: (k, n, 3) m, the limit of ever finer chains
        apart: largest distance of the two, m
        finest: largest distance of the package from the finest chain, m
        doubt: how well the limit is known, m
        estimate: the package's own error estimate, m
    """

    scene: Scene
    package: NDArray[np.float64]
    chain: NDArray[np.float64]
    apart: float
    finest: float
    doubt: float
    estimate: float

    @property
    def shown(self) -> float:
        """How far the package is at most from what MuJoCo leads to, as far as that is known, m."""
        return self.apart + self.doubt

    @property
    def limit(self) -> float:
        """What `apart` has to stay below, m: what both say; `shown` below 1 mm in contact, too."""
        said = self.estimate + self.doubt
        return min(said, IN_CONTACT - self.doubt) if self.scene.kind == CONTACT else said

    @property
    def met(self) -> bool:
        """Whether it does."""
        return self.apart <= self.limit


def compare(scene: Scene, cells: Sequence[int] | None = None, step: float = _STEP) -> Compared:
    """Return a scene by both engines.

    Args:
        cells: of MuJoCo's chains, three at least
        step: of time in s where the DLO comes to rest in contact
    """
    cells, mine = cells or CELLS[scene.kind], by_package(scene)
    found = np.array([by_mujoco(scene, n, _BY_SQUARE / n**2 if scene.kind == MOTION else step)
                      for n in cells])
    chain = refinement.limit(cells, found)
    return Compared(scene, mine.places, chain, refinement.largest(mine.places - chain),
                    refinement.largest(mine.places - found[-1]),
                    refinement.doubt(cells, found), mine.estimate)


def line(one: Compared) -> list[str]:
    """Return the cells of a row, lengths in mm."""
    lengths = (one.apart, one.doubt, one.shown, one.estimate, one.limit, one.finest)
    return [one.scene.name, *(f'{1e3 * length:.3f} mm' for length in lengths),
            'yes' if one.met else '**no**']


def as_json(one: Compared) -> dict[str, object]:
    """Return a row as what JSON can hold."""
    return {'kind': one.scene.kind, 'apart_m': one.apart, 'from_finest_m': one.finest,
            'mujoco_error_m': one.doubt, 'shown_m': one.shown, 'own_estimate_m': one.estimate,
            'limit_m': one.limit, 'met': one.met}


def write(folder: Path, found: Sequence[Compared]) -> None:
    """Print the table; write it and its pictures."""
    from benchmarks.cross.pictures import draw  # noqa: PLC0415  matplotlib

    text = report.markdown(HEADS, [line(one) for one in found])
    print(text, flush=True)
    draw(folder, found)
    pictures = ''.join(f'![{kind}](cross_check_{kind}.png)\n\n'
                       for kind in dict.fromkeys(one.scene.kind for one in found))
    report.write(folder, 'cross_check', '# Against MuJoCo', f'{text}\n{pictures}',
                 {one.scene.name: as_json(one) for one in found})


def main(folder: Path, words: str = '') -> list[Compared]:
    """Compare all scenes whose names contain `words`, write tables and pictures, return them."""
    found = []
    for scene in scenes():
        if words in scene.name:
            found.append(compare(scene))
            print(' | '.join(line(found[-1])), flush=True)
    write(folder, found)
    return found


if __name__ == '__main__':
    main(Path(sys.argv[1] if len(sys.argv) > 1 else 'cross_output'), *sys.argv[2:3])
