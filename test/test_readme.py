"""The README's example runs as printed."""

import re
from pathlib import Path

README = Path(__file__).parent.parent / 'README.md'


def test_library_example(capsys):
    code = '\n'.join(re.findall(r'```python\n(.*?)```', README.read_text(), re.DOTALL))
    exec(compile(code, str(README), 'exec'), {})
    assert 'Pose(' in capsys.readouterr().out


def test_linked_files_exist():
    links = re.findall(r'\]\(([^)#:]+)\)', README.read_text())
    assert links
    assert [link for link in links if not (README.parent / link).exists()] == []
