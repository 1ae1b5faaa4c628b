# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Every source file begins with its copyright and its license (SPDX).

python .ci/copyright.py         lists the files without, and ends with 1 if there are any
python .ci/copyright.py --add   adds the two lines to them
"""

import subprocess
import sys
from pathlib import Path

HEADER = ('# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors\n'
          '# SPDX-License-Identifier: Apache-2.0\n')
KINDS = {'.py', '.sh'}
ROOT = Path(__file__).resolve().parent.parent
_BEFORE = ('#!', '# -*-')  # lines that have to be the first of a file


def sources(root: Path = ROOT) -> list[Path]:
    """Return the source files: by their names, or by their first line."""
    listed = subprocess.run(['git', 'ls-files', '--cached', '--others', '--exclude-standard'],
                            cwd=root, capture_output=True, text=True, check=True).stdout
    paths = (root / name for name in listed.splitlines())
    return [path for path in paths if path.is_file() and is_source(path)]


def is_source(path: Path) -> bool:
    """Return whether a file is a script or a module that has something in it."""
    if path.suffix in KINDS:
        return path.stat().st_size > 0
    with path.open('rb') as file:
        return not path.suffix and file.read(2) == b'#!'


def split(text: str) -> tuple[str, str]:
    """Return the lines that have to stay first, and the rest."""
    lines = text.splitlines(keepends=True)
    n_first = next((n for n, line in enumerate(lines) if not line.startswith(_BEFORE)), len(lines))
    return ''.join(lines[:n_first]), ''.join(lines[n_first:])


def has_header(text: str) -> bool:
    """Return whether the two lines stand where they belong."""
    return split(text)[1].startswith(HEADER)


def with_header(text: str) -> str:
    """Return a source with the two lines."""
    first, rest = split(text)
    return text if has_header(text) else first + HEADER + rest


def main() -> int:
    """List the files without a header, or mend them."""
    without = [path for path in sources() if not has_header(path.read_text())]
    if '--add' in sys.argv[1:]:
        for path in without:
            path.write_text(with_header(path.read_text()))
        print(f'{len(without)} files changed')
        return 0
    for path in without:
        print(f'{path.relative_to(ROOT)}: no copyright and license')
    return bool(without)


if __name__ == '__main__':
    sys.exit(main())
