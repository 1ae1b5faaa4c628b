"""Starting with good and bad parameters, and ending."""

import pytest
from planner_process import ROOT, connected_client, running_planner

from dlo_planner import Pose


@pytest.mark.parametrize('config', sorted(path.name for path in (ROOT / 'config').glob('*.yaml')))
def test_every_dlo_in_config_hangs(domain, tmp_path, config):
    arguments = ('--params-file', str(ROOT / 'config' / config))
    with running_planner(tmp_path, *arguments) as planner, connected_client(planner) as client:
        path, _ = client.predict_shape(Pose.looking_along((0, 0, 1), (1, 0, 0)))
        assert len(path.poses) == 65
        assert path.poses[-1].pose.position.z < 1.0
        assert planner.interrupt() == 0
        assert 'Traceback' not in planner.log


def test_whole_numbers_in_yaml_are_taken_for_doubles(domain, tmp_path):
    config = tmp_path / 'whole.yaml'
    config.write_text('dlo_planner:\n  ros__parameters:\n    rod: {length: 2, density: 8960}\n'
                      '    gravity: [0, 0, -10]\n')
    arguments = ('--params-file', str(config))
    with running_planner(tmp_path, *arguments) as planner, connected_client(planner) as client:
        path, _ = client.predict_shape(Pose.looking_along((0, 0, 5), (0, 0, -1)))
        assert path.poses[-1].pose.position.z == pytest.approx(3.0)


@pytest.mark.parametrize(('argument', 'reason'), [
    ('rod.length:=-1.0', 'rod.length'),
    ('rod.section:=oval', "rod.section = 'oval'"),
    ('rod.length:=long', "rod.length = 'long'"),
    ('gravity:=[down]', 'gravity'),
])
def test_bad_parameters_end_the_start_with_a_reason(domain, tmp_path, argument, reason):
    with running_planner(tmp_path, '-p', argument) as planner:
        assert planner.process.wait(timeout=60) == 1
        assert 'cannot start' in planner.log
        assert reason in planner.log
        assert 'Traceback' not in planner.log
