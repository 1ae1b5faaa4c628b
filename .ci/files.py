# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Text files are clean: no blanks at the ends of lines, one line feed at the end of a file.

python .ci/files.py FILE ...    lists what is not clean, and ends with 1 if there is anything
python .ci/files.py             the same for all files that git knows

YAML and TOML files can be read. No file is larger than 1 MB, except pictures and recordings.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
BINARY = {'.png', '.gif', '.mcap', '.npz'}
MADE = ('.json', 'metadata.yaml')  # by scripts, as they please: measurements, recordings
LARGE = 1_000_000


def faults(path: Path) -> list[str]:
    """Return what is wrong with a file."""
    data = path.read_bytes()
    if path.suffix in BINARY:
        return []
    found = [f'larger than {LARGE} bytes'] * (len(data) > LARGE)
    text = data.decode()
    if not path.name.endswith(MADE):
        found += [f'line {n}: blanks at its end' for n, line in enumerate(text.split('\n'), 1)
                  if line != line.rstrip()]
        if text and (not text.endswith('\n') or text.endswith('\n\n')):
            found.append('does not end with one line feed')
    return found + unreadable(path, text)


def unreadable(path: Path, text: str) -> list[str]:
    """Return why a YAML or TOML file cannot be read, in a list; it is empty for other files."""
    try:
        if path.suffix in {'.yaml', '.yml', '.cff'}:
            list(yaml.safe_load_all(text))
        elif path.suffix == '.toml':
            tomllib.loads(text)
    except (yaml.YAMLError, tomllib.TOMLDecodeError) as error:
        return [str(error)]
    return []


def known() -> list[Path]:
    """Return the files that git knows."""
    listed = subprocess.run(['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True,
                            check=True).stdout
    return [ROOT / name for name in listed.split('\0') if name and (ROOT / name).is_file()]


def main() -> int:
    """List the faults of the files."""
    wrong = [f'{path}: {fault}' for path in [*map(Path, sys.argv[1:])] or known()
             for fault in faults(path)]
    print('\n'.join(wrong), end='\n' * bool(wrong))
    return bool(wrong)


if __name__ == '__main__':
    sys.exit(main())
