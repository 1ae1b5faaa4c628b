# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Print a pin of everything that pip has installed beside this Python, for requirements.lock."""

from importlib.metadata import distributions

print('# What requirements-dev.txt stood for when last looked at; refresh it by `make lock`.')
installed = {one.metadata['Name'].lower().replace('_', '-'): one.version
             for one in distributions() if (one.read_text('INSTALLER') or '').strip() == 'pip'}
for name in sorted(installed.keys() - {'pip'}):
    print(f'{name}=={installed[name]}')
